"""What every A-scan of a pullback meets."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.synthetic.model import Model
from endoct.synthetic.oct.beams import Echoes
from endoct.synthetic.oct.bscan import ascan_echoes
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS


@dataclass(frozen=True, eq=False)
class Pullback:
    """Arrays (slice, A-scan) in the order recorded; float32 unless said otherwise, NaN where there is no such thing.

    ``theta_rad``, ``z_mm``, ``radius_mm``: the place in the bore frame where the beam meets the first solid
    surface (θ and z of the beam where it meets none). ``inner_face_row``, ``outer_face_row``, ``fluid_row``,
    ``surface_row``, ``exit_row``, ``reentry_row``: depth samples, fractional, of the capillary's faces, a fluid's
    surface, the first solid surface, and where the beam leaves a thin septum and meets bone again; they may lie
    beyond the last sample recorded. ``cell_id`` int32: 1 + index of the cell the surface belongs to, 0 on the
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
