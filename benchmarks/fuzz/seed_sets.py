"""Sound data sets in both formats, their records, and samples to replay."""

import csv
import hashlib
import io
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.fuzz.archives import tarred
from benchmarks.fuzz.seed_recordings import ENDOSCOPE_TOML, OCT_TOML, image, noise, npy, tiff
from benchmarks.fuzz.seed_results import write_wall
from benchmarks.fuzz.trees import Seed, read_tree
from endoct.synthetic.draw import draw
from endoct.workbench.dataset.identity import write_identity
from endoct.workbench.dataset.plan import DatasetPlan, Unit, job, split_of, units

FOLDERS = DatasetPlan(2, preset="learning", seed=3)
SHARDS = DatasetPlan(2, preset="learning", seed=3, format="webdataset", specimens_per_shard=2)


def plan_of(root: Path) -> DatasetPlan:
    """Return the plan that a data set of this module was made by, by what lies in it."""
    return SHARDS if (root / "shards").is_dir() else FOLDERS


def set_seeds() -> Iterator[Seed]:
    """Yield finished data sets of two specimens."""
    specimen = _specimen()
    folders = {f"specimens/{k:06d}/{name}": data for k in range(2) for name, data in specimen.items()}
    yield Seed("data set of folders", "", _whole(FOLDERS, folders))
    arrays = {
        "oct.npy": noise(2, 8, 6), "endoscope.npy": noise(2, 6, 8, 3), "relief_mm.npy": noise(10, 16).astype("f4"),
        "cell.npy": noise(10, 16) > 99, "cell_id.npy": noise(10, 16).astype("i4"),
    }  # fmt: skip
    members = [(f"{k:06d}.{name}", npy(array)) for k in range(2) for name, array in arrays.items()]
    members += [(f"{k:06d}.sample.json", b"{}") for k in range(2)]
    yield Seed("data set of shards", "", _whole(SHARDS, {"shards/train-000000.tar": tarred(members)}))


def record_seeds() -> Iterator[Seed]:
    """Yield what a data set says of itself, without its specimens."""
    for seed in set_seeds():
        kept = {name: data for name, data in seed.files.items() if not name.startswith("specimens")}
        yield Seed(f"records, {seed.name}", "", kept)


def sample_seeds() -> Iterator[Seed]:
    """Yield samples as the simulator writes them, their long lists cut short and as they are."""
    for number in (0, 4):
        sample = draw("quick", number)
        keys = json.loads(sample.model_dump_json())
        keys["bore"]["cells"] = keys["bore"]["cells"][:2]
        yield Seed(f"sample {number}", "sample.json", {"sample.json": json.dumps(keys).encode()})


def _specimen() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "truth").mkdir()
        write_wall(folder / "truth" / "wall.zarr")
        write_wall(folder / "truth" / "labels" / "oct.zarr")
        files = read_tree(folder)
    files |= {f"endoscope/frame_{k:04d}.png": image(noise(6, 8, seed=k)) for k in range(2)}
    files |= {"oct/acquisition.toml": OCT_TOML.encode(), "endoscope/acquisition.toml": ENDOSCOPE_TOML.encode()}
    return files | {"oct/pullback.tif": tiff(noise(2, 8, 6))}


def _whole(plan: DatasetPlan, files: dict[str, bytes]) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        write_identity(Path(folder), plan)
        identity = (Path(folder) / "dataset.json").read_bytes()
    found = {"dataset.json": identity, **files}
    rows: list[dict[str, Any]] = []
    for unit in units(plan):
        found[f"records/{unit.name}.json"] = json.dumps(_record(plan, unit, files)).encode()
        for index in unit.indices:
            this = job(plan, index)
            rows.append({
                "index": index, "name": this.name, "split": split_of(plan, index), "seed": this.seed,
                "bore": this.bore, "bore_seed": this.bore_seed, "digest": "ab" * 32, "path": unit.place.as_posix(),
                "bore.bone": "phantom", "bore.length_mm": 2.0, "oct.wall_db": 12.5, "oct.states_handedness": "true",
            })  # fmt: skip
    table = io.StringIO()
    writer = csv.DictWriter(table, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return found | {"manifest.csv": table.getvalue().encode()}


def _record(plan: DatasetPlan, unit: Unit, files: dict[str, bytes]) -> dict[str, Any]:
    place = unit.place.as_posix()
    mine = {name: data for name, data in files.items() if name.startswith(place)}
    drawn = {"digest": "ab" * 32, "parameters": {"oct.wall_db": 12.5}}
    specimens = [
        {"index": this.index, "seed": this.seed, "bore_seed": this.bore_seed, **drawn}
        for this in (job(plan, index) for index in unit.indices)
    ]
    below = len(place) + 1
    digests = {
        name[below:] or unit.place.name: (len(data), hashlib.sha256(data).hexdigest()) for name, data in mine.items()
    }
    return {"specimens": specimens, "files": digests, "seconds": 1.5}
