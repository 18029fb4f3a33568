"""The page as HTML: heading and sections are there before any program runs, and without one."""

from collections.abc import Sequence
from html import escape

from endoct.workbench.page.heading import Heading, Link, heading_html
from endoct.workbench.report.sections import Section, sections_html
from endoct.workbench.running.refusals import visible_lines

RESEARCH = "Research software and no medical device."


def document(
    heading: Heading,
    sections: Sequence[Section],
    *,
    head: str,
    remark: str = "",
    above: Link | None = None,
    has_panes: bool = True,
) -> str:
    """Return the page; ``head`` is HTML, by which its style and program come. ``remark`` is said at its end.

    ``above`` leads to what it is one of. ``has_panes``: whether a program shows panes there.
    """
    panes = "<noscript><p>Where JavaScript is allowed, panes to explore the wall stand here.</p></noscript>\n"
    ready = "" if has_panes else " ready"  # a program folds the sections before they are shown
    by = f"Made by endoct {heading.endoct}. " if heading.endoct else ""
    said = (
        f"<title>{escape(f'endoct: {heading.title}')}</title>\n</head>\n<body>\n"
        f"{heading_html(heading, sections, above)}"
        f"{panes if has_panes else ''}"
        f'<section class="more{ready}" aria-label="details">\n{"".join(sections_html(sections))}'
        f"<footer>{escape(by + remark)} {RESEARCH}</footer>\n</section>\n"
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n{head}'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"{visible_lines(said)}"  # a text from a file turns nothing around, and can be encoded
        "</body>\n</html>\n"
    )
