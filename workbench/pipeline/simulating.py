"""A specimen from the command line or from Python, without loading what only comparing takes."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import read_small
from endoct.stitching.output import new_output
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.sample.ranges import NO_RANGES, Range
from endoct.synthetic.specimen import simulate as render
from endoct.workbench.running.display import stages_for
from endoct.workbench.running.kinds import SPECIMEN
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.threads import one_blas_thread

MOST_SAMPLE_BYTES = 16_000_000
"""Of a sample.json; usual ones have under 1 MB, and what is read takes many times its size."""


@one_blas_thread()
def simulate(
    output: Path | str,
    *,
    preset: PresetName = "quick",
    seed: int = 0,
    replay: Path | str | None = None,
    vary: Mapping[str, Range] | None = None,
    labels: bool = False,
    spectra: bool = False,
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> None:
    """Simulate a specimen: both recordings of one bore, with truth, in the folder ``output``.

    ``replay`` is the ``truth/sample.json`` of an earlier specimen, made again to the byte. ``vary`` says what
    parameters are drawn from, "part.name" → (low, high) or words, where not by the preset. ``labels`` adds
    truth/labels, for training networks; ``spectra`` the spectrometer's raw data; ``progress=False`` displays none.
    Raises :class:`EndoctError` for a parameter that there is not or a range that cannot be, and where ``output``
    exists and ``overwrite`` is not set.

    >>> from endoct.workbench import simulate
    >>> simulate("specimen", preset="learning", seed=7, vary={"oct.wall_db": (12.0, 14.0)})
    >>> import pathlib
    >>> sorted(folder.name for folder in pathlib.Path("specimen").glob("*/"))
    ['endoscope', 'oct', 'truth']
    """
    stages = stages_for(progress)
    sample = _read_json(Path(replay)) if replay is not None else None
    inputs = [] if replay is None else [Path(replay)]
    with (
        new_output(Path(output), SPECIMEN, overwrite=overwrite, inputs=inputs) as scratch,
        stages.stage(f"simulate {preset}") as advance,
    ):
        render(
            scratch,
            preset=preset,
            seed=seed,
            ranges=vary or NO_RANGES,
            sample=sample,
            labels=labels,
            spectra=spectra,
            on_progress=lambda _, share: advance(share),
        )


def _read_json(path: Path) -> Mapping[str, Any]:
    data = read_small(path, MOST_SAMPLE_BYTES)
    with refusing(f"{path} cannot be read", expected="a truth/sample.json"):
        sample = json.loads(data)
    if not isinstance(sample, dict):
        raise EndoctError(f"{path} is no sample", expected="a truth/sample.json")
    return sample
