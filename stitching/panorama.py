"""The unrolled wall of one bore as one instrument saw it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from endoct.stitching.arrays import Coordinates, Image, Mask, readonly
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.names import plain_name
from endoct.stitching.per_frame import PerFrame, per_frame

SURFACE = ("intensity", "valid", "weight", "depth_mm", "z", "theta")
"""What a panorama's store calls its own; nothing per frame may have such a name."""
_TAKEN = (*SURFACE, "volume")


@dataclass(frozen=True, eq=False)
class Panorama:
    """An unrolled bore wall, rows ascending in z.

    Attributes
    ----------
    grid: the surface grid; where rows are uneven its ``dz_mm`` is the median step.
    intensity, depth_mm, valid, weight: as in :class:`~endoct.stitching.strip.Strip`, on (n_z, n_theta).
    modality: name of the plug-in that made it ("mask" for a mask drawn by hand). It becomes part of the names of
        files, as those of ``frame_dim`` and ``per_frame`` do: a plain name.
    handedness_known, travel_known: whether θ's sense of rotation and z's direction are known; an alignment
        searches what is not.
    frame_dim: "slice", "frame", …: the dimension of ``per_frame``.
    per_frame: quality and geometry per frame, each (n_frames, …), in the order of ascending z; always with
        ``{frame_dim}_z_mm``. ``view_slant``, where a modality gives it: z by which its rays go on for 1 mm beyond
        the wall. Bare arrays mean what their names say, see :func:`~endoct.stitching.per_frame.usual_meaning`.
    provenance: how it was made: parameters, sidecar, versions, input digests. JSON-serialisable.
    notes: what was not trusted, in full sentences.
    doubts: those of the notes that question the whole.

    Arrays are read-only. Raises :class:`EndoctError` where shapes disagree, or a name is no plain one.
    """

    grid: SurfaceGrid
    intensity: Image
    depth_mm: Image | None
    valid: Mask
    weight: Image
    modality: str
    handedness_known: bool
    travel_known: bool
    frame_dim: str = "frame"
    per_frame: Mapping[str, PerFrame] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "intensity", readonly(self.intensity, np.float32))
        set_field(self, "valid", readonly(self.valid, np.bool_))
        set_field(self, "weight", readonly(self.weight, np.float32))
        if self.depth_mm is not None:
            set_field(self, "depth_mm", readonly(self.depth_mm, np.float32))
        set_field(self, "per_frame", per_frame(self.per_frame, {}))
        set_field(self, "notes", tuple(self.notes))
        set_field(self, "doubts", tuple(self.doubts))
        for name in ("intensity", "depth_mm", "valid", "weight"):
            array = getattr(self, name)
            if array is not None and array.shape != self.grid.shape:
                raise EndoctError(
                    f"{name} of a panorama has the wrong shape",
                    found=f"{array.shape}",
                    expected=f"{self.grid.shape} (z, θ)",
                )
        self._check_frames()

    @property
    def z_mm(self) -> Coordinates:
        """Centre of every row, float64 (n_z,), mm, ascending, even or not: the grid's."""
        return self.grid.z_mm

    def _check_frames(self) -> None:
        plain_name(self.modality, "a panorama's modality")
        plain_name(self.frame_dim, "the frames of a panorama")
        for name, one in self.per_frame.items():
            values = one.values
            if plain_name(name, "what a panorama has per frame") in _TAKEN:
                raise EndoctError(f"a panorama cannot have '{name}' per frame", expected="a name that is not taken")
            if values.ndim == 0 or values.dtype.kind not in "biuf":
                raise EndoctError(
                    f"{name} of a panorama cannot be used", found=f"{values.dtype} {values.shape}", expected="numbers"
                )
            if name == f"{self.frame_dim}_z_mm" and values.ndim != 1:
                raise EndoctError(
                    f"{name} of a panorama cannot be used", found=f"{values.shape}", expected="one a frame"
                )
        if len(lengths := {len(one.values) for one in self.per_frame.values()}) > 1:
            found = " and ".join(map(str, sorted(lengths)))
            raise EndoctError("what a panorama has per frame must be of one length", found=found)
