"""Reports: figures as files, and the page as one file that opens offline; of a comparison, or of one recording."""

from collections.abc import Sequence
from concurrent.futures import Future
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from endoct.workbench.report.figures.of_one import Drawing

PAGE = "report.html"
REMARK = "The figures lie next to this page, lossless, in figures/."


def write_report(
    path: Path, process: WorkerProcess | None = None, of_sides: "Future[list[Drawn]] | None" = None
) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``path``, replacing older ones; return the page's path.

    ``path`` is what ``endoct compare`` or ``endoct unroll`` wrote; nothing else in it is changed. Figures are drawn
    here and in ``process``, where there is one; ``of_sides`` are those of each side alone where they are drawn already.
    Raises :class:`EndoctError` where ``path`` is neither, not whole, or cannot be written.
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
    with_sides = of_sides is None
    if process is not None:
        process.call(_ready_to_draw, path, with_sides)
    findings, shown = read_findings(path), open_shown(path)
    drawings = _drawings_of(findings, with_sides)
    there = [] if process is None else [process.call(_draw_there, path, with_sides, k) for k in range(len(drawings))]
    data = frozen_data(shown)
    parts: list[list[Drawn]] = [[] for _ in drawings]
    # the other process begins with the first figure, this one with the last
    for k in reversed(range(len(drawings))):
        parts[k] = _drawn(drawings[k]) if not there or there[k].cancel() else there[k].result()
    drawn = [one for part in parts for one in part] + ([] if of_sides is None else of_sides.result())
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


def _drawings_of(findings: Findings, with_sides: bool) -> "list[Drawing]":
    from endoct.workbench.report.figures.of_both import drawings_of

    return drawings_of(findings, with_sides=with_sides)


def _drawn(drawing: "Drawing") -> list[Drawn]:
    from endoct.workbench.report.figures.of_one import drawn

    return drawn([drawing])


@lru_cache(maxsize=1)
def _drawings_there(folder: Path, with_sides: bool) -> "list[Drawing]":
    """What draws a comparison's figures, read once for all calls of one report: a process serves a single one."""
    return _drawings_of(read_findings(folder), with_sides)


def _ready_to_draw(folder: Path, with_sides: bool) -> None:
    _drawings_there(folder, with_sides)


def _draw_there(folder: Path, with_sides: bool, number: int) -> list[Drawn]:
    return _drawn(_drawings_there(folder, with_sides)[number])
