"""The rims of the mirror's ring against truth, and which recordings of an endoscope are doubted.

    python -m benchmarks.rims --set dark --count 24 [--seed 0] [--keep DIR] [--workers 2]

Sets of the simulator are its presets, and `dark`: `quick` at 0.07 to 0.6 of the exposure that a person would set. Sets
of the independent generator are its own, and its faults on its set of mirrors; `far_end` is the last three frames of
`far_rim`, in which the end of the bore moves through the ring, `still` one frame over and over, `single` one. No
sidecar states the ring.
Errors are parts of the outer rim's radius, which counts rows. With --keep recordings stay there and are used again.
"""

import argparse
import json
import os
import shutil
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.independent.bore import drill
from benchmarks.independent.mirror import travel
from benchmarks.independent.pair import endoscope_sidecar
from benchmarks.independent.sets import MIRROR_FAULTS, recipe_of
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import render_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.specimen_files import endoscope_sidecar as simulated_sidecar
from endoct.workbench import unroll

PRESETS = ("quick", "hard", "mastoid", "learning", "dark")
DARK = {"endoscope.exposure": (0.07, 0.6)}
INDEPENDENT = ("mirrors", "few", "dim", "sound", "many")
PARTS = {"far_end": slice(-3, None), "still": [10] * 12, "single": [10]}
"""Which frames of a recording to take."""
WRONG = 0.03
"""Of the outer rim's radius: a rim or centre that is farther off is wrong."""

Row = dict[str, object]


def record(name: str, seed: int, folder: Path) -> None:
    """Write the recording of a set and a seed, its sidecar and where its rims lie; ``folder`` must not exist."""
    making = folder.with_name(folder.name + ".part")
    shutil.rmtree(making, ignore_errors=True)
    making.mkdir(parents=True)
    frames, keys, truth = _simulated(name, seed) if name in PRESETS else _independent(name, seed)
    for k, frame in enumerate(frames):
        image = frame[..., ::-1] if frame.ndim == 3 else frame
        cv2.imwrite(str(making / f"frame_{k:04d}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    keys.pop("annulus", None)
    (making / "acquisition.toml").write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items()))
    making.rename(folder)
    folder.with_suffix(".json").write_text(json.dumps(truth))


def _simulated(name: str, seed: int) -> tuple[list[NDArray[np.uint8]], dict[str, object], dict[str, object]]:
    preset, ranges = ("quick", DARK) if name == "dark" else (name, {})
    sample = draw(preset, seed, ranges=ranges)  # type: ignore[arg-type]
    camera, maps = sample.endoscope, build_wall(sample).maps()
    lighting = lighting_of(sample, maps)
    frames = [render_frame(sample, maps, lighting, k) for k in range(len(camera.z_mm))]
    outer = np.array(camera.centre_px)
    truth: dict[str, object] = {
        "inner": camera.inner_px,
        "outer": camera.outer_px,
        "inner_centres": (outer + camera.inner_shift_px).tolist(),
        "outer_centres": outer.tolist(),
        "exposure": camera.exposure,
    }
    return frames, dict(simulated_sidecar(sample)), truth


def _independent(name: str, seed: int) -> tuple[list[NDArray[np.uint8]], dict[str, object], dict[str, object]]:
    fault = "far_rim" if name == "far_end" else name if name in MIRROR_FAULTS else None
    recipe = recipe_of(name if name in INDEPENDENT else "mirrors", seed)
    aspect = (1.1, 0.9)[seed % 2] if name == "non_square" else 1.0
    recipe = replace(recipe, endoscope=replace(recipe.endoscope, fault=fault, aspect=aspect))
    bore = drill(recipe.bore, np.random.default_rng([seed, 0]))
    journey = travel(bore, recipe.endoscope, np.random.default_rng([seed, 2]))
    optics, e, frames = journey.optics, recipe.endoscope, journey.frames[PARTS.get(name, slice(None))]
    truth: dict[str, object] = {
        "inner": optics.inner_px,
        "outer": e.outer_px,
        "inner_centres": [optics.rims_px[0].tolist()] * len(frames),
        "outer_centres": [optics.rims_px[1].tolist()] * len(frames),
        "exposure": e.exposure,
    }
    return list(frames), endoscope_sidecar(e, journey, recipe.bore.diameter_mm), truth


def judged(name: str, keep: Path | None, seed: int) -> Row:
    """Return what endoct says of one recording, against truth."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = (keep or Path(scratch)) / f"{name}-{seed}"
        if not folder.exists():
            record(name, seed, folder)
        truth = json.loads(folder.with_suffix(".json").read_text())
        row: Row = {"set": name, "seed": seed, "exposure": truth["exposure"]}
        try:
            panorama = unroll(folder, progress=False)
        except EndoctError as error:
            return row | {"refused": str(error).splitlines()[0]}
        # a panorama has its frames by z, truth as they were recorded, inwards or outwards
        found = {key: np.asarray(of.values) for key, of in panorama.per_frame.items()}
        row["doubts"] = [doubt.code for doubt in panorama.doubts]
        row["valid"] = float(panorama.valid.mean())
        outer_px = truth["outer"]
        for rim, prefix in (("inner", "annulus_inner"), ("outer", "annulus")):
            radius = found[f"annulus_{rim}_px"] - truth[rim]
            centre, true = np.stack([found[f"{prefix}_{c}_px"] for c in "xy"], 1), np.array(truth[f"{rim}_centres"])
            off_px = min(float(np.median(np.hypot(*(centre - at).T))) for at in (true, true[::-1]))
            row[f"{rim}_radius"], row[f"{rim}_centre"] = float(np.median(radius)) / outer_px, off_px / outer_px
        row["wrong"] = max(abs(row[k]) for k in ERRORS) > WRONG  # type: ignore[arg-type]
        return row


ERRORS = ("inner_radius", "outer_radius", "inner_centre", "outer_centre")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rims", description=__doc__)
    parser.add_argument("--set", nargs="+", choices=(*PRESETS, *INDEPENDENT, *MIRROR_FAULTS, *PARTS), default=["dark"])
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(options.workers) as pool:
        for name in options.set:
            rows = []
            for row in pool.map(partial(judged, name, options.keep), range(options.seed, options.seed + options.count)):
                rows.append(row)
                print(_line(row), flush=True)
            print(_summary(name, rows), flush=True)


def _line(row: Row) -> str:
    start = f"{row['set']:10} {row['seed']:5} exposure {row['exposure']:.2f} "
    if "refused" in row:
        return f"{start} refused: {row['refused']}"
    errors = " ".join(f"{key} {row[key]:+.4f}" for key in ERRORS)
    said = ", ".join(row["doubts"]) or "-"  # type: ignore[arg-type]
    return f"{start} {errors} valid {row['valid']:.2f} {'WRONG' if row['wrong'] else '     '} {said}"


def _summary(name: str, rows: list[Row]) -> str:
    answered = [row for row in rows if "refused" not in row]
    wrong = [row for row in answered if row["wrong"]]
    silent = [row["seed"] for row in wrong if not row["doubts"]]
    sound = [row for row in answered if not row["wrong"]]
    doubted = [row["seed"] for row in sound if row["doubts"]]
    worst = {key: f"{np.median([abs(row[key]) for row in answered]):.4f}" for key in ERRORS} if answered else {}  # type: ignore[arg-type]
    return (
        f"{name}: {len(rows)} recordings, {len(rows) - len(answered)} refused; rims wrong in {len(wrong)}, of these in "
        f"silence {silent}; rims right in {len(sound)}, of these doubted {doubted}; median errors {worst}"
    )


if __name__ == "__main__":
    main()
