"""Sound weights of a learned eye, and sound submissions to the published benchmark."""

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import torch

from benchmarks.fuzz.trees import Seed
from endoct.fusion.segmentation.learned.network import Eye, save_eye
from endoct.workbench.bench.published.submission import read_submission, text_of

BOARD = Path(__file__).parents[2] / "docs" / "results" / "board"


def eye_seeds() -> Iterator[Seed]:
    """Yield weights that nobody trained."""
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
