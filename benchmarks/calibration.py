"""How right a calibration by a printed tube is, and whether its standard errors are.

    python -m benchmarks.calibration --count 40 [--seed 1000] [--independent] [-o DIR]

Simulates tubes (preset `tube`, or with --independent drawn by means that share nothing with the simulator), calibrates
by both recordings, and compares with the truth: error, error over standard error, and how many lie within two of them.
With -o specimens and the table are kept there, and what is there already is used.
"""

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.independent.tube import independent_truth, write_tube_pair
from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.specimen import simulate
from endoct.workbench.calibrating.calibration import calibrate

Truth = dict[str, dict[str, float | str]]
ANGLES = ("theta_origin_rad",)


def simulated_truth(folder: Path) -> Truth:
    """Return the truth of a simulated tube by modality and quantity, with words for what is no number."""
    sample = Sample.model_validate_json((folder / "truth/sample.json").read_text())
    oct_, camera, tube = sample.oct, sample.endoscope, sample.bore.tube
    assert tube is not None
    slices = np.polyfit(np.arange(len(oct_.z_mm)), np.sort(oct_.z_mm), 1)[0]
    cone = ConeOptics(
        camera.inner_px,
        camera.outer_px,
        math.radians(camera.half_angle_deg),
        camera.focal_px,
        camera.mirror_distance_mm,
        sample.bore.diameter_mm / 2,
        (camera.distortion_k1,),
    )
    first = int(np.argmin(camera.z_mm))
    feeds = np.polyfit(np.arange(len(camera.z_mm)), camera.z_mm, 1)[0]
    return {
        "oct": {
            "axial_pixel_mm": oct_.axial_pixel_mm,
            "first_sample_mm": oct_.first_sample_mm,
            "theta_origin_rad": oct_.theta_origin_rad + oct_.sense * float(np.mean(oct_.start_angle_rad)),
            "pullback_pitch_mm": float(slices),
            "handedness": "same" if oct_.sense > 0 else "mirrored",
            "travel": oct_.travel,
        },
        "endoscope": optics_truth(cone)
        | {
            "theta_origin_rad": camera.roll_rad[first],
            "feed_pitch_mm": abs(float(feeds)),
            "travel": camera.travel,
            "outer_rim": "ahead",
        },
    }


def optics_truth(cone: ConeOptics) -> dict[str, float | str]:
    """Return the true quantities of an endoscope's optics, between the rims."""
    middle = (cone.inner_px + cone.outer_px) / 2
    slant = np.degrees(np.arctan(cone.slant(np.array([cone.inner_px, middle, cone.outer_px]))))
    return {
        "mm_per_px": abs(float(np.diff(cone.z_mm(middle + np.array([-0.5, 0.5])))[0])),
        "visible_length_mm": cone.visible_length_mm,
        "slant_inner_deg": float(slant[0]),
        "slant_deg": float(slant[1]),
        "slant_outer_deg": float(slant[2]),
        "cone_half_angle_deg": math.degrees(cone.half_angle_rad),
        "focal_px": cone.focal_px,
        "mirror_distance_mm": cone.mirror_distance_mm,
        "distortion": cone.distortion[0] if cone.distortion else 0.0,
    }


def judged(folder: Path, truth: Truth, seed: int) -> list[dict[str, object]]:
    """Return a row for each quantity of both calibrations of a specimen."""
    rows: list[dict[str, object]] = []
    for modality, true in truth.items():
        row: dict[str, object] = {"seed": seed, "modality": modality}
        with tempfile.TemporaryDirectory() as scratch:
            try:
                measured = calibrate(
                    modality,
                    folder / modality,
                    target=folder / "tube.toml",
                    output=Path(scratch) / "calibration.toml",
                    progress=False,
                )
            except EndoctError as error:
                rows.append(row | {"quantity": "refused", "reason": str(error)})
                continue
        for each in measured.quantities:
            if each.name in true:
                value = float(true[each.name])
                off = each.value - value
                if each.name in ANGLES:
                    off = math.remainder(off, 2 * math.pi)
                rows.append(
                    row
                    | {"quantity": each.name, "value": each.value, "true": value, "error": off}
                    | {
                        "sigma": each.sigma,
                        "sigmas": off / each.sigma,
                        "doubts": " ".join(d.code for d in measured.doubts),
                    }
                )
        for name, word in true.items():
            if isinstance(word, str):
                rows.append(row | {"quantity": name, "right": measured.keys.get(name) == word})
    return rows


def summary(table: pd.DataFrame) -> str:
    """Return the errors of every quantity, and how many lie within two standard errors."""
    lines = []
    for (modality, quantity), rows in table.groupby(["modality", "quantity"], sort=False):
        if quantity == "refused":
            lines.append(f"{modality} refused {len(rows)}: {'; '.join(sorted(set(rows['reason'])))[:400]}")
        elif "error" not in rows or rows["error"].isna().all():
            lines.append(f"{modality} {quantity}: right in {int(rows['right'].sum())} of {len(rows)}")
        else:
            error, sigmas, relative = rows["error"], rows["sigmas"], 100 * rows["error"] / rows["true"].abs()
            size = error.abs()
            within, rms = int((sigmas.abs() <= 2).sum()), float(np.sqrt((sigmas**2).mean()))
            lines.append(
                f"{modality} {quantity}: error mean {error.mean():+.3g}, median {error.median():+.3g}, median size "
                f"{size.median():.3g}, worst {size.max():.3g}; in % mean {relative.mean():+.2f}, median size "
                f"{relative.abs().median():.2f}, worst {relative.abs().max():.2f}; "
                f"σ median {rows['sigma'].median():.3g}; rms {rms:.2f} σ; within 2σ {within} of {len(rows)}"
            )
    return "\n".join(lines)


def made(folder: Path, seed: int, independent: bool) -> Truth:
    """Return the truth of the specimen in ``folder``, which is made where it is not there."""
    if independent:
        if not folder.exists():
            write_tube_pair(folder, seed)
        return independent_truth(folder)
    if not folder.exists():
        simulate(folder, preset="tube", seed=seed, workers=1)
    return simulated_truth(folder)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1000, help="the first seed")
    parser.add_argument("--independent", action="store_true", help="recordings drawn without the simulator")
    parser.add_argument("--only", choices=("oct", "endoscope"))
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(options.seed, options.seed + options.count):
            folder = (options.output or Path(scratch)) / f"r{seed}"
            truth = made(folder, seed, options.independent)
            if options.only:
                truth = {options.only: truth[options.only]}
            rows += judged(folder, truth, seed)
            for row in rows[-40:]:
                if row["seed"] == seed and "error" in row:
                    print(
                        f"{seed} {row['modality']} {row['quantity']} {row['error']:+.4g} ({row['sigmas']:+.1f} σ)",
                        flush=True,
                    )
            table = pd.DataFrame(rows)
            if options.output:
                table.to_csv(
                    options.output / ("independent.csv" if options.independent else "calibration.csv"), index=False
                )
    print(summary(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
