"""Templates escape every text, miss no name in silence, and are all that makes markup."""

import re
from itertools import chain
from pathlib import Path

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

import endoct.workbench
from endoct.base.doubt import Doubt
from endoct.workbench.page.heading import Heading, Score, printed_page
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.sections import Section
from endoct.workbench.report.verdict import Verdict

HOSTILE = "</title>\"'><script>alert(1)</script>&{{ 7 * 7 }}{% raw %}=cmd|'/c'!A1\x1b[31m\u202e\udce9"
WORKBENCH = Path(next(iter(endoct.workbench.__path__)))
ROOMS = [WORKBENCH / room for room in ("report", "page", "posing")]


def test_a_text_is_never_markup_nor_a_template() -> None:
    table = rendered("report/plain_table.html", header=["", HOSTILE], rows=[[HOSTILE, HOSTILE]])
    verdict, doubt = Verdict("doubted", HOSTILE, (HOSTILE,), HOSTILE), Doubt("odd", HOSTILE, side=HOSTILE)
    scores = (Score(HOSTILE, HOSTILE, HOSTILE),)
    heading = Heading(HOSTILE, ((HOSTILE, HOSTILE),), verdict, (doubt,), scores, 1, HOSTILE)
    page = printed_page(heading, [Section("s", HOSTILE, table)], HOSTILE)
    said = page.partition("</style>")[2]
    assert "<script" not in said
    assert said.replace("\n", "").isprintable()
    assert "\\x1b[31m\\u202e\\udce9" in said
    assert said.count("&lt;script&gt;alert(1)&lt;/script&gt;") == said.count("{{ 7 * 7 }}{% raw %}") >= 19
    assert "\"'>" not in said
    page.encode()


def test_markup_alone_is_put_in_as_it_is() -> None:
    html = rendered("report/quality.html", side="<i>", measured=Markup("<i>"))
    assert html.endswith('data-side="&lt;i&gt;"></div>\n<i>')


def test_a_name_that_is_missing_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="'measured' is undefined"):
        rendered("report/quality.html", side="oct")


def test_no_template_and_few_modules_say_what_is_safe() -> None:
    for template in chain.from_iterable(room.glob("templates/*.html") for room in ROOMS):
        assert not re.search(r"\|\s*safe|autoescape|\bMarkup\b", template.read_text(encoding="utf-8")), template
    sources = {path: path.read_text(encoding="utf-8") for room in ROOMS for path in room.rglob("*.py")}
    makers = {path.name for path, text in sources.items() if re.search(r"Markup\([^)]", text)}
    assert makers == {"html_templates.py", "heading.py", "manual.py", "report.py"}  # the manuals are our own Markdown
