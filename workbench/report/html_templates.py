"""The HTML of reports and pages, made by Jinja2 from the ``templates/`` of the rooms of the workbench.

Every text is escaped. Markup is only what templates and the page's own program are made of.
"""

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from markupsafe import Markup

from endoct.workbench.running.refusals import visible_lines

if TYPE_CHECKING:
    from jinja2 import Environment

WORKBENCH = "endoct.workbench"


def rendered(template: str, **values: object) -> Markup:
    """Return the HTML that a template makes of ``values``: "report/figure.html" lies in the templates of the report.

    A name that the template uses and ``values`` lack raises ``jinja2.UndefinedError``.
    """
    return Markup(_environment().get_template(template).render(values))


def rendered_blocks(template: str, **values: object) -> dict[str, Markup]:
    """Return the HTML of every block of a template by the block's name; empty where it has nothing to say."""
    found = _environment().get_template(template)
    context = found.new_context(values)
    return {name: Markup("".join(block(context))) for name, block in found.blocks.items()}


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FunctionLoader, StrictUndefined  # commands that write no page start without it

    environment = Environment(
        loader=FunctionLoader(_source),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        auto_reload=False,
    )
    environment.filters["visible_lines"] = visible_lines
    environment.globals["table"] = vars(environment.get_template("report/table.html").module)["table"]
    return environment


def _source(template: str) -> str:
    room, _, file = template.partition("/")
    return files(f"{WORKBENCH}.{room}.templates").joinpath(file).read_text("utf-8")
