"""The table of a collection as HTML: it is there before any program runs, which sorts and filters it."""

import math
import os
from collections.abc import Iterator, Sequence
from urllib.parse import quote

from markupsafe import Markup

from endoct.workbench.page.collection import Entry
from endoct.workbench.page.document import RESEARCH
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.wording import NOTHING, interval_text

COLUMNS = (
    ("wall", ""), ("name", "name"), ("what", "sides, or how it was simulated"), ("verdict", "how far it is trusted"),
    ("Jaccard", "overlap of the cells"), ("Dice", "overlap of the cells"), ("confidence", "of the alignment"),
    ("doubts", "how many"), ("written", "when"),
)  # fmt: skip
PAGES = "/at"
"""Below this lie the pages of entries, by their names."""
LEVELS = {"trusted": "trusted", "doubted": "doubted", "unaligned": "not aligned"}


def collection_html(title: str, entries: Sequence[Entry], version: str) -> Markup:
    """Return the page of a collection; ``version`` goes into the addresses of thumbnails, which browsers keep."""
    kinds = {kind: sum(one.kind == kind for one in entries) for kind in ("comparison", "recording", "specimen")}
    levels = [level for level in LEVELS if any(one.level == level for one in entries)]
    choices = [("", "all"), *((level, LEVELS[level]) for level in levels)]
    choices += [(kind, f"{kind}s") for kind, count in kinds.items() if 0 < count < len(entries)]
    return rendered(
        "page/collection.html",
        title=title,
        kinds=kinds,
        choices=choices,
        columns=COLUMNS,
        entries=entries,
        version=version,
        address_of=address_of,
        level_of=_level,
        numbers_of=_numbers,
        research=RESEARCH,
    )


def address_of(entry: Entry) -> str:
    """Return where the page of an entry is."""
    return f"{PAGES}/{quote(os.fsencode(entry.name))}/"


def _level(entry: Entry) -> tuple[int, str]:
    """Return how far an entry is trusted: by which it is sorted, and in words."""
    return (list(LEVELS).index(entry.level), LEVELS[entry.level]) if entry.level else (len(LEVELS), NOTHING)


def _numbers(entry: Entry) -> Iterator[tuple[str, str, str]]:
    """Yield the numbers of an entry by column: by which it is sorted, the text, and its interval."""
    yield *_number(entry.jaccard), interval_text(entry.interval).removeprefix("95 % interval ")
    yield *_number(entry.dice), ""
    yield *_number(entry.confidence, digits=2), ""


def _number(value: float | None, digits: int = 3) -> tuple[str, str]:
    if value is None or not math.isfinite(value):
        return "", NOTHING
    return f"{value:.9f}", f"{value:.{digits}f}"
