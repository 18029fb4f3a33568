"""Reports: figures as files, and the page as one file that opens offline; of a comparison, or of one recording."""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from markupsafe import Markup

from endoct.base.errors import EndoctError
from endoct.base.files.contents import is_marked, marked, read_contents, whole_of
from endoct.base.files.output import check_output, new_output
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama
from endoct.workbench.page.frozen import frozen_data, frozen_page
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.shown import Shown
from endoct.workbench.report.figures.begun import Figures, begin_both, begin_pictures, begin_wall, drawn_of
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.report.findings import Findings, read_findings
from endoct.workbench.report.sections import Section, recording_sections, report_sections
from endoct.workbench.report.side_findings import SideFindings, recording_in
from endoct.workbench.running.kinds import FIGURES, REPORT
from endoct.workbench.running.scheduler import ALONE, Scheduler

PAGE = "report.html"
REMARK = "The figures lie next to this page, lossless, in figures/."


def write_report(path: Path, scheduler: Scheduler = ALONE) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``path``, replacing older ones; return the page's path.

    ``path`` is what ``endoct compare`` or ``endoct unroll`` wrote; nothing else in it is changed. Raises
    :class:`EndoctError` where ``path`` is neither, not whole, or cannot be written.
    """
    if is_panorama(path):
        contents = read_contents(path)
        if contents is None or PAGE not in contents.parts:
            raise EndoctError(
                f"{path} has no report of its own",
                found="no list of what it holds" if contents is None else "a panorama that was unrolled without one",
                expected="a panorama written by `endoct unroll`, or a folder written by `endoct compare`",
                remedy=f"unroll the recording again, or look at it by `endoct serve {quote(str(path))}`",
            )
        return write_panorama_report(path, load_panorama(path), scheduler)
    _check(path)
    findings = read_findings(path)
    return write_comparison_report(path, findings, begin_both(findings, scheduler, with_sides=True))


def write_comparison_report(folder: Path, findings: Findings, begun: Sequence[Figures]) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of a comparison into its ``folder``, which holds all but these.

    ``findings`` are what it holds, ``begun`` its figures but those of its scores. Returns the page's path. Raises
    :class:`EndoctError` where they cannot be written.
    """
    shown = open_shown(folder)
    data = frozen_data(shown)
    figures = drawn_of(findings, begun)
    return _write(folder, shown, figures, report_sections(findings, figures), data)


def write_panorama_report(store: Path, panorama: Panorama, scheduler: Scheduler = ALONE) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of one recording into the ``store`` of its ``panorama``.

    Returns the page's path. Raises :class:`EndoctError` where they cannot be written.
    """
    _check(store)
    side = recording_in(store, panorama)
    return write_recording_report(store, side, [begin_wall(panorama, scheduler), begin_pictures(side, scheduler)])


def write_recording_report(store: Path, side: SideFindings, begun: Sequence[Figures]) -> Path:
    """Write the report of a recording into its ``store``, which holds all but that; return the page's path.

    ``side``: what it holds, ``begun`` its figures. Raises :class:`EndoctError` where they cannot be written.
    """
    shown = open_shown(store)
    data = frozen_data(shown)
    figures = [one for figures in begun for one in figures.result()]
    sections = recording_sections(side, shown.side(side.name).outline, figures)
    return _write(store, shown, figures, sections, data)


def _check(folder: Path) -> None:
    """Raise :class:`EndoctError` where a report may not be written, before any work is put into it."""
    if (whole := whole_of(folder)) is not None:
        raise EndoctError(
            f"{folder} is a part of {whole.name}, which lists all that it holds",
            found="a part without a report of its own",
            remedy=f"look at it by `endoct serve {quote(str(folder))}`, or write the report of a copy of that folder",
        )
    for part in (folder / PAGE, folder / "figures"):
        if part.is_symlink():
            raise EndoctError(f"{part} is a link", expected="what endoct wrote", remedy="move it away")
    check_output(folder / PAGE, REPORT, overwrite=True, is_ours=is_marked)
    check_output(folder / "figures", FIGURES, overwrite=True)


def _write(folder: Path, shown: Shown, drawn: Sequence[Drawn], sections: Sequence[Section], data: Markup) -> Path:
    page = folder / PAGE
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        write_figures(drawn, figures)
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        scratch.write_text(marked(frozen_page(shown, sections, data, REMARK)), encoding="utf-8")
    return page
