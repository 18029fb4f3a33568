"""Part of the site's build: brings docstrings into the Markdown that it shows."""

import re
from typing import Any

from griffe import Extension, Object

ROLE = re.compile(r":(?:class|func|meth|mod|attr|data|exc):`~?([^`]+)`")
SECTION = re.compile(r"^(\w+)\n-+\n((?:.+\n?)+)", re.MULTILINE)
ITEM = re.compile(r"^([\w, ]+): ", re.MULTILINE)
EXAMPLE = re.compile(r"^>>> (?:.+\n?)+", re.MULTILINE)


class Docstrings(Extension):
    """Shows ``:role:`name``` and examples as code, and an underlined section of ``name: text`` as a list."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Change the docstring of ``obj``."""
        if obj.docstring:
            text = ROLE.sub(r"`\1`", obj.docstring.value)
            text = EXAMPLE.sub(lambda match: f"```pycon\n{match[0].rstrip()}\n```\n", text)
            obj.docstring.value = SECTION.sub(lambda match: f"{match[1]}:\n\n" + ITEM.sub(r"- `\1`: ", match[2]), text)
