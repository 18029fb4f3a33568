"""The truth about a pair of the second generator in the layout of simulated specimens."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.independent.bore import STEP_MM, Floats
from benchmarks.independent.pair import Pair
from endoct.base.zarr.zarr_store import Named, write_arrays

N_HARMONICS = 3


@dataclass(frozen=True, eq=False)
class Turns:
    """How the catheter turned in each slice, in the order recorded.

    ``start_rad`` and ``length`` (n,); ``cosines_rad`` and ``sines_rad`` (n, 3), the harmonics of the rotation error.
    """

    start_rad: Floats
    length: Floats
    cosines_rad: Floats
    sines_rad: Floats

    def angles_rad(self, n_ascans: int) -> Floats:
        """Return by how much each A-scan of each slice is turned from the pullback's θ = 0, (n, n_ascans)."""
        turn = 2 * np.pi * np.arange(n_ascans) / n_ascans * self.length[:, np.newaxis]
        angles = turn + self.start_rad[:, np.newaxis]
        for h in range(N_HARMONICS):
            angles = angles + self.cosines_rad[:, h, np.newaxis] * np.cos((h + 1) * turn)
            angles = angles + self.sines_rad[:, h, np.newaxis] * np.sin((h + 1) * turn)
        return np.asarray(angles)


def even_turns(n_slices: int) -> Turns:
    """Return turns without any error."""
    nothing = np.zeros((n_slices, N_HARMONICS))
    return Turns(np.zeros(n_slices), np.ones(n_slices), nothing, nothing)


def write_truth(
    folder: Path, pair: Pair, turns: Turns, sample: dict[str, object], world: dict[str, object] | None = None
) -> None:
    """Write ``wall.zarr``, ``recording.json`` and ``sample.json``; ``world``: where the bore lies in a patient."""
    folder.mkdir()
    _write_wall(folder / "wall.zarr", pair)
    facts = recording(pair, turns) | ({} if world is None else {"world": world})
    for name, content in (("recording.json", facts), ("sample.json", sample)):
        (folder / name).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def recording(pair: Pair, turns: Turns) -> dict[str, object]:
    """Return how both recordings were made, as :func:`endoct.synthetic.truth.recording` says."""
    catheter, mirror, journey = pair.recipe.oct, pair.recipe.endoscope, pair.endoscope
    low_mm, high_mm = journey.optics.band_mm
    middle_mm = (low_mm + high_mm) / 2 * (1 if mirror.ahead else -1)
    return {
        "bore_radius_mm": pair.bore.radius_mm,
        "oct": {
            "theta_origin_rad": catheter.start_rad,
            "theta_sense": -1 if catheter.mirrored else 1,
            "handedness": "mirrored" if catheter.mirrored else "same",
            "travel": catheter.travel,
            "z_origin_mm": float(pair.oct.z_mm.min()),
            "z_mm": pair.oct.z_mm.tolist(),
            "z_advance_mm": 0.0,
            "offset_mm": np.hypot(*pair.oct.offset_mm.T).tolist(),
            "offset_direction_rad": np.arctan2(*pair.oct.offset_mm.T[::-1]).tolist(),
            "start_angle_rad": turns.start_rad.tolist(),
            "turn_length": turns.length.tolist(),
            "lost_ascans": [],
            "rotation_error_cos_rad": turns.cosines_rad.tolist(),
            "rotation_error_sin_rad": turns.sines_rad.tolist(),
        },
        "endoscope": {
            "theta_sense": 1,
            "travel": mirror.travel,
            "z_mm": (journey.apex_mm + middle_mm).tolist(),
            "roll_rad": (mirror.start_rad + journey.roll_rad).tolist(),
            "centre_px": journey.optics.centre_px,
            "inner_px": journey.optics.inner_px,
            "outer_px": mirror.outer_px,
        },
    }


def _write_wall(path: Path, pair: Pair) -> None:
    bore, surface = pair.bore, ("z", "theta")
    cell = bore.level < 1
    whole = cell.shape
    n_z, n_theta = whole
    arrays = {
        "relief_mm": Named(surface, bore.relief_mm.astype(np.float32), {"units": "mm"}, whole),
        "cell": Named(surface, cell, {"long_name": "the surface at the bore's radius is missing"}, whole),
        "cell_id": Named(surface, np.where(cell, bore.number + 1, 0).astype(np.int32), {}, whole),
        "z": Named(("z",), STEP_MM * np.arange(n_z), {"units": "mm"}),
        "theta": Named(("theta",), 2 * np.pi / n_theta * np.arange(n_theta), {"units": "rad"}),
    }
    write_arrays(path, arrays, {"bore_radius_mm": bore.radius_mm})
