"""The public Python interface: what the command line does, as functions."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.modalities.acquisition import validate
from endoct.modalities.device import Device, check_device
from endoct.modalities.registry import load_ahead
from endoct.stitching.panorama import Panorama
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.report.figures.rendered import FIGURES
from endoct.workbench.running.kinds import COMPARISON, PANORAMA, SUMMARY
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread, scheduler

if TYPE_CHECKING:
    from endoct.fusion.sides import Comparison
    from endoct.workbench.pipeline.summarising import Row

__all__ = ["compare", "demo", "summarise", "unroll"]


@one_blas_thread()
def unroll(
    path: Path | str,
    output: Path | str | None = None,
    *,
    modality: str | None = None,
    settings: Mapping[str, object] | None = None,
    volume: bool = False,
    device: Device = "cpu",
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> Panorama:
    """Unroll the recording at ``path`` into a panorama of the wall, written to ``output`` where one is given.

    The store that is written holds a report, ``report.html``, and pictures of a few frames.

    ``settings`` replaces keys of the sidecar and parameters of the plug-in, as ``--set`` does; ``volume`` adds the
    dense hollow cylinder to the output; ``device`` is where to compute what the plug-in can compute elsewhere than on
    the CPU (:class:`~endoct.modalities.contract.OnDeviceModality`); ``progress=False`` displays none. Raises
    :class:`EndoctError` where the recording or the device cannot be used, or ``output`` exists and ``overwrite`` is not
    set.

    With the specimen that :func:`demo` simulates in its example:

    >>> from endoct.workbench import unroll
    >>> wall = unroll("demo/specimen/oct", settings={"undistort": "sine"})
    >>> wall.intensity.shape  # (z, θ), as is wall.depth_mm
    (16, 512)
    >>> wall.to_xarray()["depth_mm"].dims
    ('z', 'theta')
    """
    check_device(device)
    stages, path = stages_for(progress), Path(path)
    if output is None:
        if volume:
            raise EndoctError("a volume needs an output", remedy="give one, or leave out volume=True")
        from endoct.workbench.pipeline.unrolling import open_recording, unroll_recording

        recording = open_recording(path, modality=modality, settings=settings, device=device)
        return unroll_recording(recording, stages).panorama
    with new_output(Path(output), PANORAMA, overwrite=overwrite, inputs=[path]) as store, scheduler() as second:
        second.load(FIGURES)
        from endoct.workbench.pipeline.unrolled_store import unroll_into
        from endoct.workbench.pipeline.unrolling import open_recording

        recording = open_recording(path, modality=modality, settings=settings, device=device)
        return unroll_into(store, recording, stages, second, volume=volume)


@one_blas_thread()
def compare(
    a: Panorama | Path | str,
    b: Panorama | Path | str,
    output: Path | str | None = None,
    *,
    modality_a: str | None = None,
    modality_b: str | None = None,
    settings: Mapping[str, object] | None = None,
    settings_a: Mapping[str, object] | None = None,
    settings_b: Mapping[str, object] | None = None,
    truth: Sequence[Path | str] = (),
    session: Path | str | None = None,
    device: Device = "cpu",
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> "Comparison":
    """Compare two sides: panoramas at hand, or paths of recordings, panoramas or mask images.

    The comparison, with its report, is written to the folder ``output`` where one is given. ``settings`` are
    parameters of the comparison; ``settings_a`` and ``settings_b`` replace keys of a side's sidecar and parameters of
    its plug-in: the same names as for ``--set``, ``--set-a`` and ``--set-b``. ``truth`` are masks to score both sides
    against, ``session`` a file with landmark pairs that correct and check the alignment; ``device`` is that of
    :func:`unroll`, for recordings; ``progress=False`` displays none. Where the two could not be aligned, the
    comparison's ``alignment`` is None and its ``reason`` says why. Raises :class:`EndoctError` where a side, a setting,
    a session or the device cannot be used, or ``output`` exists and ``overwrite`` is not set.

    With the specimen that :func:`demo` simulates in its example:

    >>> from endoct.workbench import compare, unroll
    >>> wall = unroll("demo/specimen/oct")
    >>> comparison = compare("demo/comparison/panoramas/endoscope.zarr", wall, settings={"n_theta": 512})
    >>> comparison.grid.n_theta, comparison.alignment is None
    (512, False)
    """
    check_device(device)
    given = [Path(one) for one in (a, b) if not isinstance(one, Panorama)]
    masks = tuple(Path(path) for path in truth)
    placed = None if session is None else Path(session)
    with ExitStack() as until_done:
        folder = None
        if output is not None:
            inputs = [*given, *masks, *([] if placed is None else [placed])]
            made = new_output(Path(output), COMPARISON, overwrite=overwrite, inputs=inputs)
            folder = until_done.enter_context(made)
        # it has ended before what was made is put in its place
        second = until_done.enter_context(scheduler(needed=output is not None or len(given) == 2))
        if not isinstance(b, Panorama):
            second.begin(load_ahead, Path(b), modality_b)
        from endoct.fusion.parameters import CompareParameters
        from endoct.workbench.pipeline.comparing import compare_sources
        from endoct.workbench.pipeline.sources import Source

        return compare_sources(
            (
                Source(a if isinstance(a, Panorama) else Path(a), modality_a, settings_a or {}, device),
                Source(b if isinstance(b, Panorama) else Path(b), modality_b, settings_b or {}, device),
            ),
            folder,
            parameters=validate(CompareParameters, settings or {}, "the settings of the comparison"),
            truth=masks,
            stages=stages_for(progress),
            session=placed,
            scheduler=second,
        )


def summarise(
    folders: Sequence[Path | str],
    output: Path | str | None = None,
    *,
    against: Sequence[Path | str] = (),
    repeats: bool = False,
    overwrite: bool = False,
) -> "dict[str, list[Row]]":
    """Summarise folders of comparisons, or of poses, written to the folder ``output`` where one is given.

    Returns tables by name, each a list of rows: ``scores``, ``summary``, ``paired`` (with ``against``) and
    ``repeatability`` (with ``repeats``); see :func:`endoct.workbench.pipeline.summarising.summarise`. Of poses they are
    ``poses`` and ``agreement``: :func:`endoct.workbench.pipeline.summarising_poses.summarise_poses`. Raises
    :class:`EndoctError` where a folder is no comparison, no comparisons of the two sets can be paired, or ``output``
    exists and ``overwrite`` is not set.

    >>> from endoct.workbench import summarise
    >>> tables = summarise(["demo/comparison"])
    >>> next(row["specimens"] for row in tables["summary"] if row["score"] == "jaccard")
    1
    """
    from endoct.workbench.pipeline.summarising import summarise as summarise_comparisons
    from endoct.workbench.pipeline.summarising import write_summary
    from endoct.workbench.pipeline.summarising_poses import are_poses, summarise_poses

    first, second = [Path(f) for f in folders], [Path(f) for f in against]

    def summarised() -> "dict[str, list[Row]]":
        if not are_poses([*first, *second]):
            return summarise_comparisons(first, second, repeats=repeats)
        if second or repeats:
            raise EndoctError("poses are summarised one by one", remedy="leave out --against and --repeats")
        return summarise_poses(first)

    if output is None:
        return summarised()
    with new_output(Path(output), SUMMARY, overwrite=overwrite, inputs=[*first, *second]) as scratch:
        tables = summarised()
        write_summary(tables, scratch)
    return tables


def demo(
    output: Path | str,
    *,
    preset: PresetName = "quick",
    seed: int = 1,
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> "Comparison":
    """Simulate a specimen in ``output``/specimen and compare its recordings in ``output``/comparison.

    Raises :class:`EndoctError` where ``output`` exists and ``overwrite`` is not set, or cannot be written.

    >>> from endoct.workbench import demo
    >>> comparison = demo("demo", preset="learning", seed=3)
    >>> comparison.names
    ('endoscope', 'oct')
    """
    from endoct.workbench.pipeline.demonstration import demonstrate
    from endoct.workbench.pipeline.simulating import simulate

    stages = stages_for(progress)
    return demonstrate(
        Path(output),
        ("comparison", COMPARISON),
        lambda specimen: simulate(specimen, preset=preset, seed=seed, overwrite=overwrite, progress=stages),
        lambda specimen, place: compare(
            specimen / "endoscope", specimen / "oct", place, overwrite=overwrite, progress=stages
        ),
        overwrite=overwrite,
    )
