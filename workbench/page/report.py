"""Reports: figures as files, and the page as one file that opens offline; of a comparison, or of one recording."""

from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

from endoct.stitching.contents import is_marked, marked, read_contents, whole_of
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, new_output
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.page.frozen import frozen_data, frozen_page
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.shown import Shown
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.report.findings import Findings, read_findings
from endoct.workbench.report.illustrated import recording_sections, report_sections
from endoct.workbench.report.pictures import PICTURES, load_pictures
from endoct.workbench.report.sections import Section
from endoct.workbench.report.side_findings import SideFindings, alone
from endoct.workbench.running.kinds import FIGURES, REPORT
from endoct.workbench.running.second_process import beside

PAGE = "report.html"
REMARK = "The figures lie next to this page, lossless, in figures/."


def write_report(
    path: Path, process: WorkerProcess | None = None, of_sides: "Future[list[Drawn]] | None" = None
) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``path``, replacing older ones; return the page's path.

    ``path`` is what ``endoct compare`` or ``endoct unroll`` wrote; nothing else in it is changed. Half of the figures
    of a comparison are drawn in ``process`` where there is one; ``of_sides`` are those of :func:`draw_side` where they
    are drawn already. Raises :class:`EndoctError` where ``path`` is neither, not whole, or cannot be written.
    """
    if is_panorama(path):
        contents = read_contents(path)
        if contents is None or PAGE not in contents.parts:
            raise EndoctError(
                f"{path} has no report of its own",
                found="no list of what it holds" if contents is None else "a panorama that was unrolled without one",
                expected="a panorama written by `endoct unroll`, or a folder written by `endoct compare`",
                remedy=f"unroll the recording again, or look at it by `endoct serve {path}`",
            )
        return write_panorama_report(path, load_panorama(path), process)
    _check(path)
    there = None if process is None else process.call(_draw_there, path, of_sides is None)
    findings, shown = read_findings(path), open_shown(path)
    walls = _draw_walls(findings)
    data = frozen_data(shown)
    # where the other process has not come to it yet, it is done here meanwhile
    others = _draw(findings, of_sides is None) if there is None or there.cancel() else there.result()
    drawn = [*walls, *others, *(of_sides.result() if of_sides is not None else ())]
    return _write(path, shown, drawn, report_sections(findings, drawn), data)


def begin_drawing(panorama: Panorama, process: WorkerProcess | None) -> "Future[list[Drawn]]":
    """Have ``process`` draw what can be drawn of a recording before its pictures of frames are there."""
    return beside(process, _draw_wall, alone(panorama, {}))


def write_panorama_report(
    store: Path,
    panorama: Panorama,
    process: WorkerProcess | None = None,
    of_wall: "Future[list[Drawn]] | None" = None,
) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of one recording into the ``store`` of its ``panorama``.

    Figures are drawn in ``process`` where there is one; ``of_wall`` are those of :func:`begin_drawing` where it was
    begun already. Returns the page's path. Raises :class:`EndoctError` where they cannot be written.
    """
    _check(store)
    side = alone(panorama, load_pictures(store / PICTURES).get(panorama.modality, {}))
    of_wall = of_wall or begin_drawing(panorama, process)
    of_frames = beside(process, _draw_pictures, side)
    shown = open_shown(store)
    data = frozen_data(shown)
    drawn = [*of_wall.result(), *of_frames.result()]
    sections = recording_sections(side, shown.side(side.name).outline, drawn)
    return _write(store, shown, drawn, sections, data)


def _check(folder: Path) -> None:
    """Raise :class:`EndoctError` where a report may not be written, before any work is put into it."""
    if (whole := whole_of(folder)) is not None:
        raise EndoctError(
            f"{folder} is a part of {whole.name}, which lists all that it holds",
            found="a part without a report of its own",
            remedy=f"look at it by `endoct serve {folder}`, or write the report of a copy of that folder",
        )
    for part in (folder / PAGE, folder / "figures"):
        if part.is_symlink():
            raise EndoctError(f"{part} is a link", expected="what endoct wrote", remedy="move it away")
    check_output(folder / PAGE, REPORT, overwrite=True, is_ours=is_marked)
    check_output(folder / "figures", FIGURES, overwrite=True)


def _write(folder: Path, shown: Shown, drawn: Sequence[Drawn], sections: Sequence[Section], data: str) -> Path:
    page = folder / PAGE
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        write_figures(drawn, figures)
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        scratch.write_text(marked(frozen_page(shown, sections, data, REMARK)), encoding="utf-8")
    return page


# Whoever draws loads matplotlib; where the other process does, this one need not.


def _draw_wall(side: SideFindings) -> list[Drawn]:
    from endoct.workbench.report.figures.of_one import draw_wall

    return draw_wall(side)


def _draw_pictures(side: SideFindings) -> list[Drawn]:
    from endoct.workbench.report.figures.of_one import draw_pictures

    return draw_pictures(side)


def _draw_walls(findings: Findings) -> list[Drawn]:
    from endoct.workbench.report.figures.of_both import draw_walls

    return draw_walls(findings)


def _draw_there(folder: Path, with_sides: bool) -> list[Drawn]:
    return _draw(read_findings(folder), with_sides)


def _draw(findings: Findings, with_sides: bool) -> list[Drawn]:
    from endoct.workbench.report.figures.of_both import draw_shapes
    from endoct.workbench.report.figures.of_one import draw_side

    sides = [one for side in findings.sides for one in draw_side(side)] if with_sides else []
    return [*draw_shapes(findings), *sides]
