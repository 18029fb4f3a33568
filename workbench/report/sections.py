"""A report by sections: tables, words, and figures, each embedded, under a number, with its caption."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from markupsafe import Markup

from endoct.fusion.result import Result
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.findings import Findings, overlaps_of
from endoct.workbench.report.html_templates import rendered, rendered_blocks
from endoct.workbench.report.manual import words
from endoct.workbench.report.per_frame import number_rows
from endoct.workbench.report.side_findings import SideFindings, flag_rows
from endoct.workbench.report.tables import (
    alignment_rows,
    overlap_table,
    pair_rows,
    plane_rows,
    rater_rows,
    relief_rows,
    score_table,
    side_table,
)
from endoct.workbench.report.wording import leaf_rows

PAGE_WORDS = ("Jaccard index", "Dice index", "Place", "Common grid", "Confidence", "Observed", "Doubt", "Note")
"""Words of the glossary that a report explains."""
TITLES: Mapping[str, str] = MappingProxyType(
    {
        "panoramas": "Panoramas",
        "masks": "Cells and difference",
        "agreement": "How far they agree, and what stands in the way",
        "alignment": "The sides on each other",
        "depth": "Depth",
        "frames": "Single frames, as recorded and as processed",
        "numbers": "Overlap and alignment",
        "sides": "The two sides",
        "notes": "Notes",
    }
)
"""Titles of the sections on a comparison, in their order; those on quality follow."""
ORDER = tuple(TITLES)
MADE = "How it was made"
CSS_PIXELS_PER_INCH = 148
NO_FIGURES: Mapping[str, Markup] = MappingProxyType({})


@dataclass(frozen=True)
class Section:
    """A part of a report under a heading of its own; ``name`` is what links lead to."""

    name: str
    title: str
    html: Markup


def comparison_sections(result: Result, figures: Mapping[str, Markup] = NO_FIGURES) -> tuple[Section, ...]:
    """Return what there is to say of a comparison besides its headline, with ``figures`` by section."""
    notes = [(side, note) for side, said in result.notes.items() for note in said]
    titles = {
        **TITLES,
        "masks": TITLES["masks"] if result.aligned else "Cells",
        "notes": f"Notes ({len(notes)})",
        **{quality_name(side): quality_title(side) for side in result.sides},
        "words": "Words",
        "provenance": MADE,
    }
    texts = rendered_blocks(
        "report/comparison.html",
        result=result,
        words=words,
        page_words=PAGE_WORDS,
        overlaps=tuple(overlaps_of(result)),
        notes=notes,
        seconds=[(name, f"{value:.1f} s") for name, value in result.seconds.items()],
        score_table=score_table,
        rater_rows=rater_rows,
        relief_rows=relief_rows,
        overlap_table=overlap_table,
        alignment_rows=alignment_rows,
        pair_rows=pair_rows,
        plane_rows=plane_rows,
        leaf_rows=leaf_rows,
    )
    qualities = {quality_name(side): _quality(side, figures) for side in result.sides}
    return in_order(titles, {**figures, **qualities}, texts)


def panorama_sections(outline: PanoramaOutline, figures: Mapping[str, Markup] = NO_FIGURES) -> tuple[Section, ...]:
    """Return what there is to say of a panorama besides its headline, with ``figures`` by section."""
    side = outline.modality
    titles = {
        "panoramas": "Panorama",
        "frames": TITLES["frames"],
        quality_name(side): quality_title(side),
        "notes": f"Notes ({len(outline.notes)})",
        "provenance": MADE,
    }
    texts = rendered_blocks(
        "report/panorama.html", notes=enumerate(outline.notes, 1), made=outline.provenance, leaf_rows=leaf_rows
    )
    return in_order(titles, {**figures, quality_name(side): _quality(side, figures)}, texts)


def in_order(
    titles: Mapping[str, str], figures: Mapping[str, Markup], texts: Mapping[str, Markup]
) -> tuple[Section, ...]:
    """Return those sections of ``titles`` that hold anything: the figures, then the text of each, by its name.

    Raises ``ValueError`` where no section takes a figure.
    """
    if homeless := sorted(figures.keys() - titles.keys()):
        raise ValueError(f"no section of the report takes the figures of {', '.join(homeless)}")
    html = {name: figures.get(name, Markup()) + texts.get(name, Markup()) for name in titles}
    return tuple(Section(name, title, html[name]) for name, title in titles.items() if html[name])


def quality_name(side: str) -> str:
    """Return the name of the section on the quality of a side."""
    return f"quality-{side}"


def quality_title(side: str) -> str:
    """Return the title of the section on the quality of a side."""
    return f"Quality of {side} along the bore"


def _quality(side: str, figures: Mapping[str, Markup]) -> Markup:
    return rendered("report/quality.html", side=side, measured=figures.get(quality_name(side), ""))


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
