"""The public Python interface: what the command line does, as functions."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from endoct.fusion.comparison import CompareParameters
from endoct.fusion.sides import Comparison
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, check_place, new_output, remove_output
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.pipeline.comparing import Side, write_comparison
from endoct.workbench.pipeline.simulating import simulate
from endoct.workbench.pipeline.summarising import summarise as _summarise
from endoct.workbench.pipeline.summarising import write_summary
from endoct.workbench.pipeline.unrolling import open_side, unroll_recording, write_volume
from endoct.workbench.running.kinds import COMPARISON, PANORAMA, SPECIMEN, SUMMARY
from endoct.workbench.running.progress import SilentStages, Stages
from endoct.workbench.running.threads import one_blas_thread

__all__ = ["compare", "demo", "simulate", "summarise", "unroll"]


@one_blas_thread()
def unroll(
    path: Path | str,
    output: Path | str | None = None,
    *,
    modality: str | None = None,
    settings: Mapping[str, Any] | None = None,
    volume: bool = False,
    overwrite: bool = False,
    stages: Stages | None = None,
) -> Panorama:
    """Unroll the recording at ``path`` into a panorama of the wall, written to ``output`` where one is given.

    ``settings`` replaces keys of the sidecar and parameters of the plug-in; ``volume`` adds the dense hollow
    cylinder to the output. Raises :class:`EndoctError` where the recording cannot be used or ``output`` exists.
    """
    stages = stages or SilentStages()
    path = Path(path)
    if output is None:
        if volume:
            raise EndoctError("a volume needs an output", remedy="name one")
        return unroll_recording(open_side(path, modality=modality, settings=settings or {}), stages).panorama
    with new_output(Path(output), PANORAMA, overwrite=overwrite, inputs=[path]) as scratch:
        made = unroll_recording(open_side(path, modality=modality, settings=settings or {}), stages)
        save_panorama(made.panorama, scratch)
        if volume:
            write_volume(made, scratch, stages)
    return made.panorama


@one_blas_thread()
def compare(
    a: Path | str,
    b: Path | str,
    output: Path | str,
    *,
    modality_a: str | None = None,
    modality_b: str | None = None,
    settings_a: Mapping[str, Any] | None = None,
    settings_b: Mapping[str, Any] | None = None,
    parameters: CompareParameters | None = None,
    truth: Sequence[Path | str] = (),
    overwrite: bool = False,
    stages: Stages | None = None,
) -> Comparison:
    """Compare two sides, each a recording, a panorama or a mask image, and write the folder ``output``.

    Whether the two could be aligned is in the comparison's ``alignment`` (None) and ``reason``. Raises
    :class:`EndoctError` where a side cannot be used or ``output`` exists.
    """
    sides = (Side(Path(a), modality_a, settings_a or {}), Side(Path(b), modality_b, settings_b or {}))
    masks = tuple(Path(path) for path in truth)
    inputs = [sides[0].path, sides[1].path, *masks]
    with new_output(Path(output), COMPARISON, overwrite=overwrite, inputs=inputs) as scratch:
        return write_comparison(
            sides,
            scratch,
            parameters=parameters or CompareParameters(),
            truth=masks,
            stages=stages or SilentStages(),
        )


def summarise(
    folders: Sequence[Path | str],
    output: Path | str | None = None,
    *,
    against: Sequence[Path | str] = (),
    repeats: bool = False,
    overwrite: bool = False,
) -> dict[str, list[dict[str, Any]]]:
    """Summarise comparison folders, written to the folder ``output`` where one is given.

    See :func:`endoct.workbench.pipeline.summarising.summarise`. Raises :class:`EndoctError` where a folder is no
    comparison, no two of two sets can be paired, or ``output`` exists.
    """
    first, second = [Path(f) for f in folders], [Path(f) for f in against]
    if output is None:
        return _summarise(first, second, repeats=repeats)
    with new_output(Path(output), SUMMARY, overwrite=overwrite, inputs=[*first, *second]) as scratch:
        tables = _summarise(first, second, repeats=repeats)
        write_summary(tables, scratch)
    return tables


def demo(
    output: Path | str,
    *,
    preset: PresetName = "quick",
    seed: int = 1,
    overwrite: bool = False,
    stages: Stages | None = None,
) -> Comparison:
    """Simulate a specimen in ``output``/specimen and compare its recordings in ``output``/comparison.

    Raises :class:`EndoctError` where ``output`` exists and ``overwrite`` is not set, or cannot be written.
    """
    output = Path(output)
    existed = output.exists()
    if existed and not overwrite:
        raise EndoctError(f"{output} exists already", remedy="choose another output, or say --overwrite")
    check_place(output)
    specimen, comparison = output / "specimen", output / "comparison"
    for part, kind in ((specimen, SPECIMEN), (comparison, COMPARISON)):
        check_output(part, kind, overwrite=overwrite)
    try:
        simulate(specimen, preset=preset, seed=seed, overwrite=overwrite, stages=stages)
        return compare(specimen / "endoscope", specimen / "oct", comparison, overwrite=overwrite, stages=stages)
    except BaseException:
        if not existed:
            remove_output(specimen, SPECIMEN)
            with suppress(OSError):  # somebody else has put something there
                output.rmdir()
        raise
