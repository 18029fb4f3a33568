"""The manuals as they ship: every page is there, links lead somewhere, and words have one sentence."""

import re
from pathlib import PurePosixPath

import pytest

from endoct.workbench.report.manual import FOLDERS, manual_page, words
from endoct.workbench.report.sections import PAGE_WORDS


def test_the_contents_lead_to_pages():
    contents = manual_page("")
    assert contents is not None
    listed = re.findall(r'<li><a href="([^"]+)">', contents)
    assert {"index.md", "how-to/page.md", "reference/glossary.md"} <= set(listed)
    assert all(manual_page(name) is not None for name in listed)


@pytest.mark.parametrize("name", ["how-to/not-aligned.md", "reference/result.md", "explanation/alignment.md"])
def test_links_and_anchors_lead_somewhere(name: str):
    page = manual_page(name)
    assert page is not None
    for link in re.findall(r'href="([^":]+\.md[^"]*|#[^"]+)"', page.partition("</p>")[2]):
        path, _, anchor = link.partition("#")
        parts: list[str] = []
        for part in (PurePosixPath(name).parent / path if path else PurePosixPath(name)).parts:
            parts = parts[:-1] if part == ".." else [*parts, part]
        there = manual_page("/".join(parts))
        assert there is not None, link
        assert not anchor or f'id="{anchor}"' in there, link


@pytest.mark.parametrize(
    "name", ["../README.md", "how-to/../index.md", "/etc/passwd", "docs/x.md", "how-to/page", "version.py"]
)
def test_nothing_else_is_served(name: str):
    assert manual_page(name) is None


def test_no_head_of_a_table_is_empty():
    page = manual_page("how-to/page.md")
    assert page is not None
    assert "<td></td>" in page
    assert not re.search(r"<th[^>]*>\s*</th>", page)


def test_markup_in_a_page_is_text():
    page = manual_page("how-to/datasets.md")
    assert page is not None
    assert "<script" not in page
    assert "oct.scan=step|helical" in page


def test_a_note_is_a_note():
    page = manual_page("how-to/clinical-console.md")
    assert page is not None
    assert "<strong>A dry bore.</strong>" in page
    assert "!!!" not in page


def test_words_say_what_they_mean_and_where_to_read_on():
    found = words()
    assert found["jaccard index"].text.startswith("|A ∩ B| / |A ∪ B|: the area")
    assert found["accepted"].page == "explanation/alignment.md#is-it-accepted"
    assert found["sidecar"].page == "reference/sidecar.md"
    assert found["seam-against-start"].page == "reference/result.md#doubts"
    assert {word.lower() for word in PAGE_WORDS} <= found.keys()
    assert {"trusted", "uncertain", "doubt", "not aligned"} <= found.keys()  # what a verdict says
    assert all(manual_page(word.page.partition("#")[0]) is not None for word in found.values())
    assert not [word for word in found.values() if "](" in word.text or "**" in word.text]


def test_every_folder_of_the_manuals_has_pages():
    contents = manual_page("") or ""
    assert all(f'href="{folder}/' in contents for folder in FOLDERS if folder)
