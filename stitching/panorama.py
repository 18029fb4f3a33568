"""The unrolled wall of one bore as one instrument saw it.

:class:`AxialScale` says what the panorama's scale along the bore rests on. A panorama that shows too little of the
wall raises a doubt.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.doubt import Doubt, as_doubt, without_doubts
from endoct.base.errors import EndoctError
from endoct.base.files.files import plain_name
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.per_frame import PerFrame, per_frame
from endoct.stitching.strip import DEPTHS, settle_images

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

FORMAT = "endoct-panorama-1"
SURFACE = ("intensity", "valid", "weight", "depth_mm", "parallax_depth_mm", "parallax_error_mm", "z", "theta")
"""These are the names of a panorama's own arrays in its store. Values per frame may have none of them."""
_TAKEN = (*SURFACE, "volume")
TRAVEL_BY_DEFAULT = "travel_by_default"
"""Under this name a panorama's provenance has the direction of travel that no sidecar, file or setting states."""
LEAST_VALID_SHARE = 0.9
"""A panorama is doubted where less of it than this was observed."""


@dataclass(frozen=True)
class AxialScale:
    """What z, in mm, was taken from.

    Attributes
    ----------
    stated: the keys of the sidecar to which z is proportional, with their values, > 0. It is empty where there is no
        such key, as for positions of every frame.
    checked: whether the recording itself measures what is stated, as a feed that is seen in the images does. What that
        says against it is a doubt of the panorama.

    Raises :class:`EndoctError` for a value that is not a positive number.
    """

    stated: Mapping[str, float] = field(default_factory=dict)
    checked: bool = False

    def __post_init__(self) -> None:
        for key, value in self.stated.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
                raise EndoctError(
                    f"'{key}' cannot scale a panorama", found=repr(value)[:80], expected="a positive number"
                )

    def to_json(self) -> dict[str, Any]:
        """Return it as a panorama's store has it."""
        return {"stated": dict(self.stated), "checked": self.checked}


@dataclass(frozen=True, eq=False)
class Panorama:
    """An unrolled bore wall, rows ascending in z.

    Attributes
    ----------
    grid: the surface grid; where rows are uneven its ``dz_mm`` is the median step.
    intensity, depth_mm, valid, weight: as in :class:`~endoct.stitching.strip.Strip`, on (n_z, n_theta).
    parallax_depth_mm, parallax_error_mm: depth by parallax and its standard error, float32 (n_z, n_theta), both NaN
        where that is not known; None where nobody looked. ``depth_mm`` is known wherever ``valid``, these are not.
    modality: name of the plug-in that made it ("mask" for a mask drawn by hand). It becomes part of the names of
        files, as those of ``frame_dim`` and ``per_frame`` do: a plain name.
    handedness_known, travel_known: whether θ's sense of rotation and z's direction are known; an alignment
        searches what is not.
    frame_dim: "slice", "frame", …: the dimension of ``per_frame``.
    per_frame: quality and geometry per frame, each (n_frames, …), in the order of ascending z; always with
        ``{frame_dim}_z_mm``. ``view_slant``, where a modality gives it: z by which its rays go on for 1 mm beyond
        the wall. Bare arrays mean what their names say, see :func:`~endoct.stitching.per_frame.usual_meaning`.
    provenance: how it was made: parameters, sidecar, versions, input digests. JSON-serialisable.
    doubts: what questions the whole; a plain sentence becomes a doubt without a code of its own.
    notes: what is to be known of some frames or rows, in full sentences; none repeats a doubt.
    axial_scale: what the scale of z rests on.

    Arrays are read-only. Raises :class:`EndoctError` where shapes disagree, or a name is no plain one.

    >>> import numpy as np
    >>> grid = SurfaceGrid.full_circle(20, 360, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    >>> image = np.ones(grid.shape, np.float32)
    >>> observed = np.broadcast_to(grid.z_mm[:, np.newaxis] < 3, grid.shape)
    >>> Panorama(grid, image, None, observed, image, "endoscope", handedness_known=True, travel_known=True)
    <Panorama of endoscope: 20 × 360 (z, θ), z 0.00 to 3.80 mm, bore ⌀ 2.5 mm, 75.0% valid, without depth>
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
    doubts: tuple[Doubt, ...] = ()
    axial_scale: AxialScale = field(default_factory=AxialScale)
    parallax_depth_mm: Image | None = None
    parallax_error_mm: Image | None = None

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        settle_images(self, "panorama", self.grid.shape, "z, θ")
        set_field(self, "per_frame", per_frame(self.per_frame, {}))
        set_field(self, "doubts", tuple(dict.fromkeys(as_doubt(one) for one in self.doubts)))
        set_field(self, "notes", without_doubts(tuple(self.notes), self.doubts))
        self._check_frames()

    @property
    def z_mm(self) -> Coordinates:
        """Centre of every row, float64 (n_z,), mm, ascending, even or not: the grid's."""
        return self.grid.z_mm

    def __repr__(self) -> str:
        depth = "with depth" if self.depth_mm is not None else "without depth"
        facts = (
            f"{self.grid.n_z} × {self.grid.n_theta} (z, θ), {self._extent()}, {self.valid.mean():.1%} valid, {depth}"
        )
        return f"<Panorama of {self.modality}: {facts}>"

    def _repr_html_(self) -> str:
        from endoct.stitching.notebook import card, wall_picture

        facts = {
            "rows × columns": f"{self.grid.n_z} × {self.grid.n_theta} (z, θ)",
            "extent": self._extent(),
            "valid": f"{self.valid.mean():.1%}",
            "depth": "yes" if self.depth_mm is not None else "no",
        }
        for title, said in (("doubts", [doubt.what for doubt in self.doubts]), ("notes", self.notes)):
            if said:
                facts[title] = said[0] + (f" (and {len(said) - 1} more)" if said[1:] else "")
        picture = wall_picture(self.grid, self.intensity, self.valid)
        return card(f"Panorama of {self.modality}", facts, [("intensity: θ across, z inward down", picture)])

    def _extent(self) -> str:
        return f"z {self.z_mm[0]:.2f} to {self.z_mm[-1]:.2f} mm, bore ⌀ {2 * self.grid.radius_mm:.3g} mm"

    def to_xarray(self) -> "xarray.Dataset":
        """Return the panorama as ``xarray.open_zarr`` reads its store: dims (z, theta), coordinates in mm and rad.

        Variables ``intensity``, ``valid``, ``weight`` and, where there is depth, ``depth_mm``, or that by parallax; the
        values per frame on the dim named ``frame_dim``.
        """
        import xarray

        variables = self.variables()
        coordinates = {"z", "theta", f"{self.frame_dim}_z_mm"}
        return xarray.Dataset(
            {name: variable for name, variable in variables.items() if name not in coordinates},
            {name: variable for name, variable in variables.items() if name in coordinates},
            self.attributes(),
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot the intensity, z in mm against θ in degrees, into ``ax`` or a new figure; return the axes.

        What was not observed stays pale blue. Needs matplotlib only when it is called.
        """
        from endoct.stitching.notebook import draw_wall, new_wall_axes

        axes = ax if ax is not None else new_wall_axes(self.grid)[0]
        image = draw_wall(axes, self.grid, self.intensity, self.valid)
        axes.figure.colorbar(image, ax=axes, label="intensity (a.u.)")
        axes.set_title(self.modality, loc="left")
        return axes

    def variables(self) -> dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, str]]]:
        """Return every array by its name in a store: its dims, its values and its attributes, such as units."""
        surface, units_mm = ("z", "theta"), {"units": "mm"}
        variables: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, str]]] = {
            "intensity": (surface, self.intensity, {}),
            "valid": (surface, self.valid, {}),
            "weight": (surface, self.weight, {}),
            "z": (("z",), self.z_mm, units_mm),
            "theta": (("theta",), self.grid.theta_rad, {"units": "rad"}),
        }
        for name in DEPTHS:
            if (depth := getattr(self, name)) is not None:
                variables[name] = (surface, depth, units_mm)
        for name, one in self.per_frame.items():
            dims = (self.frame_dim, *(f"{name}_{axis}" for axis in range(1, one.values.ndim)))
            variables[name] = (dims, one.values, one.attributes())
        return variables

    def attributes(self) -> dict[str, Any]:
        """Return what a store says of the panorama as a whole, JSON-serialisable."""
        return {
            "format": FORMAT,
            "modality": self.modality,
            "frame_dim": self.frame_dim,
            "handedness_known": self.handedness_known,
            "travel_known": self.travel_known,
            "axial_scale": json.dumps(self.axial_scale.to_json()),
            **grid_attributes(self.grid),
            "provenance": json.dumps(
                {**self.provenance, "notes": list(self.notes), "doubts": [doubt.to_json() for doubt in self.doubts]}
            ),
        }

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


def doubts_of_observed(panorama: Panorama) -> tuple[Doubt, ...]:
    """Return the doubts that a panorama shows too little wall, or one row of it, unless it says so already."""
    share, doubts = float(panorama.valid.mean()), []
    if share < LEAST_VALID_SHARE:
        what = f"Only {share:.1%} of the panorama is observed wall."
        doubts.append(Doubt("little-observed", what, value=share, unit="1", expected=(LEAST_VALID_SHARE, 1.0)))
    if panorama.grid.n_z == 1:
        what = "The panorama has one row alone: nothing shows how cells go on along the bore, nor where it lies there."
        doubts.append(Doubt("one-row", what, value=1.0, unit="1", expected=2.0))
    said = {doubt.code for doubt in panorama.doubts}
    return tuple(doubt for doubt in doubts if doubt.code not in said)
