"""Write docs/reference/settings.md, the table of everything but the sidecar's keys that `--set` takes.

Run as python docs/settings.py.
"""

from pathlib import Path

from pydantic import BaseModel

from endoct.fusion.parameters import CompareParameters
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.oct.parameters import OctParameters

HEAD = """# Settings

Made by `python docs/settings.py` from the parameters themselves; do not edit. The defaults are what all published
figures were obtained with. A key of a recording's [sidecar](sidecar.md) can be replaced in the same way.
"""
PARTS: dict[str, type[BaseModel]] = {
    "The comparison: `endoct compare … --set KEY=VALUE`": CompareParameters,
    "An OCT recording: `endoct unroll … --set`, `endoct compare … --set-a`, `--set-b`": OctParameters,
    "An endoscope's recording: likewise": EndoscopeParameters,
}


def table() -> str:
    """Return the whole page."""
    blocks = [HEAD]
    for title, model in PARTS.items():
        blocks.append(f"## {title}\n\n| key | default | what |\n|---|---|---|")
        for name, field in model.model_fields.items():
            default = "" if field.default is None else f"`{str(field.default).lower()}`"
            blocks.append(f"| `{name}` | {default} | {(field.description or '').replace('|', chr(92) + '|')} |")
        blocks.append("")
    return "\n".join(blocks)


if __name__ == "__main__":
    (Path(__file__).parent / "reference" / "settings.md").write_text(table(), encoding="utf-8")
