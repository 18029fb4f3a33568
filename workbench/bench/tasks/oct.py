"""The task "oct": an OCT recording unrolled, with the catheter off the axis and turning unevenly.

Specimens are simulated, small (16 slices of 512 A-scans). A method's cells are compared with the true ones on every
slice and all around, and what it does not know is wrong. No OCT recording knows the one angle that is common to all its
slices: every method gets the one that fits best.
"""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.side_cells import segment
from endoct.modalities.recognition import open_recording
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import per_frame
from endoct.stitching.store import load_panorama, save_panorama
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.workbench.bench.cases.specimens import simulated
from endoct.workbench.bench.program import read_answer, read_array, write_given
from endoct.workbench.bench.task import SUCCESS, Case, Exchange, Range, Task, draw
from endoct.workbench.pipeline.truth import Truth, load_truth, true_pose
from endoct.workbench.sides.recipes import RECIPES

CAPILLARY_MM = 1.7
GAP_MM = 0.33  # that this capillary, its glass at least 0.1 mm thick, leaves next to the largest sheath drawn
DRIFT_MM = 0.02
GOOD_ENOUGH = 0.8
RIM_REACH_RAD = 0.35  # as far as a rim may lie from the true one to count as that rim: 20°
N_NOMINAL = 256
STORE = "panorama.zarr"
N_JUDGED = 1024
"""Samples around of each slice that are judged."""
PRESET: PresetName = "learning"
RANGES: Mapping[str, Range] = {
    "off_axis": (0.0, 0.8),
    "start": ("triggered", "free"),
    "rotation_error_deg": (0.0, 8.0),
    "turn_jitter": (0.01, 0.03),
}


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> Case[Path, Truth]:
    """Return a case: a recording's folder, and the truth about it."""
    drawn = draw(seed, index, ranges)
    difficulties: dict[str, float | str] = {
        "oct.scan": "step",
        "oct.start": str(drawn["start"]),
        "oct.capillary_outer_diameter_mm": CAPILLARY_MM,
        "oct.offset_mean_mm": float(drawn["off_axis"]) * GAP_MM,
        "oct.offset_drift_mm": DRIFT_MM,
        "oct.rotation_error_peak_rad": float(np.deg2rad(float(drawn["rotation_error_deg"]))),
        "oct.turn_jitter": float(drawn["turn_jitter"]),
        "bore.bone": "phantom",
    }
    scratch = simulated(PRESET, seed, index, difficulties)
    specimen = Path(scratch.name) / "specimen"
    return Case(f"{seed}-{index}", specimen / "oct", load_truth(specimen), drawn, scratch)


def own_cases(specimen: Path) -> list[Case[Path, Truth]]:
    """Return the pullback of a simulated specimen in a folder of the user's own as a case."""
    if not (specimen / "oct").is_dir():
        raise EndoctError(f"{specimen} holds no OCT recording", expected="oct/ in it")
    truth = load_truth(specimen)
    _, stream = open_recording(specimen / "oct")
    of = {**truth.recording["oct"], "n_ascans": len(stream[0].samples)}
    truth = replace(truth, recording={**truth.recording, "oct": of})
    return [Case(specimen.name, specimen / "oct", truth, {"specimen": specimen.name})]


@dataclass(frozen=True, eq=False)
class Judged:
    """A panorama on the samples that the judge fixes, all bool (n_slices, :data:`N_JUDGED`), whatever was answered.

    ``known``: what the answer calls valid; ``cells``: its cells, False where not known; ``true``: the true cells.
    """

    known: Mask
    cells: Mask
    true: Mask


def judge(case: Case[Path, Truth], answer: object) -> dict[str, float]:
    """Score a panorama over every slice and all around; what it does not know is wrong there.

    Raises :class:`EndoctError` for an answer that is none, or none of this recording.
    """
    if not isinstance(answer, Panorama):
        raise EndoctError("that is no panorama", found=type(answer).__name__)
    on = judged_samples(case.truth, answer)
    overlap = jaccard(np.where(on.known, on.cells, ~on.true), on.true, np.ones_like(on.true))
    rims = _rim_errors_rad(on.cells, on.true, on.known)
    beams = beam_errors_rad(answer, case.truth) if "start_angle_rad" in answer.per_frame else np.full((1, 1), np.nan)
    return {
        SUCCESS: float(overlap is not None and overlap >= GOOD_ENOUGH),
        "jaccard": np.nan if overlap is None else overlap,
        "rim_deg": float(np.rad2deg(np.median(np.abs(rims)))) if rims.size else np.nan,
        "beam_deg": _rms_deg(beams),
        "within_deg": _rms_deg(beams - beams.mean(axis=1, keepdims=True)),
        "valid": float(on.known.mean()),
    }


def judged_samples(truth: Truth, answer: Panorama) -> Judged:
    """Return the cells of a panorama, and the true ones, on every slice that was recorded and all around.

    Each slice is judged where it was truly recorded, wherever the answer puts it. The common angle is the one at which
    the cells lie most on true ones. Raises :class:`EndoctError` where the rows are not one a slice.
    """
    pose = true_pose(answer, truth)
    index, of = answer.per_frame["slice_index"].values, truth.recording["oct"]
    if index.size != answer.grid.n_z or np.unique(index).size != index.size:
        raise EndoctError("the rows are not one a slice", found=f"{answer.grid.n_z} rows of {index.size} slices")
    theta = 2 * np.pi * np.arange(N_JUDGED) / N_JUDGED
    columns = np.rint((theta - answer.grid.theta0_rad) / answer.grid.dtheta_rad).astype(int) % answer.grid.n_theta
    known, cells = np.zeros((2, len(of["z_mm"]), N_JUDGED), np.bool_)
    known[index] = answer.valid[:, columns]
    cells[index] = (segment(answer) & answer.valid)[:, columns]
    z_mm, n_theta = truth.wall["z"], truth.wall["theta"].size
    places = (np.asarray(of["z_mm"]) + of.get("z_advance_mm", 0.0) / 2 - z_mm[0]) / (z_mm[1] - z_mm[0])
    rows = np.clip(np.rint(places), 0, z_mm.size - 1).astype(int)
    around = np.rint(pose.theta_bore(theta) / (2 * np.pi) * n_theta).astype(int) % n_theta
    true = np.asarray(truth.wall["cell"][np.ix_(rows, around)], np.bool_)
    spectrum = np.fft.rfft(true, axis=1) * np.conj(np.fft.rfft(cells, axis=1))
    best = int(np.argmax(np.fft.irfft(spectrum.sum(axis=0), n=N_JUDGED)))
    return Judged(known, cells, np.roll(true, -best, axis=1))


def _rms_deg(errors_rad: Coordinates) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(errors_rad**2))))


def beam_errors_rad(panorama: Panorama, truth: Truth) -> Coordinates:
    """Return by how much the beams' angles are wrong after what the panorama says it corrected, (n_slices, 256).

    A panorama says so in ``per_frame`` as :func:`endoct.workbench.unroll` does (``start_angle_rad``, ``turn_length``,
    ``rotation_harmonics_rad`` with the factors of cos a, sin a, cos 2a, …, ``lost_at_rad``). One angle common to all
    slices is taken off.
    """
    of, stated = truth.recording["oct"], {name: one.values for name, one in panorama.per_frame.items()}
    index = stated[f"{panorama.frame_dim}_index"]
    nominal = 2 * np.pi * (np.arange(N_NOMINAL) + 0.5) / N_NOMINAL
    errors = np.empty((index.size, N_NOMINAL))
    for row, i in enumerate(index):
        error = stated["start_angle_rad"][row] + (stated["turn_length"][row] - 1) * (nominal - np.pi)
        for h, (cosine, sine) in enumerate(stated["rotation_harmonics_rad"][row].reshape(-1, 2), start=1):
            error += cosine * np.cos(h * nominal) + sine * np.sin(h * nominal)
        if np.isfinite(stated["lost_at_rad"][row]):
            error += stated["lost_rad"][row] * (nominal >= stated["lost_at_rad"][row])
        errors[row] = _true_error_rad(of, int(i), nominal) - error
    common = np.angle(np.sum(np.exp(1j * errors)))
    return np.asarray(wrap_rad(errors - common))


def _true_error_rad(of: Mapping[str, Any], index: int, nominal_rad: Coordinates) -> Coordinates:
    """The true angle of beams, from A-scan 0 of a perfect turn, less the nominal one."""
    n_ascans = of.get("n_ascans", PRESETS[PRESET].n_ascans)
    position = nominal_rad / (2 * np.pi) * n_ascans
    for lost in of["lost_ascans"]:
        if lost["slice_index"] == index:
            position = position + lost["count"] * (nominal_rad / (2 * np.pi) * n_ascans >= lost["ascan"] - 0.5)
    turn = 2 * np.pi * position / n_ascans * of["turn_length"][index]
    angle = turn + of["start_angle_rad"][index]
    pairs = zip(of["rotation_error_cos_rad"][index], of["rotation_error_sin_rad"][index], strict=True)
    for h, (cosine, sine) in enumerate(pairs, 1):
        angle = angle + cosine * np.cos(h * turn) + sine * np.sin(h * turn)
    return np.asarray(angle - nominal_rad)


def _rim_errors_rad(cells: Mask, true: Mask, valid: Mask) -> Coordinates:
    """How far rims lie from the nearest true ones of the same kind in the row, rad; rims too far are left out."""
    n = cells.shape[1]
    errors = []
    for row in range(cells.shape[0]):
        for kind in (True, False):
            at = [
                np.flatnonzero((mask[row] == kind) & (np.roll(mask[row], 1) != kind) & valid[row])
                for mask in (cells, true)
            ]
            if at[0].size and at[1].size:
                apart = wrap_rad((at[0][:, None] - at[1][None, :]) * (2 * np.pi / n))
                errors.append(apart[np.arange(at[0].size), np.argmin(np.abs(apart), axis=1)])
    every = np.concatenate(errors) if errors else np.empty(0)
    return np.asarray(every[np.abs(every) < RIM_REACH_RAD])


def _write_recording(recording: Path, folder: Path) -> None:
    copy = shutil.copytree(recording, folder / "recording")  # the truth lies beside the original
    write_given(folder, {"recording": str(copy.absolute())})


def _read_panorama(recording: Path, folder: Path) -> Panorama:
    """Return the answer of a program as a panorama of the recording."""
    if (folder / STORE).is_dir():
        return load_panorama(folder / STORE)
    _, stream = open_recording(recording)
    sidecar, answer = stream.acquisition.model_dump(), read_answer(folder)
    depth = read_array(folder, "depth_mm").astype(np.float32)
    z_mm = np.asarray(answer.get("slice_z_mm", []), np.float64)
    index = np.asarray(answer.get("slice_index", []), np.int64)
    if depth.ndim != 2 or not z_mm.shape == index.shape == depth.shape[:1] or not (np.diff(z_mm) > 0).all():
        raise EndoctError("the answer is no panorama", expected="a row of depth_mm.npy a slice, z ascending")
    known = np.isfinite(depth)
    step_mm = float(np.median(np.diff(z_mm))) if z_mm.size > 1 else 1.0
    grid = SurfaceGrid.full_circle(
        *depth.shape, z0_mm=z_mm[0], dz_mm=step_mm, radius_mm=float(sidecar["bore_diameter_mm"]) / 2
    ).with_rows(z_mm)
    return Panorama(
        grid=grid,
        intensity=np.zeros_like(depth),
        depth_mm=np.where(known, depth, 0.0),
        valid=known,
        weight=known.astype(np.float32),
        modality="oct",
        handedness_known=sidecar["handedness"] != "unknown",
        travel_known=sidecar["travel"] != "unknown",
        frame_dim="slice",
        per_frame=per_frame({"slice_index": index, "slice_z_mm": z_mm}, {}),
        provenance={"acquisition": sidecar},
    )


TASK = Task(
    name="oct",
    title="an OCT recording unrolled, the catheter off its axis and turning unevenly",
    signature=(
        "method(recording: pathlib.Path) -> endoct.stitching.panorama.Panorama: the folder of a pullback "
        "(pullback.tif and acquisition.toml) unrolled, with depth_mm, one row a slice, per_frame with slice_index and "
        "slice_z_mm. θ may be off by one angle common to all slices."
    ),
    cases=cases,
    judge=judge,
    ranges=RANGES,
    scores={
        "jaccard": "Jaccard index of the cells against the true ones, every slice, wrong where not known",
        "rim_deg": "rims of cells, median distance from the true ones, degrees",
        "beam_deg": "angle of beams, rms error after what was corrected, degrees",
        "within_deg": "the same within turns, the mean of each slice taken off, degrees",
        "valid": "share of the judged samples called valid",
    },
    own=own_cases,
    against="endoct",
    exchange=Exchange(
        write=_write_recording,
        read=_read_panorama,
        answer=lambda answer, folder: save_panorama(answer, folder / STORE),
    ),
    success=f"a Jaccard index of at least {GOOD_ENOUGH:g}, what is not known counted as wrong",
)


def _unrolled(**settings: object) -> Callable[[Path], Panorama]:
    """Return the method that unrolls as `endoct unroll` does, with ``settings``."""

    def method(recording: Path) -> Panorama:
        from endoct.workbench.api import unroll

        return unroll(recording, settings=settings)

    return method


EVEN_TURNS = {f"correct_{step}": False for step in ("rotation", "turn_length", "start_angle", "lost_ascans")}
ours = _unrolled()
without_rotation = _unrolled(correct_rotation=False)
without_turn_length = _unrolled(correct_turn_length=False)
without_start_angle = _unrolled(correct_start_angle=False)
without_lost_ascans = _unrolled(correct_lost_ascans=False)
even = _unrolled(**EVEN_TURNS)
sine = _unrolled(undistort="sine")
# Laves 2019, with our wall, and as published: the brightest sample for the wall
sine_even = _unrolled(**EVEN_TURNS, undistort="sine")
literal = _unrolled(**RECIPES["paper"]["oct"])
brightest = _unrolled(**EVEN_TURNS, wall="maximum")
