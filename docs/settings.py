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

    endoct unroll specimen/oct -o oct.zarr --set undistort=sine
    endoct compare specimen/endoscope specimen/oct -o result --set tolerance_mm=0.05 --set-b wall=maximum

| option | changes, for one run |
|---|---|
| `unroll … --set KEY=VALUE` | a key of the [sidecar](sidecar.md), or a setting of the unrolling |
| `compare … --set KEY=VALUE` | a setting of the comparison |
| `compare … --set-a`, `--set-b` | as `unroll --set`, for the first and the second side |

A misspelt key is an error that suggests the nearest one. `result.json` and the panorama record what was used. Published
figures were obtained with the defaults.
"""
PARTS: dict[str, type[BaseModel]] = {
    "The comparison: `endoct compare … --set KEY=VALUE`": CompareParameters,
    "An OCT recording: `endoct unroll … --set`, `endoct compare … --set-a`, `--set-b`": OctParameters,
    "An endoscope's recording: likewise": EndoscopeParameters,
}
MIDDLE = """## Another method

Any method that `endoct bench segmentation`, `alignment` or `stitching` [ranks](../how-to/bench.md),
[yours](../how-to/bench.md#add-a-method) among them, can replace endoct's own. A doubt names it, since endoct cannot
judge it.

    endoct compare specimen/endoscope specimen/oct -o other --set segmentation_method=otsu-prepared
    endoct compare specimen/endoscope specimen/oct -o other --set alignment_method=opencv-ecc
    endoct unroll specimen/endoscope -o other.zarr --set feed_method=opencv-ecc-prepared

`feed_method`, which `compare` takes by `--set-a` or `--set-b`, gets the strips of even light, with z counted outward in
the image, and the nominal pitch, which the sidecar must give.

## A setting that raises the score

`--force` accepts the best alignment however little it stands out. Scores obtained so say nothing by themselves. It is
recorded and raises a doubt.

## The paper's pipeline

    endoct compare specimen/endoscope specimen/oct -o literal --recipe paper

is the chain of Laves et al. 2019, literally. Every B-scan is shifted by its sine, the index of the maximum is the
depth, and turns are taken for even. Li's threshold finds the cells of both sides, and the Jaccard index compares them.

- `endoct unroll` takes `--recipe paper` too. An OCT panorama that was unrolled otherwise is refused.
- The paper's own endoscopic cells were drawn by hand: give such [a mask](../how-to/masks.md) as side A.
- The paper says nothing of smoothing, of removing small cells, or of the bounds of relief. They stay as they are.

The recipe stands for these settings; `--set`, `--set-a` and `--set-b` win over it.

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
    blocks.append(MIDDLE)
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
