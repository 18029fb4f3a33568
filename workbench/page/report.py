"""Reports: figures as files, and the page as one file that opens offline; of a comparison, or of one recording."""

from collections.abc import Callable
from pathlib import Path

from endoct.stitching.contents import is_marked, marked, read_contents
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, new_output
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.page.frozen import frozen_data, frozen_page
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.shown import Shown
from endoct.workbench.report.figures.all import draw_details, draw_recording, draw_walls
from endoct.workbench.report.figures.drawing import Drawn
from endoct.workbench.report.findings import alone, read_findings
from endoct.workbench.report.illustrated import recording_sections, report_sections
from endoct.workbench.report.pictures import PICTURES, load_pictures
from endoct.workbench.report.sections import Section
from endoct.workbench.running.kinds import FIGURES, REPORT

PAGE = "report.html"
REMARK = "The figures lie next to this page, lossless, in figures/."


def write_report(path: Path, process: WorkerProcess | None = None) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``path``, replacing older ones; return the page's path.

    ``path`` is what ``endoct compare`` or ``endoct unroll`` wrote; nothing else in it is changed. Half of the figures
    of a comparison are drawn in ``process`` where there is one. Raises :class:`EndoctError` where ``path`` is neither,
    not whole, or cannot be written.
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
        return write_panorama_report(path, load_panorama(path))
    _check(path)
    findings = read_findings(path)

    def draw(figures: Path, shown: Shown) -> tuple[str, tuple[Section, ...]]:
        there = None if process is None else process.call(_draw_there, path, figures)
        walls = draw_walls(findings, figures)
        data = frozen_data(shown)
        details = draw_details(findings, figures) if there is None else there.result()
        return data, report_sections(findings, [*walls, *details])

    return _write(path, draw)


def write_panorama_report(store: Path, panorama: Panorama) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of one recording into the ``store`` of its ``panorama``.

    Returns the page's path. Raises :class:`EndoctError` where they cannot be written.
    """
    _check(store)
    side = alone(panorama, load_pictures(store / PICTURES).get(panorama.modality, {}))

    def draw(figures: Path, shown: Shown) -> tuple[str, tuple[Section, ...]]:
        drawn = draw_recording(side, figures)
        return frozen_data(shown), recording_sections(side, shown.side(side.name).outline, drawn)

    return _write(store, draw)


def _check(folder: Path) -> None:
    """Raise :class:`EndoctError` where a report may not be written, before any work is put into it."""
    whole = next((whole for whole in folder.resolve().parents if _lists(whole, folder.resolve())), None)
    if whole is not None:
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


def _lists(whole: Path, folder: Path) -> bool:
    """Say whether what ``whole`` holds lists files of ``folder``, and not as a part that says of itself."""
    contents = read_contents(whole)
    within = f"{folder.relative_to(whole).as_posix()}/"
    return contents is not None and any(name.startswith(within) for name in contents.files)


def _write(folder: Path, draw: Callable[[Path, Shown], tuple[str, tuple[Section, ...]]]) -> Path:
    page = folder / PAGE
    shown = open_shown(folder)
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        figures.mkdir()
        data, sections = draw(figures, shown)
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        scratch.write_text(marked(frozen_page(shown, sections, data, REMARK)), encoding="utf-8")
    return page


def _draw_there(folder: Path, figures: Path) -> list[Drawn]:
    return draw_details(read_findings(folder), figures)
