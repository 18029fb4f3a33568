"""The sections of a report with its figures, each embedded, under a number, with its caption."""

from collections.abc import Sequence
from html import escape

from endoct.stitching.store import PanoramaOutline
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.findings import Findings
from endoct.workbench.report.quality import quality_of
from endoct.workbench.report.sections import ORDER, Section, comparison_sections, panorama_sections, quality_name
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.tables import side_table

CSS_PIXELS_PER_INCH = 148


def report_sections(findings: Findings, drawn: Sequence[Drawn]) -> tuple[Section, ...]:
    """Return all that there is to say and to draw of a comparison besides its headline."""
    figures = {"sides": side_table(findings), **numbered(drawn)}
    for side in findings.sides:
        figures[quality_name(side.name)] = _quality(side, figures)
    return comparison_sections(findings.result, figures)


def recording_sections(side: SideFindings, outline: PanoramaOutline, drawn: Sequence[Drawn]) -> tuple[Section, ...]:
    """Return all that there is to say and to draw of one recording besides its headline."""
    figures = numbered(drawn)
    figures[quality_name(side.name)] = _quality(side, figures)
    return panorama_sections(outline, figures)


def numbered(drawn: Sequence[Drawn]) -> dict[str, str]:
    """Return figures as HTML by section, numbered in the order in which sections stand."""
    placed = sorted(drawn, key=lambda one: ORDER.index(one.section) if one.section in ORDER else len(ORDER))
    sections: dict[str, str] = {}
    for number, figure in enumerate(placed, 1):
        sections[figure.section] = sections.get(figure.section, "") + _figure(number, figure)
    return sections


def _quality(side: SideFindings, figures: dict[str, str]) -> str:
    main, others = figures.pop(quality_name(side.name), ""), figures.pop(f"numbers-{side.name}", "")
    return "".join(quality_of(side, main, others))


def _figure(number: int, figure: Drawn) -> str:
    rendered = figure.rendered
    return (
        f'<figure id="figure-{escape(rendered.name)}"><img src="{rendered.embedded}" '
        f'alt="{escape(figure.title)}" width="{round(rendered.width_in * CSS_PIXELS_PER_INCH)}">\n'
        f"<figcaption><b>Figure {number}. {escape(figure.title)}.</b> {escape(figure.caption)} "
        f'<span class="code">figures/{escape(rendered.file)}</span></figcaption></figure>\n'
    )
