"""The figures of a report as vectors, for a paper: all of them in one PDF, or each as SVG with its caption."""

from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from endoct.base.errors import EndoctError
from endoct.stitching.store import load_panorama
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.report.figures.drawing import Keep, handed_to, svg_of
from endoct.workbench.report.figures.rendered import Drawn, begin_both, begin_pictures, begin_wall, drawn_of
from endoct.workbench.report.findings import read_findings
from endoct.workbench.report.side_findings import recording_in
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import ALONE

_FIRST_DAY = (1980, 1, 1, 0, 0, 0)


def write_pdf(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the figures of the report as one PDF, a page each.

    Raises :class:`EndoctError` where ``source`` has no report.
    """
    del request
    editable = rc_context({"pdf.fonttype": 42})  # text stays text
    with editable, PdfPages(path, metadata={"CreationDate": None}) as pages:
        figures = _drawn(source, stages, lambda figure, _, inked: pages.savefig(figure, bbox_inches=inked))
    return {"figures": len(figures)}


def write_svg(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the figures of the report as SVG, with ``captions.txt``, into one ZIP.

    Raises :class:`EndoctError` where ``source`` has no report.
    """
    del request
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:

        def keep(figure: Figure, name: str, inked: Bbox) -> None:
            archive.writestr(ZipInfo(f"{name}.svg", _FIRST_DAY), svg_of(figure, inked), ZIP_DEFLATED)

        figures = _drawn(source, stages, keep)
        captions = "\n".join(f"{figure.rendered.name}.svg: {figure.title}. {figure.caption}\n" for figure in figures)
        archive.writestr(ZipInfo("captions.txt", _FIRST_DAY), captions, ZIP_DEFLATED)
    return {"figures": len(figures)}


def _drawn(source: Exportable, stages: Stages, keep: Keep) -> list[Drawn]:
    """Draw what the report of ``source`` shows, each figure handed to ``keep``."""
    with stages.stage("figures"), handed_to(keep):
        if source.kind == "panorama":
            side = recording_in(source.folder, panorama := load_panorama(source.folder))
            return [
                one for begun in (begin_wall(panorama, ALONE), begin_pictures(side, ALONE)) for one in begun.result()
            ]
        if source.kind == "comparison":
            findings = read_findings(source.folder)
            return drawn_of(findings, begin_both(findings, ALONE, with_sides=True))
    raise EndoctError(f"{source.path} has no figures", found=f"a {source.kind}", expected="a comparison, or a panorama")
