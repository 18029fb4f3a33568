"""Labels of the pullback: what every A-scan meets, layers, artefacts, noise-free twins, and pixels that saw the same.

Artefacts are what a B-scan shows besides bone: lines of the instrument and of the detector, and their ghosts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Protocol

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import Advance, thread_map
from endoct.base.zarr.zarr_store import consolidate, new_array, write_arrays
from endoct.synthetic.model import Model
from endoct.synthetic.oct.beams import Echoes
from endoct.synthetic.oct.bscan import artificial, ascan_echoes, noise_free
from endoct.synthetic.oct.scattered_field import N_FACES, N_GHOSTS
from endoct.synthetic.oct.spectrometer import spectrometer
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS

FLAGS = (
    "1 capillary face or its ghost",
    "2 sheath or catheter",
    "4 detector line",
    "8 autocorrelation",
    "16 saturated A-scan",
)
FACE, CATHETER, DETECTOR, AUTOCORRELATION, SATURATED = 1, 2, 4, 8, 16
FAINTEST_DB = 0.0
"""Artefacts fainter than the noise are not visible and are not labelled."""
ASCAN = ("slice", "ascan")
LAYERS = {
    "theta_rad": (ASCAN, "f4", "where the beam meets the first solid surface: θ in the bore frame, rad"),
    "z_mm": (ASCAN, "f4", "and z, mm from the mouth"),
    "radius_mm": (ASCAN, "f4", "and its distance from the bore's axis; NaN where none is within reach"),
    "inner_face_row": (ASCAN, "f4", "depth sample of the capillary's inner face"),
    "outer_face_row": (ASCAN, "f4", "depth sample of the capillary's outer face"),
    "fluid_row": (ASCAN, "f4", "depth sample of a fluid's surface, NaN where there is none"),
    "surface_row": (ASCAN, "f4", "depth sample of the first solid surface, may lie beyond the last sample"),
    "exit_row": (ASCAN, "f4", "depth sample at which the beam leaves a thin septum, NaN where it does not"),
    "reentry_row": (ASCAN, "f4", "depth sample at which it meets bone again"),
    "cell_id": (ASCAN, "i4", "1 + index in sample.json of the cell whose surface it is, 0 on the bore's own wall"),
    "dust": (ASCAN, "b1", "the surface is bone dust"),
    "shadow_db": (ASCAN, "f4", "light lost to dirt on the capillary, dB"),
}
OTHERS = {
    "artefact": (("slice", "depth", "ascan"), "u1", "what is not bone, bit flags: " + ", ".join(FLAGS)),
    "frame": (ASCAN, "i4", "endoscope frame that sees the same place most squarely, −1 for none"),
    "frame_row": (ASCAN, "i4", "row of the pixel in that frame, −1 for none"),
    "frame_column": (ASCAN, "i4", "column of the pixel in that frame, −1 for none"),
}
Described = Mapping[str, tuple[tuple[str, ...], str, str]]
"""Name → (dims, dtype, what it is)."""


@dataclass(frozen=True, eq=False)
class Pullback:
    """Arrays (slice, A-scan) in the order recorded; float32 unless said otherwise, NaN where there is no such thing.

    ``theta_rad``, ``z_mm``, ``radius_mm``: where the beam meets the first solid surface, in the bore frame. Where it
    meets none, θ and z are those of the beam. The rows are depth samples, fractional, and may lie beyond the last one
    recorded. ``inner_face_row``, ``outer_face_row``: of the capillary's faces; ``fluid_row``: of a fluid's surface;
    ``surface_row``: of the first solid surface. ``exit_row``, ``reentry_row``: where the beam leaves a thin septum, and
    meets bone again. ``cell_id`` int32: 1 + index of the cell the surface belongs to, 0 on the
    bore's own wall. ``dust``: that surface is bone dust. ``shadow_db``: light lost to dirt on the capillary.
    """

    theta_rad: Image
    z_mm: Image
    radius_mm: Image
    inner_face_row: Image
    outer_face_row: Image
    fluid_row: Image
    surface_row: Image
    exit_row: Image
    reentry_row: Image
    cell_id: NDArray[np.int32]
    dust: Mask
    shadow_db: Image


def look_along(model: Model, workers: int) -> Pullback:
    """Return what all A-scans meet, also those between the columns that the renderer traces."""
    sample = model.sample
    slices = thread_map(lambda i: ascan_echoes(sample, model.wall, i), range(PRESETS[sample.preset].n_slices), workers)
    parts = [_of_slice(sample, echoes) for echoes in slices]
    return Pullback(
        **{field.name: np.stack([getattr(part, field.name) for part in parts]) for field in fields(Pullback)}
    )


def _of_slice(sample: Sample, echoes: Echoes) -> Pullback:
    def row(path_mm: Coordinates) -> Image:
        return ((path_mm - sample.oct.first_sample_mm) / sample.oct.axial_pixel_mm).astype(np.float32)

    return Pullback(
        theta_rad=echoes.wall_theta_rad.astype(np.float32),
        z_mm=echoes.wall_z_mm.astype(np.float32),
        radius_mm=echoes.wall_radius_mm.astype(np.float32),
        inner_face_row=row(echoes.inner_path_mm),
        outer_face_row=row(echoes.outer_path_mm),
        fluid_row=row(echoes.fluid_path_mm),
        surface_row=row(echoes.wall_path_mm),
        exit_row=row(echoes.exit_path_mm),
        reentry_row=row(echoes.reentry_path_mm),
        cell_id=echoes.cell.astype(np.int32),
        dust=echoes.dust,
        shadow_db=echoes.shadow_db.astype(np.float32),
    )


def artefacts(model: Model, slice_index: int) -> NDArray[np.uint8]:
    """Return the bit ``FLAGS`` of artefacts brighter than the noise, u8 (depth, A-scan).

    A line covers the samples within its full width at half maximum, wherever it appears: mirrored ones too.
    """
    size, oct_ = PRESETS[model.sample.preset], model.sample.oct
    light, column, saturated = artificial(model.sample, model.wall, model.appearance, slice_index)
    n, unit = 2 * size.n_depth, spectrometer(oct_, 2 * size.n_depth).unit
    flags = np.zeros((size.n_depth, light.delay_px.shape[1]), np.uint8)
    reach_px = oct_.axial_resolution_mm / oct_.axial_pixel_mm
    with np.errstate(divide="ignore"):
        level_db = 20 * np.log10(np.abs(light.amplitude) / unit)
    instrument = N_FACES + len(oct_.sheath) + 1
    own = instrument + N_GHOSTS
    for k in range(light.delay_px.shape[0]):
        if k < own or k >= light.n_optical:
            kind = FACE if k < N_FACES else CATHETER if k < instrument else FACE if k < own else DETECTOR
            _draw(flags, light.delay_px[k], level_db[k] > FAINTEST_DB, n, reach_px, kind)
    for k in range(instrument):
        for other in range(k):
            # |E|² against 2·Re E: the product of two amplitudes compares with twice one
            ghost_db = level_db[k] + level_db[other] + 20 * np.log10(unit)
            apart = light.delay_px[k] - light.delay_px[other]
            _draw(flags, apart, ghost_db > FAINTEST_DB, n, reach_px, AUTOCORRELATION)
    flags = flags[:, column]
    flags[:, saturated] |= SATURATED
    return flags


def _draw(flags: NDArray[np.uint8], delay_px: Coordinates, visible: Mask, n: int, reach_px: float, kind: int) -> None:
    """Set ``kind`` around where a path difference shows, folded at zero delay and at full depth, in place."""
    row = np.abs(np.mod(delay_px + n / 2, n) - n / 2)
    for k in range(-int(reach_px) - 1, int(reach_px) + 2):
        at = np.rint(row).astype(np.intp) + k
        drawn = np.flatnonzero(visible & (np.abs(at - row) <= reach_px) & (at >= 0) & (at < flags.shape[0]))
        flags[at[drawn], drawn] |= kind


def write_oct_labels(
    folder: Path, model: Model, pullback: Pullback, pixels: NDArray[np.int32], advance: Advance, workers: int
) -> None:
    """Write ``oct.zarr`` and the noise-free twins ``oct_clean.tif``.

    ``pixels`` (3, slice, A-scan): frame, row and column of the pixel that sees the same place, −1 for none.
    """
    sample, size = model.sample, PRESETS[model.sample.preset]
    sizes = {"slice": size.n_slices, "depth": size.n_depth, "ascan": size.n_ascans}
    arrays = create(folder / "oct.zarr", sizes, LAYERS | OTHERS, {"axial_pixel_mm": sample.oct.axial_pixel_mm})
    for name in LAYERS:
        arrays[name][:] = getattr(pullback, name)
    for name, values in zip(("frame", "frame_row", "frame_column"), pixels, strict=True):
        arrays[name][:] = values

    def twin(i: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        return noise_free(sample, model.wall, model.appearance, i), artefacts(model, i)

    with tifffile.TiffWriter(
        folder / "oct_clean.tif", bigtiff=size.n_slices * size.n_depth * size.n_ascans > 2**31
    ) as tiff:
        for i, (clean, flags) in enumerate(thread_map(twin, range(size.n_slices), workers)):
            tiff.write(clean, photometric="minisblack", contiguous=True, metadata={"axes": "ZYX"})
            arrays["artefact"][i] = flags
            advance((i + 1) / size.n_slices)
    consolidate(folder / "oct.zarr")


class Writable(Protocol):
    """An array on disk."""

    def __setitem__(self, index: int | slice, values: NDArray[np.generic], /) -> None: ...


def create(path: Path, sizes: Mapping[str, int], arrays: Described, attrs: Mapping[str, object]) -> dict[str, Writable]:
    """Create a store and return its empty arrays by name, one frame a chunk; consolidate it once they are filled."""
    group = write_arrays(path, {}, attrs)
    made: dict[str, Writable] = {}
    for name, (dims, dtype, about) in arrays.items():
        of_array = {dim: sizes[dim] for dim in dims}
        made[name] = new_array(
            group, name, of_array, dtype, chunks=(1, *tuple(of_array.values())[1:]), attributes={"long_name": about},
            fill_value=float("nan") if dtype.startswith("f") else 0,
        )  # fmt: skip
    return made
