"""Write docs/reference/settings.md, the table of everything but the sidecar's keys that `--set` takes.

Run as python docs/settings.py.
"""

from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from endoct.fusion.parameters import CompareParameters
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.oct.parameters import OctParameters
from endoct.workbench.sides.recipes import RECIPES

HEAD = """<!-- Made by python docs/settings.py from the parameters themselves; do not edit. -->

# Settings

Everything that `--set`, `--set-a` and `--set-b` take, with the values that are used unless you give others. The
defaults are what all published figures were obtained with. A key of a recording's [sidecar](sidecar.md) can be replaced
in the same way. Words that you do not know are in the [glossary](glossary.md).
"""
PARTS: dict[str, type[BaseModel]] = {
    "The comparison: `endoct compare … --set KEY=VALUE`": CompareParameters,
    "An OCT recording: `endoct unroll … --set`, `endoct compare … --set-a`, `--set-b`": OctParameters,
    "An endoscope's recording: likewise": EndoscopeParameters,
}
RECIPES_HEAD = """## Recipes

`--recipe NAME` of `endoct compare` and `endoct unroll` stands for these settings. What is set besides wins over them.

| recipe | of | settings |
|---|---|---|"""
PARTS_OF_RECIPES = {"oct": "an OCT recording", "endoscope": "an endoscope's recording", "compare": "the comparison"}


def table() -> str:
    """Return the whole page."""
    blocks = [HEAD]
    for title, model in PARTS.items():
        blocks.append(f"## {title}\n\n| key | default | what |\n|---|---|---|")
        for name, field in model.model_fields.items():
            default = "" if field.default is None else f"`{str(field.default).lower()}`"
            blocks.append(f"| `{name}` | {default} | {_description(field).replace('|', chr(92) + '|')} |")
        blocks.append("")
    blocks.append(RECIPES_HEAD)
    for name, parts in RECIPES.items():
        for part, settings in parts.items():
            said = ", ".join(f"`{key}={str(value).lower()}`" for key, value in settings.items())
            blocks.append(f"| `{name}` | {PARTS_OF_RECIPES[part]} | {said or 'as they are anyway'} |")
    return "\n".join(blocks) + "\n"


def _description(field: FieldInfo) -> str:
    """Return what a parameter is and, where it is one of a few words, which."""
    about = field.description or ""
    if get_origin(field.annotation) is not Literal:
        return about
    return f"{about}. One of " + ", ".join(f"`{word}`" for word in get_args(field.annotation))


if __name__ == "__main__":
    (Path(__file__).parent / "reference" / "settings.md").write_text(table(), encoding="utf-8")
