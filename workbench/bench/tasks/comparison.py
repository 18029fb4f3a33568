"""The main comparison as something to vary: a specimen's two recordings, unrolled and compared with settings."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from endoct.base.errors import EndoctError, NotSeen
from endoct.fusion.comparison import place_sides, score_placed
from endoct.fusion.evidence.side import Side, two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.side_cells import segment
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import validate
from endoct.stitching.panorama import Panorama
from endoct.workbench import api
from endoct.workbench.bench.cases.specimens import DIFFICULTIES, PRESET_WORDS, simulated, truths_of
from endoct.workbench.bench.task import DOUBTED, SUCCESS, Case, Declined, Given, Range, draw
from endoct.workbench.pipeline.truth import held_against, load_truth

Part = Literal["oct", "endoscope", "compare"]
PartSettings = Mapping[str, object]
Settings = Mapping[Part, PartSettings]
"""Parameters that differ from their defaults, by part."""
RANGES: Mapping[str, Range] = {"preset": PRESET_WORDS}
USUAL: Mapping[str, Range] = {"preset": ("quick",)}
SCORES: Mapping[str, str] = {
    "pair_native": "Jaccard index, endoscope against OCT, on the OCT's rows",
    "oct_truth": "Jaccard index, OCT against the truth",
    "endo_truth": "Jaccard index, endoscope against the truth",
    "pair_li": "Jaccard index, endoscope against OCT, cells of both by Li's threshold alone, on the OCT's rows",
    "landmark_mm": "error of where wall points are mapped to, 95th percentile, mm",
    "oct_valid": "share of the OCT's samples that are valid",
}


@dataclass(frozen=True, eq=False)
class Specimen:
    """A specimen's folder; its panoramas stay in memory for settings that do not change them."""

    folder: Path
    _unrolled: dict[tuple[str, str], Panorama] = field(default_factory=dict)

    def unrolled(self, part: str, settings: PartSettings) -> Panorama:
        """Return the panorama of the recording ``part``, unrolled with settings of its plug-in.

        Raises :class:`Declined` where it shows no wall: to say so is an answer.
        """
        key = part, repr(sorted(settings.items()))
        if key not in self._unrolled:
            try:
                self._unrolled[key] = api.unroll(self.folder / part, settings=settings)
            except NotSeen as error:
                raise Declined(str(error).replace(f"{self.folder}/", "")) from error
        return self._unrolled[key]


@dataclass(frozen=True, eq=False)
class ComparedPair:
    """A comparison of a specimen's endoscope (A) and OCT (B), with the two sides as they came in and the parameters."""

    endoscope: Side
    oct: Side
    comparison: Comparison
    parameters: CompareParameters


def compare_pair(specimen: Specimen, settings: Settings) -> ComparedPair:
    """Unroll and compare as `endoct compare SPECIMEN/endoscope SPECIMEN/oct` does, with ``settings``."""
    parameters = validate(CompareParameters, dict(settings.get("compare", {})), "the settings of the comparison")
    a, b = two_sides(*(specimen.unrolled(part, settings.get(part, {})) for part in ("endoscope", "oct")))
    return ComparedPair(a, b, score_placed(place_sides(a, b, parameters), parameters), parameters)


ComparisonCase = Case[tuple[Specimen], Path]
"""A case whose truth is the specimen's folder."""


def simulated_case(seed: int, index: int, ranges: Mapping[str, Range]) -> ComparisonCase:
    """Return a simulated specimen as a case."""
    drawn = draw(seed, index, ranges)
    difficulties = {name: value for name, value in drawn.items() if name in DIFFICULTIES}
    scratch = simulated(str(drawn["preset"]), seed, index, difficulties)
    folder = Path(scratch.name) / "specimen"
    return Case(f"{drawn['preset']}-{seed}-{index}", (Specimen(folder),), folder, drawn, scratch)


def own_cases(folder: Path) -> list[ComparisonCase]:
    """Return a folder of the user's own, with oct/, endoscope/ and truth/, as a case."""
    if not all((folder / part).is_dir() for part in ("oct", "endoscope")):
        raise EndoctError(f"{folder} holds no pair", expected="both oct/ and endoscope/ in it")
    return [Case(folder.name, (Specimen(folder),), folder, {"specimen": folder.name})]


def judge(case: Case[Given, Path], answer: ComparedPair) -> dict[str, float]:
    """Score a comparison against the truth. Raises :class:`Declined` where the sides were not aligned."""
    folder = case.truth
    if (folder / "truth" / "wall.zarr").is_dir():
        truth = load_truth(folder)
        scores = held_against(truth, (answer.endoscope, answer.oct), answer.comparison, answer.parameters)
        right = scores.pop("right", 0.0)
        scores.pop("aligned")
    else:
        scores, right = _against_drawn(folder, answer), 1.0
    if (of_li := answer.comparison.result.by_li) is not None and of_li.own_rows.jaccard is not None:
        scores["pair_li"] = of_li.own_rows.jaccard
    if answer.comparison.alignment is None:
        raise Declined(answer.comparison.reason or "not aligned", {SUCCESS: 0.0} | scores)
    return {SUCCESS: right, DOUBTED: float(bool(answer.comparison.doubts))} | scores


def _against_drawn(folder: Path, answer: ComparedPair) -> dict[str, float]:
    """Score against masks drawn by hand, each side for which there are some; several raters count alike."""
    scores = {}
    for name, side in (("oct_truth", answer.oct), ("endo_truth", answer.endoscope)):
        panorama = side.panorama
        if any((folder / "truth").glob(f"{panorama.modality}*")):
            cells = segment(side, answer.parameters)
            overlaps = (jaccard(cells, drawn, panorama.valid) for drawn in truths_of(folder, panorama).values())
            if known := [overlap for overlap in overlaps if overlap is not None]:
                scores[name] = float(np.mean(known))
    if answer.comparison.alignment is not None:
        pair = answer.comparison.result.own_rows_jaccard
        scores |= {} if pair is None else {"pair_native": pair}
    return scores
