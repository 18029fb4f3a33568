"""The figures of one tiny simulated bore, as they were published, and whether a machine comes to the same."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from endoct.base.errors import EndoctError
from endoct.fusion.result import Result
from endoct.synthetic.sample.presets import PresetName

PRESET: PresetName = "learning"
SEED = 1


@dataclass(frozen=True)
class Figure:
    """What was published, and by how much other processors and libraries may differ; ``turn``: after so much, again."""

    value: float
    tolerance: float
    unit: str = ""
    turn: float = math.inf


PUBLISHED: Mapping[str, Figure] = MappingProxyType(
    {
        "Jaccard index": Figure(0.843, 0.01),
        "turn": Figure(333.35, 0.5, "°", turn=360.0),
        "shift": Figure(0.289, 0.02, " mm"),
        "observed by both": Figure(0.995, 0.005),
    }
)


def check_figures(result: Result) -> str:
    """Return the figures of the comparison of that bore, the published ones in brackets.

    Raises :class:`EndoctError` where one differs by more than it may.
    """
    place = result.alignment
    if place is None or result.jaccard is None:
        raise EndoctError("this machine cannot align what could be aligned", found=str(result.reason), remedy=_REMEDY)
    turn_deg = math.degrees(place.theta_shift_rad)
    found = dict(zip(PUBLISHED, (result.jaccard, turn_deg, place.z_shift_mm, result.valid_fraction), strict=True))
    for name, published in PUBLISHED.items():
        off = abs(math.remainder(found[name] - published.value, published.turn))
        if not off <= published.tolerance:
            raise EndoctError(
                "this machine comes to other figures",
                found=f"{name} {found[name]:.3f}{published.unit}",
                expected=f"{published.value:.3f} ± {published.tolerance:g}{published.unit}",
                remedy=_REMEDY,
            )
    return ", ".join(f"{name} {found[name]:.3f}{of.unit} ({of.value:.3f})" for name, of in PUBLISHED.items())


_REMEDY = "install the versions in constraints.txt; if it stays so, report it, and your processor"
