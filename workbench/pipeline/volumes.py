"""What a CT, a segmentation or a plan is, where it lies and what its numbers mean, for people and for JSON."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.modalities.ct.ct_volume import CtVolume, corners_of, in_world, read_ct
from endoct.modalities.ct.hounsfield import LEAST_HU
from endoct.modalities.ct.stored import SIGNS, Convention
from endoct.modalities.ct.trajectory import is_plan, read_line

MOST_NAMED = 64


@dataclass(frozen=True)
class VolumeFacts:
    """What was read: the ``title`` it is called by, ``facts`` by name, and what was mended and what is doubted."""

    title: str
    facts: Mapping[str, object]
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...]

    def to_json(self) -> dict[str, object]:
        """Return it as files say it."""
        return {**self.facts, "notes": list(self.notes), "doubts": [doubt.to_json() for doubt in self.doubts]}


def facts_of(ct: CtVolume, title: str, coordinates: Convention, doubts: tuple[Doubt, ...] = ()) -> VolumeFacts:
    """Return what is to be said of a volume, places in ``coordinates``; ``doubts``: those besides its own."""
    corners = corners_of(ct) * SIGNS[coordinates]
    sizes = np.linalg.norm(ct.steps_mm, axis=1)
    facts: dict[str, object] = {
        "format": ct.kind,
        "voxels": [int(n) for n in ct.voxels.shape[::-1]],
        "voxel_mm": [round(float(size), 6) for size in sizes[::-1]],
        "coordinates": coordinates,
        "from_mm": [round(float(value), 3) for value in corners.min(axis=0)],
        "to_mm": [round(float(value), 3) for value in corners.max(axis=0)],
        "values": [float(ct.voxels.min()), float(ct.voxels.max())],
    }
    if ct.segments is not None:
        facts["labels"] = {str(segment.label): segment.name or "unknown" for segment in ct.segments[:MOST_NAMED]}
    return VolumeFacts(title, facts, ct.notes, (*ct.doubts, *doubts))


def describe_volume(path: Path) -> dict[str, object]:
    """Return what a CT, a segmentation or a plan is. Raises :class:`EndoctError` where it cannot be used."""
    if path.is_file() and is_plan(path):
        line, convention = read_line(path)
        ends = [np.array(in_world(place, convention)) for place in (line.entry_mm, line.target_mm)]
        return {
            "kind": "plan",
            "coordinates": convention,
            "entry_mm": _rounded(ends[0]),
            "target_mm": _rounded(ends[1]),
            "length_mm": round(line.length_mm, 3),
            "certainty": "its file says what its coordinates mean",
            **({"notes": [line.note]} if line.note else {}),
        }
    ct = read_ct(path, "lps")  # where a file does not say, its places are left out below
    facts = facts_of(ct, path.name, ct.coordinates or "lps")
    kind, meaning = _meaning(ct)
    certainty = "placed as its file says; nothing speaks against it"
    if ct.coordinates is None:
        certainty = "its file does not say whether its coordinates are RAS or LPS: state --coordinates"
    elif facts.doubts:
        certainty = f"placed as its file says; {len(facts.doubts)} doubt{'s' if len(facts.doubts) > 1 else ''} below"
    said = {"kind": kind, **facts.facts, "numbers": meaning, "certainty": certainty}
    if ct.coordinates is None:
        said = {key: value for key, value in said.items() if key not in ("from_mm", "to_mm")} | {"coordinates": None}
    return {**said, "doubts": [doubt.to_json() for doubt in facts.doubts], "notes": list(facts.notes)}


def _meaning(ct: CtVolume) -> tuple[str, str]:
    """Return the kind of a volume, and what its numbers mean."""
    if float(ct.voxels.min()) < LEAST_HU:
        return "CT", "Hounsfield units"
    if ct.segments is not None:
        return "label map", "labels, by the names of its file"
    whole = ct.voxels.dtype.kind in "iu" and float(ct.voxels.min()) >= 0
    count = np.unique(ct.voxels).size if whole else 0
    if whole and count <= MOST_NAMED:
        return "label map", f"{count} labels, which nothing names"
    return "volume", f"not known: no value below {LEAST_HU:g}, and no labels"


def _rounded(place: Coordinates) -> list[float]:
    return [round(float(value), 3) for value in place]
