"""What a recording of a tube says of an instrument: quantities with standard errors, and what to draw of them."""

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

    Attributes: ``keys`` of the sidecar; ``standard_errors`` of those that are numbers; ``quantities``, for people;
    ``panels`` to draw; ``doubts``, also of what could not be measured.
    """

    keys: Mapping[str, KeyValue]
    standard_errors: Mapping[str, float]
    quantities: tuple[Quantity, ...]
    panels: tuple[Panel, ...]
    doubts: tuple[Doubt, ...] = field(default=())
