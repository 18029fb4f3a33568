"""A report by sections: tables, words, and figures where there are any.

All is HTML in which every text from a file is escaped.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from types import MappingProxyType

from endoct.fusion.result import Result
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.report.doubts import count_notes, notes_table
from endoct.workbench.report.scores import score_tables
from endoct.workbench.report.tables import panorama_provenance, provenance, result_tables
from endoct.workbench.report.wording import table
from endoct.workbench.report.words import words

TITLES: Mapping[str, str] = MappingProxyType(
    {
        "panoramas": "Panoramas",
        "agreement": "How far they agree, and what stands in the way",
        "alignment": "The sides on each other",
        "depth": "Depth",
        "frames": "Single frames, as recorded and as processed",
        "cylinder": "The bore in three dimensions",
        "numbers": "Overlap and alignment",
        "sides": "The two sides",
        "words": "Words",
        "provenance": "How it was made",
    }
)
ORDER = (
    "panoramas", "masks", "agreement", "alignment", "depth", "frames", "cylinder", "numbers", "sides", "notes",
)  # fmt: skip
"""Of the sections on a comparison; those on quality follow."""
NO_FIGURES: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Section:
    """A part of a report under a heading of its own; ``name`` is what links lead to."""

    name: str
    title: str
    html: str


def comparison_sections(result: Result, figures: Mapping[str, str] = NO_FIGURES) -> tuple[Section, ...]:
    """Return what there is to say of a comparison besides its headline, with ``figures`` as HTML by section."""
    tables = {
        "agreement": "".join(score_tables(result)),
        "numbers": "".join(result_tables(result)),
        "notes": notes_table(result),
        "words": words(result),
        "provenance": "".join(provenance(result)),
    }
    titles = {
        **TITLES,
        "masks": "Cells and difference" if result.aligned else "Cells",
        "notes": f"Notes ({count_notes(result)})",
        **{quality_name(side): f"Quality of {side} along the bore" for side in result.sides},
    }
    order = (*ORDER, *map(quality_name, result.sides), "words", "provenance")
    _check_placed(figures, order)
    html = {name: figures.get(name, "") + tables.get(name, "") for name in order}
    for side in result.sides:
        html[quality_name(side)] = plots_of(side) + html[quality_name(side)]
    return tuple(Section(name, titles[name], html[name]) for name in order if html[name])


def panorama_sections(outline: PanoramaOutline, figures: Mapping[str, str] = NO_FIGURES) -> tuple[Section, ...]:
    """Return what there is to say of a panorama besides its headline, with ``figures`` as HTML by section."""
    side = outline.modality
    html = {
        **figures,
        quality_name(side): plots_of(side) + figures.get(quality_name(side), ""),
        "notes": table([(str(k), note) for k, note in enumerate(outline.notes, 1)], text=(1,)),
        "provenance": "".join(panorama_provenance(outline.provenance)),
    }
    titles = {
        **TITLES,
        "panoramas": "Panorama",
        "notes": f"Notes ({len(outline.notes)})",
        quality_name(side): f"Quality of {side} along the bore",
    }
    order = "panoramas", "frames", quality_name(side), "notes", "provenance"
    _check_placed(figures, order)
    return tuple(Section(name, titles[name], html[name]) for name in order if html.get(name))


def _check_placed(figures: Mapping[str, str], order: Sequence[str]) -> None:
    if homeless := sorted(figures.keys() - set(order)):
        raise ValueError(f"no section of the report takes the figures of {', '.join(homeless)}")


def quality_name(side: str) -> str:
    """Return the name of the section on the quality of a side."""
    return f"quality-{side}"


def plots_of(side: str) -> str:
    """Return the place where the page's program plots the quality of a side."""
    return f'<div class="plots" data-side="{escape(side)}"></div>\n'


def sections_html(sections: Sequence[Section]) -> Iterator[str]:
    """Yield every section; they are open where no program folds them."""
    for one in sections:
        yield (
            f'<details class="section" id="{escape(one.name)}" open><summary><h2>{escape(one.title)}</h2></summary>\n'
            f'<div class="body">{one.html}</div></details>\n'
        )
