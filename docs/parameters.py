"""Write docs/reference/parameters.md, the table of everything the simulator draws: python docs/parameters.py."""

from pathlib import Path

from pydantic import BaseModel

from endoct.synthetic.sample import parameters
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.ranges import allowed_range, choices, default_ranges

HEAD = """<!-- Made by python docs/parameters.py from endoct.synthetic.sample.parameters; do not edit. -->

# What the simulator draws

Every simulated specimen draws these parameters anew from its seed. "Drawn from" is uniform between two numbers; a
preset may draw from another range (last column). Names with a dot, as `oct.wall_db`, can be varied:
`endoct dataset --vary oct.wall_db=6..14 --vary oct.scan=step|helical …`, within "may be". The others follow from those
and are recorded in `truth/sample.json`.

Where a number comes from stands in brackets:

- "required": every preset must be at least this hard, so that nobody chooses an easy test for himself
- "typical": the usual value of such an instrument
- "rig": the measured OCT rig
- "paper": Laves et al. 2019
- "chosen": no source but plausibility
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
LISTED = (parameters.Cell, parameters.Volume, parameters.SheathLine, parameters.Shadow, parameters.LostAscans,
          parameters.Speck, parameters.Droplet, parameters.Debris)  # fmt: skip


def table() -> str:
    """Return the whole page."""
    blocks = [HEAD]
    for part, model in PARTS.items():
        blocks.append(f"## {part}\n\n{_summary(model)}\n")
        blocks.append("| parameter | drawn from | may be | what | presets |\n|---|---|---|---|---|")
        for name, field in model.model_fields.items():
            path, drawn, may_be = f"{part}.{name}", "", ""
            if name in default_ranges(model):
                drawn, may_be = (_range(pair) for pair in (default_ranges(model)[name], allowed_range(model, name)))
            elif name in choices(model):
                may_be = " or ".join(choices(model)[name])
            else:
                path = name
            others = [f"{p} {_range(preset.ranges[path])}" for p, preset in PRESETS.items() if path in preset.ranges]
            blocks.append(f"| `{path}` | {drawn} | {may_be} | {field.description or ''} | {', '.join(others)} |")
        blocks.append("")
    for model in LISTED:
        blocks.append(f"## {model.__name__}\n\n{_summary(model)}\n")
        blocks.append("| parameter | may be | what |\n|---|---|---|")
        schema = model.model_json_schema()["properties"]
        for name, field in model.model_fields.items():
            limits = schema[name]
            may_be = _range((limits["minimum"], limits["maximum"])) if "maximum" in limits else ""
            blocks.append(f"| `{name}` | {may_be} | {field.description} |")
        blocks.append("")
    return "\n".join(blocks)


def _range(pair: tuple[float, float]) -> str:
    return f"{pair[0]:g}" if pair[0] == pair[1] else f"{pair[0]:g} … {pair[1]:g}"


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    (Path(__file__).parent / "reference" / "parameters.md").write_text(table(), encoding="utf-8")
