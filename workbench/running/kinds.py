"""Kinds of outputs, by the names that outputs note for themselves; and an output that may not be wanted."""

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from endoct.base.files.output import new_output

PANORAMA = "panorama"
COMPARISON = "comparison"
FIGURES = "figures"
REPORT = "report"
SPECIMEN = "specimen"
SUMMARY = "summary"
BENCH_RESULTS = "bench results"
SUBMISSION = "submission"
BOARD = "board"
DATA_SET = "data set"
EXPORT = "export"
SIDECAR = "sidecar"
THUMBNAIL = "thumbnail"
POSE = "pose"
CALIBRATION = "calibration"
TUBE = "tube to print"


def output_if_any(
    output: Path | str | None, kind: str, *, overwrite: bool, inputs: Iterable[Path]
) -> AbstractContextManager[Path | None]:
    """Return the context of :func:`~endoct.base.files.output.new_output`, or one that yields None without an output."""
    if output is None:
        return nullcontext()
    return new_output(Path(output), kind, overwrite=overwrite, inputs=inputs)
