"""The public Python interface: what the command line does, as functions.

Each takes a request of :mod:`endoct.workbench.requests`, or its parts. What works is loaded when a function is called,
so that a second process loads its libraries at the same time.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from endoct.base.errors import EndoctError
from endoct.base.files.output import output_if_any
from endoct.modalities.recognition import load_ahead
from endoct.stitching.panorama import Panorama
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.pipeline.simulating import demonstrate
from endoct.workbench.report.figures.rendered import FIGURES
from endoct.workbench.requests import CompareRequest, SummariseRequest, UnrollRequest, by_request
from endoct.workbench.running.outputs import COMPARISON, PANORAMA, SUMMARY
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread, scheduler

if TYPE_CHECKING:
    from endoct.fusion.sides import Comparison
    from endoct.workbench.pipeline.summarising import TableRow

__all__ = ["compare", "demo", "load", "summarise", "unroll"]


@by_request(UnrollRequest)
@one_blas_thread()
def unroll(request: UnrollRequest) -> Panorama:
    """Unroll the recording at ``path`` into a panorama of the wall, written to ``output`` where one is given.

    The store that is written holds a report, ``report.html``, and pictures of a few frames.

    Arguments are those of :class:`~endoct.workbench.requests.UnrollRequest`. Raises :class:`EndoctError` where the
    recording cannot be used, or ``output`` exists and ``overwrite`` is not set.

    With the specimen that :func:`demo` simulates in its example:

    >>> from endoct.workbench import unroll
    >>> wall = unroll("demo/specimen/oct", settings={"undistort": "sine"})
    >>> wall.intensity.shape  # (z, θ), as is wall.depth_mm
    (16, 512)
    >>> wall.to_xarray()["depth_mm"].dims
    ('z', 'theta')
    """
    if request.volume and request.output is None:
        raise EndoctError("a volume needs an output", remedy="give one, or leave out volume=True")
    inputs, stages = [Path(request.path)], stages_for(request.progress)
    with (
        output_if_any(request.output, PANORAMA, overwrite=request.overwrite, inputs=inputs) as store,
        scheduler(needed=store is not None) as second,
    ):
        second.load(FIGURES)
        from endoct.workbench.pipeline.unrolling import unroll_source

        return unroll_source(request, store, stages, second)


@by_request(CompareRequest)
@one_blas_thread()
def compare(request: CompareRequest) -> "Comparison":
    """Compare two sides: panoramas at hand, or paths of recordings, panoramas or mask images.

    The comparison, with its report, is written to the folder ``output`` where one is given. Arguments are those of
    :class:`~endoct.workbench.requests.CompareRequest`. Where the two could not be aligned, the comparison's
    ``alignment`` is None and its ``reason`` says why. Raises :class:`EndoctError` where a side, a setting or a session
    cannot be used, or ``output`` exists and ``overwrite`` is not set.

    With the specimen that :func:`demo` simulates in its example:

    >>> from endoct.workbench import compare, unroll
    >>> wall = unroll("demo/specimen/oct")
    >>> comparison = compare("demo/comparison/panoramas/endoscope.zarr", wall, settings={"n_theta": 512})
    >>> comparison.grid.n_theta, comparison.alignment is None
    (512, False)
    """
    recorded = [Path(side) for side in (request.a, request.b) if not isinstance(side, Panorama)]
    also = [Path(path) for path in (*request.truth, *request.known, request.session) if path is not None]
    stages = stages_for(request.progress)
    with (
        output_if_any(request.output, COMPARISON, overwrite=request.overwrite, inputs=[*recorded, *also]) as folder,
        # it has ended before what was made is put in its place
        scheduler(needed=folder is not None or len(recorded) == 2) as second,
    ):
        if not isinstance(request.b, Panorama):
            second.begin(load_ahead, Path(request.b), request.modality_b)
        from endoct.workbench.pipeline.comparing import compare_sources

        return compare_sources(request, folder, stages, second)


@by_request(SummariseRequest)
def summarise(request: SummariseRequest) -> "dict[str, list[TableRow]]":
    """Summarise folders of comparisons, or of poses, written to the folder ``output`` where one is given.

    Arguments are those of :class:`~endoct.workbench.requests.SummariseRequest`. Returns tables by name, each a list of
    rows: ``scores``, ``summary``, ``paired`` (with ``against``) and ``repeatability`` (with ``repeats``); see
    :func:`endoct.workbench.pipeline.summarising.summarise`. The folder gets a page, ``report.html``, with plots.
    Of poses they are ``poses`` and ``agreement``:
    :func:`endoct.workbench.pipeline.summarising_poses.summarise_poses`. Raises :class:`EndoctError` where a folder is
    no comparison, no comparisons of the two sets can be paired, or ``output`` exists and ``overwrite`` is not set.

    >>> from endoct.workbench import summarise
    >>> tables = summarise(["demo/comparison"])
    >>> next(row["specimens"] for row in tables["summary"] if row["score"] == "jaccard")
    1
    """
    from endoct.workbench.pipeline.summarising import write_summary
    from endoct.workbench.pipeline.summarising_poses import summarise_any

    first, second = [Path(f) for f in request.folders], [Path(f) for f in request.against]
    with output_if_any(request.output, SUMMARY, overwrite=request.overwrite, inputs=[*first, *second]) as folder:
        tables = summarise_any(first, second, repeats=request.repeats)
        if folder is not None:
            write_summary(tables, folder)
            if "scores" in tables:  # of comparisons, not of poses
                from endoct.workbench.pipeline.supplement import write_supplement

                write_supplement(tables, request, folder)
    return tables


def load(path: Path | str) -> "Comparison | Panorama | dict[str, Any]":
    """Return what lies at ``path``: a panorama, a comparison, or of a pose what its ``pose.json`` says.

    Raises :class:`EndoctError` where it is none of these, damaged, or was changed since it was written.

    With the comparison that :func:`demo` makes in its example:

    >>> from endoct.workbench import load
    >>> comparison = load("demo/comparison")
    >>> comparison.to_xarray()["mask"].dims
    ('side', 'z', 'theta')
    >>> load("demo/comparison/panoramas/oct.zarr").modality
    'oct'
    """
    from endoct.workbench.kinds import reader, row_at

    row = row_at(Path(path))
    if row is None or not row.loaded:
        raise EndoctError(
            f"{path} cannot be loaded",
            found="no such file or folder" if not Path(path).exists() else "",
            expected="a panorama, a comparison or a pose that endoct wrote",
        )
    return reader(row.loaded)(Path(path))  # type: ignore[no-any-return]


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
