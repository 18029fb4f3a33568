"""What can be chosen of an export."""

from dataclasses import dataclass, fields
from typing import Literal

OmeVersion = Literal["0.5", "0.4"]
VOXEL_MM = 0.01
VERTEX_MM = 0.02


@dataclass(frozen=True)
class Options:
    """What a caller chose; None where a format's default is wanted.

    ``color``: the side whose brightness colours a wall, or "relief". ``side``: the side whose relief, or whose numbers
    per frame, are exported. ``voxel_mm``: of a volume, across the bore. ``vertex_mm``: distance of a wall's vertices.
    ``version`` of OME-Zarr. ``inverse``: of a transform, from side A's frame to side B's.
    """

    color: str | None = None
    side: str | None = None
    voxel_mm: float | None = None
    vertex_mm: float | None = None
    version: OmeVersion | None = None
    inverse: bool | None = None

    def given(self) -> tuple[str, ...]:
        """Return the names of those that were chosen."""
        return tuple(one.name for one in fields(self) if getattr(self, one.name) is not None)
