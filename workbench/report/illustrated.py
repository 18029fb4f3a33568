"""The sections of a report with its figures, each embedded, under a number, with its caption."""

from collections.abc import Sequence

from markupsafe import Markup

from endoct.stitching.store import PanoramaOutline
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.findings import Findings
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.per_frame import number_rows
from endoct.workbench.report.sections import ORDER, Section, comparison_sections, panorama_sections, quality_name
from endoct.workbench.report.side_findings import SideFindings, flag_rows
from endoct.workbench.report.tables import side_table

CSS_PIXELS_PER_INCH = 148


def report_sections(findings: Findings, drawn: Sequence[Drawn]) -> tuple[Section, ...]:
    """Return all that there is to say and to draw of a comparison besides its headline."""
    header, rows = side_table(findings)
    figures = {"sides": rendered("report/plain_table.html", header=header, rows=rows), **numbered(drawn)}
    for side in findings.sides:
        figures[quality_name(side.name)] = _measured(side, figures)
    return comparison_sections(findings.result, figures)


def recording_sections(side: SideFindings, outline: PanoramaOutline, drawn: Sequence[Drawn]) -> tuple[Section, ...]:
    """Return all that there is to say and to draw of one recording besides its headline."""
    figures = numbered(drawn)
    figures[quality_name(side.name)] = _measured(side, figures)
    return panorama_sections(outline, figures)


def numbered(drawn: Sequence[Drawn]) -> dict[str, Markup]:
    """Return figures as HTML by section, numbered in the order in which sections stand."""
    placed = sorted(drawn, key=lambda one: ORDER.index(one.section) if one.section in ORDER else len(ORDER))
    sections: dict[str, Markup] = {}
    for number, figure in enumerate(placed, 1):
        width_px = round(figure.rendered.width_in * CSS_PIXELS_PER_INCH)
        html = rendered("report/figure.html", number=number, figure=figure, width_px=width_px)
        sections[figure.section] = sections.get(figure.section, Markup()) + html
    return sections


def _measured(side: SideFindings, figures: dict[str, Markup]) -> Markup:
    """Return what was measured of the frames of a side; takes the figures on that out of ``figures``."""
    return rendered(
        "report/measured.html",
        side=side.name,
        dim=side.panorama.frame_dim,
        flagged=flag_rows(side),
        numbers=list(number_rows(side)),
        main=figures.pop(quality_name(side.name), None),
        others=figures.pop(f"numbers-{side.name}", Markup()),
    )
