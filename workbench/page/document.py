"""The page as HTML: heading and sections are there before any program runs, and without one."""

from collections.abc import Sequence
from importlib.resources import files

from markupsafe import Markup

from endoct.workbench.page.heading import Heading, Link
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.sections import Section

RESEARCH = "Research software and no medical device."


def document(
    template: str,
    heading: Heading,
    sections: Sequence[Section],
    *,
    remark: str = "",
    above: Link | None = None,
    **values: object,
) -> Markup:
    """Return the page that a ``template`` makes of ``values``, by which its style and program come.

    ``above`` leads to what it is one of; ``remark`` is said at its end.
    """
    said = {"heading": heading, "sections": sections, "remark": remark, "above": above}
    return rendered(template, title=heading.title, research=RESEARCH, **said, **values)


def printed_page(heading: Heading, sections: Sequence[Section], remark: str) -> Markup:
    """Return a page that needs no other file, and has no program; ``remark`` is said at its end."""
    return document("page/printed.html", heading, sections, remark=remark, style=bundled("page.css"))


def bundled(name: str) -> Markup:
    """Return the page's own style, or one of its programs, to be put into a page as it is."""
    return Markup(files("endoct.workbench.page").joinpath("bundle", name).read_text("utf-8"))
