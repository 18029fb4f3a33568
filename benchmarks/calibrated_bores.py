"""What a calibration by a printed tube is worth in a bore: places along it, the pair's agreement, and its budget.

    python -m benchmarks.calibrated_bores --seed 1300 --count 8 [--csv FILE]

Simulates a tube (preset ``tube``), calibrates both instruments by it, and has the same instruments record a bore with
the cells of preset ``quick``. The bore is compared once with what the tube's sidecars state, which is rough, and once
with the calibrations cited. A row a bore and way, as of ``benchmarks/budget.py``, with the Jaccard index on the OCT's
rows and the error of each side's scale along z.
"""

import argparse
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import tomlkit

sys.path.insert(0, str(Path(__file__).parent))

from budget import evaluate
from panoramas import SIDES, unrolled

from endoct.base.errors import EndoctError
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.specimen import simulate
from endoct.workbench.calibrating.calibration import calibrate
from endoct.workbench.pipeline.truth import load_truth, true_pose

SIDECAR = "acquisition.toml"
Row = dict[str, float | str]


def bore_of_the_same_instruments(tube: Path, folder: Path, seed: int) -> None:
    """Record a bore with the cells of ``quick`` by the instruments that recorded ``tube``."""
    sample = Sample.model_validate_json((tube / "truth/sample.json").read_text())
    bore = draw("quick", seed).bore.model_copy(update={"diameter_mm": sample.bore.diameter_mm})
    simulate(folder, sample=sample.model_copy(update={"bore": bore}).model_dump(mode="json"), workers=1)


def state(recording: Path, stated: dict[str, object], calibration: Path | None) -> None:
    """Write a sidecar: ``stated``, or what a calibration does not say of it, and the calibration."""
    if calibration is not None:
        known = tomllib.loads(calibration.read_text(encoding="utf-8"))
        for table in (known, known["standard_errors"]):
            table.pop("theta_origin_rad", None)  # the truth of the bore counts from where the recording starts
        (recording / calibration.name).write_text(tomlkit.dumps(known), encoding="utf-8")
        stated = {name: value for name, value in stated.items() if name not in known}
        stated["calibration"] = calibration.name
    (recording / SIDECAR).write_text(tomlkit.dumps(stated), encoding="utf-8")


def scale_error(specimen: Path, side: str, cache: Path) -> float:
    """Return by how much a side's panorama is too long, in percent."""
    panorama, truth = unrolled(specimen, side, cache), load_truth(specimen)
    z_mm = panorama.z_mm[np.isfinite(true_pose(panorama, truth).z_bore(panorama.z_mm))]
    true_mm = true_pose(panorama, truth).z_bore(z_mm)
    return 100 * (1 / abs(float(np.polyfit(z_mm, true_mm, 1)[0])) - 1)


def judged(seed: int, folder: Path) -> list[Row]:
    """Return a row for a bore without calibrations, and one with them."""
    tube, bore = folder / "tube", folder / "bore"
    simulate(tube, preset="tube", seed=seed, workers=1)
    bore_of_the_same_instruments(tube, bore, seed)
    rows: list[Row] = []
    for way in ("stated", "calibrated"):
        for side in SIDES:
            stated = tomllib.loads((tube / side / SIDECAR).read_text(encoding="utf-8"))
            calibration = None
            if way == "calibrated":
                calibration = folder / f"{side}-calibration.toml"
                calibrate(side, tube / side, target=tube / "tube.toml", output=calibration, progress=False)
            state(bore / side, stated, calibration)
        cache = folder / way
        row: Row = {"seed": seed, "way": way, **evaluate(bore, cache)}
        row |= {f"scale_{side}_percent": scale_error(bore, side, cache) for side in SIDES}
        rows.append(row)
    return rows


def main() -> None:
    """Judge the bores and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1300)
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    rows: list[Row] = []
    for seed in range(options.seed, options.seed + options.count):
        with tempfile.TemporaryDirectory() as scratch:
            try:
                rows += judged(seed, Path(scratch))
            except EndoctError as error:
                rows.append({"seed": seed, "way": f"refused: {error}"})
        for row in rows[-2:]:
            print("  ".join(f"{k}={v:.3f}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items()), flush=True)
        if options.csv:
            pd.DataFrame(rows).to_csv(options.csv, index=False)
    table = pd.DataFrame(rows)
    numbers = table.select_dtypes("number").drop(columns="seed").abs()
    print(numbers.groupby(table["way"]).agg(["median", "mean"]).T.to_string())


if __name__ == "__main__":
    main()
