"""What ``result.json`` says of the one wall of both sides."""

from typing import Annotated

from pydantic import Field

from endoct.fusion.result.scores import Count, Number, Part


class Contradiction(Part):
    """A cell that the side ``shown_by`` surely shows, where the other side surely shows plain wall.

    ``theta_rad``, ``z_mm``: its middle, in A's frame. ``relief_mm``: its median depth as measured; ``probability``: of
    a cell there by the learned eye, in the median.
    """

    shown_by: str
    theta_rad: Number
    z_mm: Number
    area_mm2: Number
    relief_mm: Number
    probability: Number


class WallSummary(Part):
    """The one wall: its cells, their area and volume with standard errors, and contradictions, largest first."""

    cells: Count
    area_mm2: Number
    area_error_mm2: Number
    volume_mm3: Number
    volume_error_mm3: Number
    contradictions: Annotated[tuple[Contradiction, ...], Field(strict=False)] = ()
