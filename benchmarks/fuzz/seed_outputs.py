"""Sound outputs that say of themselves what they hold, what a stopped run of the bench leaves, weights, submissions."""

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.fuzz.seed_results import panorama
from benchmarks.fuzz.seed_sets import set_seeds
from benchmarks.fuzz.trees import Seed, read_tree
from endoct.base.files.output import new_output
from endoct.stitching.store import save_panorama
from endoct.workbench.bench.checkpoint import open_checkpoint
from endoct.workbench.bench.published.submission import read_submission, text_of
from endoct.workbench.bench.runner import BenchPlan, MethodResult

BOARD = Path(__file__).parents[2] / "docs" / "results" / "board"
KIND = "panorama"
PLAN = BenchPlan("segmentation", ("endoct", "otsu"), seeds=(1, 2))


def output_seeds() -> Iterator[Seed]:
    """Yield an output of endoct, one with another in it, and data sets."""
    for nested in (False, True):
        with tempfile.TemporaryDirectory() as scratch:
            root = Path(scratch)
            with new_output(root / "out", KIND) as made:
                save_panorama(panorama(), made)
                if nested:
                    with new_output(made / "figures", "figures") as inner:
                        inner.mkdir()
                        (inner / "a.png").write_bytes(b"a figure")
            yield Seed(f"output, {'with' if nested else 'without'} a part", "out", read_tree(root))
    for seed in set_seeds():
        files = {f"out/{name}": data for name, data in seed.files.items()}
        yield Seed(seed.name, "out", files)


def unfinished_seeds() -> Iterator[Seed]:
    """Yield the checkpoint of a run of the bench."""
    with tempfile.TemporaryDirectory() as scratch:
        checkpoint = open_checkpoint(Path(scratch) / "results", PLAN, overwrite=False)
        for place in range(2):
            row = MethodResult(
                f"case {place}", "otsu", "ok", "", 0.5, 0.4, {"cell_mm": 0.5, "oct.scan": "step"}, {"jaccard": 0.7}
            )
            checkpoint.save(place, [row, MethodResult("case", "endoct", "failed", "it raised", 0.1, 0.1, {}, {})])
        yield Seed("unfinished", "", read_tree(Path(scratch)))


def eye_seeds() -> Iterator[Seed]:
    """Yield weights that nobody trained."""
    import torch

    from endoct.fusion.segmentation.learned.network import Eye, save_eye

    torch.manual_seed(1)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "eye.safetensors"
        save_eye(Eye(), path, {"modality": "endoscope"})
        yield Seed("weights", path.name, {path.name: path.read_bytes()})


def submission_seeds() -> Iterator[Seed]:
    """Yield a submission of two methods."""
    whole = read_submission(BOARD / "pose.json")
    methods = dict([*whole.methods.items()][:2])
    rows = tuple(row for row in whole.rows if row.method in methods)
    text = text_of(whole.model_copy(update={"methods": methods, "rows": rows}))
    yield Seed("submission", "", {"pose.json": json.dumps(json.loads(text)).encode()})
