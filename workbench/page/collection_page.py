"""The table of a collection as HTML: it is there before any program runs, which sorts and filters it."""

import math
import os
from collections.abc import Iterator, Sequence
from html import escape
from urllib.parse import quote

from endoct.workbench.page.collection import Entry
from endoct.workbench.page.document import RESEARCH
from endoct.workbench.report.wording import NOTHING, interval_text
from endoct.workbench.running.refusals import visible_lines

COLUMNS = (
    ("wall", ""), ("name", "name"), ("what", "sides, or how it was simulated"), ("verdict", "how far it is trusted"),
    ("Jaccard", "overlap of the cells"), ("Dice", "overlap of the cells"), ("confidence", "of the alignment"),
    ("doubts", "how many"), ("written", "when"),
)  # fmt: skip
PAGES = "/at"
"""Below this lie the pages of entries, by their names."""
LEVELS = {"trusted": "trusted", "doubted": "doubted", "unaligned": "not aligned"}


def collection_html(title: str, entries: Sequence[Entry], version: str) -> str:
    """Return the page of a collection; ``version`` goes into the addresses of thumbnails, which browsers keep."""
    kinds = {kind: sum(one.kind == kind for one in entries) for kind in ("comparison", "recording", "specimen")}
    facts = "".join(f"<span>{count} {kind}{'s' * (count != 1)}</span>" for kind, count in kinds.items() if count)
    heads = "".join(_head(name, hint) for name, hint in COLUMNS)
    rows = "".join(_row(number, entry, version) for number, entry in enumerate(entries))
    levels = [level for level in LEVELS if any(one.level == level for one in entries)]
    choices = [("", "all"), *((level, LEVELS[level]) for level in levels)]
    choices += [(kind, f"{kind}s") for kind, count in kinds.items() if 0 < count < len(entries)]
    options = "".join(f'<option value="{value}">{said}</option>' for value, said in choices)
    said = (
        f"<title>{escape(f'endoct: {title}')}</title>\n</head>\n<body>\n"
        f'<header class="top"><div class="what"><h1>{escape(title)}</h1><p class="facts">{facts}</p></div></header>\n'
        '<main class="collection">\n<p role="search"><input type="search" placeholder="filter by any text" '
        f'aria-label="filter by any text"> <select aria-label="which are listed">{options}</select> '
        '<small role="status"></small></p>\n'
        f'<table class="folder"><thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}</tbody></table>\n'
        f"<footer>{RESEARCH}</footer>\n</main>\n</body>\n</html>\n"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<link rel="stylesheet" href="/page.css">\n'
        '<script src="/folder.js" defer></script>\n<link rel="icon" href="data:,">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{visible_lines(said)}"
    )


def address_of(entry: Entry) -> str:
    """Return where the page of an entry is."""
    return f"{PAGES}/{quote(os.fsencode(entry.name))}/"


def _head(name: str, hint: str) -> str:
    if not hint:
        return f'<th scope="col">{name}</th>'
    return f'<th scope="col" aria-sort="none"><button type="button" title="sort: {hint}">{name}</button></th>'


def _row(number: int, entry: Entry, version: str) -> str:
    cells = "".join(f'<td data-key="{escape(key)}">{html}</td>' for key, html in _cells(entry))
    address = f"/thumbnails/{version}/{number}.png"
    picture = "" if entry.fault else f'<img src="{address}" loading="lazy" alt="">'
    return f'<tr data-kind="{entry.kind}" data-level="{entry.level or ""}"><td>{picture}</td>{cells}</tr>\n'


def _cells(entry: Entry) -> Iterator[tuple[str, str]]:
    """Yield by column what it is sorted by, and what it shows as HTML."""
    name = escape(entry.name)
    yield (
        entry.name,
        f'<a href="{escape(address_of(entry))}">{name}</a>' if entry.can_be_opened else f"<span>{name}</span>",
    )
    if entry.fault:
        yield "", f'<span class="fault">{escape(entry.fault)}</span>'
    else:
        yield entry.what, f"<span>{entry.kind}</span> <small>{escape(entry.what)}</small>"
    level = list(LEVELS).index(entry.level) if entry.level else len(LEVELS)
    said = LEVELS[entry.level] if entry.level else NOTHING
    yield str(level), f'<span class="level {entry.level or ""}" title="{escape(entry.headline)}">{said}</span>'
    yield _number(entry.jaccard, f" <small>{interval_text(entry.interval).removeprefix('95 % interval ')}</small>")
    yield _number(entry.dice)
    yield _number(entry.confidence, digits=2)
    codes = ", ".join(doubt.code for doubt in entry.doubts)
    yield str(len(entry.doubts)), f"{len(entry.doubts) or ''} <small>{escape(codes)}</small>"
    yield entry.written, escape(entry.written)


def _number(value: float | None, besides: str = "", digits: int = 3) -> tuple[str, str]:
    if value is None or not math.isfinite(value):
        return "", NOTHING
    return f"{value:.9f}", f"{value:.{digits}f}{besides}"
