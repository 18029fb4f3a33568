"""The report of a comparison: figures as files, and the page as one file that opens offline."""

from pathlib import Path

from endoct.stitching.contents import is_marked, marked
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, new_output
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.page.frozen import frozen_data, frozen_page
from endoct.workbench.page.opening import open_shown
from endoct.workbench.report.figures.all import draw_on_grid, draw_on_own_rows
from endoct.workbench.report.figures.drawing import Drawn
from endoct.workbench.report.findings import read_findings
from endoct.workbench.report.illustrated import report_sections
from endoct.workbench.running.kinds import FIGURES, REPORT

REMARK = "The figures lie next to this page, lossless, in figures/."


def write_report(folder: Path, process: WorkerProcess | None = None) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``folder``, replacing older ones; return the page's path.

    Half of the figures are drawn in ``process`` where there is one. ``folder`` is what ``endoct compare``
    wrote; nothing else in it is changed. Raises :class:`EndoctError` where it is no whole comparison or cannot be
    written.
    """
    page = folder / "report.html"
    for part in (page, folder / "figures"):
        if part.is_symlink():
            raise EndoctError(f"{part} is a link", expected="what endoct wrote", remedy="move it away")
    check_output(page, REPORT, overwrite=True, is_ours=is_marked)
    check_output(folder / "figures", FIGURES, overwrite=True)
    findings = read_findings(folder)
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        figures.mkdir()
        there = None if process is None else process.call(_draw_there, folder, figures)
        on_grid = draw_on_grid(findings, figures)
        shown = open_shown(folder)
        data = frozen_data(shown)
        own = draw_on_own_rows(findings, figures) if there is None else there.result()
        html = frozen_page(shown, report_sections(findings, [*on_grid, *own]), data, REMARK)
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        scratch.write_text(marked(html), encoding="utf-8")
    return page


def _draw_there(folder: Path, figures: Path) -> list[Drawn]:
    return draw_on_own_rows(read_findings(folder), figures)
