"""Write docs/reference/parameters.md, the table of everything the simulator draws: python docs/parameters.py."""

from pathlib import Path

from pydantic import BaseModel

from endoct.synthetic.sample import parameters
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.ranges import choices, default_ranges

HEAD = """<!-- Made by python docs/parameters.py from endoct.synthetic.sample.parameters; do not edit. -->

# What the simulator draws

Every specimen draws these parameters from its seed, uniformly within "drawn from", or within the range of its preset.
To draw some from another range:

    endoct dataset --vary oct.wall_db=6..14 --vary 'oct.scan=step|helical' …

`truth/sample.json` has what was drawn, and what follows from it: every cell, speck of dirt and place of a frame
(`endoct.synthetic.sample.parameters` describes these fields).

Units are in the names. Brackets say where a number comes from; without them, it is merely plausible.

- "required": every preset must be at least this hard
- "typical": the usual value of such an instrument
- "rig": the measured OCT rig
- "paper": Laves et al. 2019
"""
PARTS: dict[str, type[BaseModel]] = {
    "bore": parameters.Bore,
    "network": parameters.Network,
    "tube": parameters.Tube,
    "density": parameters.Density,
    "ct": parameters.Ct,
    "oct": parameters.Oct,
    "endoscope": parameters.Endoscope,
}
TABLE = "| parameter | drawn from | what |\n|---|---|---|"


def table() -> str:
    """Return the whole page."""
    blocks = [HEAD]
    for part, model in PARTS.items():
        drawn = [name for name in model.model_fields if name in default_ranges(model) or name in choices(model)]
        blocks.append(f"## {part}\n\n{_summary(model)}\n\n{TABLE}")
        blocks += [_row(part, model, name) for name in drawn]
        blocks.append("")
    return "\n".join(blocks).rstrip() + "\n"


def _row(part: str, model: type[BaseModel], name: str) -> str:
    path, what = f"{part}.{name}", _described(model, name)
    by_range: dict[str, list[str]] = {}
    for preset, of in PRESETS.items():
        if path in of.ranges:
            by_range.setdefault(_range(of.ranges[path]), []).append(f"`{preset}`")
    what += "".join(f"; {', '.join(presets)}: {range_}" for range_, presets in by_range.items())
    if name in choices(model):
        return f"| `{path}` | {' or '.join(choices(model)[name])} | {what} |"
    return f"| `{path}` | {_range(default_ranges(model)[name])} | {what} |"


def _described(model: type[BaseModel], name: str) -> str:
    """Return what a parameter is. That it was chosen need not be said: so are all without a source."""
    return (model.model_fields[name].description or "").replace(" (chosen)", "")


def _range(pair: tuple[float, float]) -> str:
    return f"{pair[0]:g}" if pair[0] == pair[1] else f"{pair[0]:g}..{pair[1]:g}"


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    (Path(__file__).parent / "reference" / "parameters.md").write_text(table(), encoding="utf-8")
