"""What a recording of a tube says of an instrument: quantities with standard errors, what to draw of them, doubts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt

KeyValue = str | float | tuple[float, ...] | Mapping[str, float]


@dataclass(frozen=True)
class Quantity:
    """One number that was measured, with its standard error; ``name`` is the key of the sidecar where there is one."""

    name: str
    title: str
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, eq=False)
class Panel:
    """One panel of the figure: points ``y`` (n,) at ``x`` (n,), and the model's ``line`` (m, 2), if any."""

    title: str
    x_label: str
    y_label: str
    x: Coordinates
    y: Coordinates
    line: Coordinates | None = None


@dataclass(frozen=True, eq=False)
class Measurement:
    """All that a recording of a tube says of its instrument.

    Attributes: ``keys`` of the sidecar; ``quantities``, for people; ``panels`` to draw; ``doubts``, also of what could
    not be measured.
    """

    keys: Mapping[str, KeyValue]
    quantities: tuple[Quantity, ...]
    panels: tuple[Panel, ...]
    doubts: tuple[Doubt, ...] = field(default=())

    @property
    def standard_errors(self) -> Mapping[str, float]:
        """Standard errors of those keys that are quantities, by name."""
        return {each.name: each.sigma for each in self.quantities if each.name in self.keys}


def doubts_of_travel(stated: str, inward: bool, also: str = "") -> tuple[Doubt, ...]:
    """Return the doubt of a stated travel that the order of the rings contradicts; ``also``: what is wrong then."""
    if stated == "unknown" or (stated == "in") == inward:
        return ()
    return (
        Doubt(
            "travel-against-tube",
            f"The rings come in the order of a travel '{'in' if inward else 'out'}', the sidecar says '{stated}': one "
            f"of them is wrong, or the instrument came in at the tube's other end{also}.",
        ),
    )


def doubts_of_origin(spread_rad: float, sure_rad: float, because: str) -> tuple[Doubt, ...]:
    """Return the doubt of an origin of θ that spread by more than ``sure_rad``; ``because``: how, with {degrees}."""
    if spread_rad <= sure_rad:
        return ()
    said = because.format(degrees=f"{math.degrees(spread_rad):.0f}°")
    return (Doubt("origin-not-kept", said, value=spread_rad, unit="rad"),)
