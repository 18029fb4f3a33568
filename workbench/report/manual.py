"""The manuals, as they ship with the program: their pages, and from two tables of them one sentence on every word."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import pairwise
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from endoct.workbench.report.html_templates import WORKBENCH, rendered

if TYPE_CHECKING:  # only who reads a page of the manuals loads it
    from markdown_it.token import Token

FOLDERS = ("", "tutorials", "how-to", "explanation", "results", "reference")
GLOSSARY, DOUBTS = "reference/glossary.md", "reference/result.md"
_TERM = re.compile(r"^\| \*\*(?P<words>[^*]+)\*\*[^|]* \| (?P<text>.+) \|$", re.MULTILINE)
_CODES = re.compile(r"^\| (?P<codes>`[a-z0-9-]+`(?:, `[a-z0-9-]+`)*) \| (?P<text>.+?) \|[^|]*\|$", re.MULTILINE)
_LINK = re.compile(r"\[([^\]]+)\]\(([^)]+)\)")
_ADMONITION = re.compile(r'^!!! (\w+)(?: "([^"]*)")?\n\n?((?: {4}.*\n|\n)+)', re.MULTILINE)


@dataclass(frozen=True)
class Word:
    """What a word means, in a sentence or two, and the ``page`` of the manuals to read on."""

    text: str
    page: str


def words_json(manual: str) -> dict[str, object]:
    """Return the glossary for the page's program; ``manual`` is the address of the manuals, "" for none."""
    found = {word: (of.text, of.page) for word, of in words().items() if not of.page.endswith("#doubts")}
    return {"manual": manual, "words": found}


@cache
def words() -> Mapping[str, Word]:
    """Return the words of the glossary, in lower case, and the codes of doubts, with what they mean."""
    found = {}
    for row in _TERM.finditer(_text(GLOSSARY)):
        for word in re.split(r", | and ", row["words"]):
            found[word.lower()] = _word(row["text"], GLOSSARY)
    for row in _CODES.finditer(_text(DOUBTS).partition("\n## doubts\n")[2]):
        for code in row["codes"].replace("`", "").split(", "):
            found[code] = Word(_word(row["text"], DOUBTS).text, f"{DOUBTS}#doubts")
    return found


def manual_page(name: str) -> Markup | None:
    """Return a page of the manuals as HTML by its path in them, or their contents for ""; None where there is none."""
    folder, _, file = name.rpartition("/")
    up = "../" * (name.count("/") + 1)
    if not name:
        pages = {each: {page: _title(f"{each}/{page}".lstrip("/")) for page in _pages(each)} for each in FOLDERS}
        return rendered("report/manual.html", title="Manual", pages=pages, body="", up=up)
    if folder not in FOLDERS or file not in _pages(folder):
        return None
    return rendered("report/manual.html", title=_title(name), pages={}, body=_html(name), up=up)


def _html(name: str) -> Markup:
    from markdown_it import MarkdownIt

    text = _ADMONITION.sub(
        lambda found: f"> **{found[2] or found[1].capitalize()}.** {found[3].strip()}\n\n", _text(name)
    )
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    reader.add_render_rule("image", lambda _, tokens, k, *__: str(escape(tokens[k].content)))  # pictures do not ship
    tokens = reader.parse(re.sub(r"</?code>", "`", text))
    for heading, inline in pairwise(tokens):
        if heading.type == "heading_open":
            heading.attrSet("id", _anchor(inline))
    html: str = reader.renderer.render(tokens, reader.options, {})
    return Markup(html.replace("&amp;#124;", "|").replace("<th></th>", "<td></td>"))  # no head is without a word


def _anchor(heading: "Token") -> str:
    """Return the anchor of a heading, as links in the manuals have it."""
    text = re.sub(r"[^\w\s-]", "", _LINK.sub(r"\1", heading.content)).strip().lower()
    return re.sub(r"[\s-]+", "-", text)


def _word(text: str, of: str) -> Word:
    link = _LINK.search(text)
    page = of if link is None else link[2].replace("../", "") if link[2].startswith("../") else f"reference/{link[2]}"
    plain = re.sub(r"[`*]|\\(?=\|)", "", _LINK.sub(r"\1", text))
    return Word(plain[:1].upper() + plain[1:], page)


def _title(name: str) -> str:
    return _text(name).partition("\n")[0].removeprefix("# ")


@cache
def _pages(folder: str) -> tuple[str, ...]:
    return tuple(sorted(each.name for each in _root().joinpath(folder).iterdir() if each.name.endswith(".md")))


@cache
def _text(name: str) -> str:
    return _root().joinpath(name).read_text("utf-8")


def _root() -> Traversable:
    return files(WORKBENCH).joinpath("manual")
