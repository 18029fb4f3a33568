"""One turn of the beam over the wall: the columns of a slice, what their beams meet, and how bright the wall is there.

The columns lie on the ring that they were taken on, and some things change smoothly around it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.density import BoneDensity, density_of
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.oct.beams import Echoes, capillary_axis_mm, spot_sigma_mm, stream_position, trace_slices
from endoct.synthetic.oct.spectrometer import Spectrometer, spectrometer
from endoct.synthetic.sample.parameters import Oct, Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.randomness import Stage, generator, smooth_field

AROUND = 1024
"""What changes smoothly is drawn at so many places around a turn."""
REACH = 3.0
"""Scatterers are summed across so many σ of the spot."""
BEYOND = 3
"""The interpolation between columns reads so many beyond those recorded."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """Maps (z, θ) of the wall; row k is z = k·``dz_mm``, the columns span a turn.

    ``wall_db``: its scattering against the mean, dB. ``glint_db``: level of specular spots, dB, −60 elsewhere.
    """

    dz_mm: float
    wall_db: Image
    glint_db: Image

    def at(self, image: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
        """Return one of the maps at scattered places (1-D arrays of one length), bilinear, cyclic in θ."""
        rows = np.clip(z_mm / self.dz_mm, 0, image.shape[0] - 1).astype(np.float32)
        columns = (np.mod(theta_rad, 2 * np.pi) / (2 * np.pi) * image.shape[1]).astype(np.float32)
        values = cv2.remap(image, columns[None], rows[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(values[0], dtype=np.float64)


def build_appearance(sample: Sample, wall: Wall, coarser: int = 4) -> Appearance:
    """Return the wall's patches and its specular spots, on the wall's grid made ``coarser`` times coarser."""
    oct_, seed = sample.oct, sample.bore_seed
    n_z, n_theta = (-(-n // coarser) for n in wall.relief_mm.shape)
    dz_mm, dtheta_mm = wall.dz_mm * coarser, 2 * np.pi / n_theta * wall.radius_mm
    wall_db = oct_.patchiness_db * smooth_field(
        generator(seed, Stage.PATCHES, 0), (n_z, n_theta), 0.35 / dz_mm, 0.35 / dtheta_mm
    )
    wall_db += (
        0.5
        * oct_.patchiness_db
        * smooth_field(generator(seed, Stage.PATCHES, 1), (n_z, n_theta), 0.06 / dz_mm, 0.06 / dtheta_mm)
    )
    glint_db = np.full((n_z, n_theta), -60, np.float32)
    z, theta, brighter = generator(seed, Stage.GLINTS).random((oct_.n_glints, 3)).T
    glint_db[(z * n_z).astype(np.intp), (theta * n_theta).astype(np.intp)] = oct_.wall_db + 4 + 12 * brighter
    return Appearance(dz_mm, wall_db, np.asarray(cv2.dilate(glint_db, np.ones((2, 3))), np.float32))


@dataclass(frozen=True, eq=False)
class Turn:
    """The columns of one slice, around the ring they were taken on.

    ``n_ring``: columns to a full turn, after which a beam meets the same bone again. ``first``: place on that ring
    of the first column, negative where it lies before the slice's first A-scan.
    """

    n_ring: int
    first: int
    n: int


def around(rng: Generator, turn: Turn, sigma_turns: float) -> Coordinates:
    """Return a smooth random course around the ring, rms 1, at every column."""
    spectrum = fft.rfft(rng.standard_normal(AROUND, dtype=np.float32))
    spectrum *= _smoothing(sigma_turns)
    course = fft.irfft(spectrum)
    course /= np.sqrt(np.mean(np.square(course, dtype=np.float64)))
    place = np.mod((turn.first + np.arange(turn.n)) * (AROUND / turn.n_ring), AROUND)
    values: Coordinates = np.interp(place, np.arange(AROUND + 1), np.append(course, course[0]))
    return values


@lru_cache(maxsize=16)
def _smoothing(sigma_turns: float) -> Image:
    """Return a Gaussian's response at each frequency around the ring, 0 for the mean."""
    left = np.exp(-0.5 * (2 * np.pi * sigma_turns * np.arange(AROUND // 2 + 1)) ** 2).astype(np.float32)
    left[0] = 0
    left.flags.writeable = False
    return np.asarray(left)


@dataclass(frozen=True, eq=False)
class Sweep:
    """The instrument, the columns of one slice, and what their beams meet; arrays have one value a column.

    ``echoes``: surfaces. ``wall_db`` and ``glint_db``: how brightly the wall and its specular spots scatter there, see
    :class:`endoct.synthetic.oct.sweep.Appearance`. ``radius_mm``: of the bore. ``catheter_mm``: off the bore's
    axis, x + iy; ``lean``: by how much it moves off the capillary's axis for each mm along it, the same way.
    ``density``: of the bone, None where it is even.
    ``seed`` and ``bore_seed`` key what is random of the recording and of the bone.
    """

    oct_: Oct
    spectrometer: Spectrometer
    turn: Turn
    echoes: Echoes
    wall_db: Coordinates
    glint_db: Coordinates
    radius_mm: float
    catheter_mm: complex
    lean: complex
    density: BoneDensity | None
    seed: int
    bore_seed: int
    slice_index: int


def sweeps(
    sample: Sample, wall: Wall, appearance: Appearance, slices: Sequence[int]
) -> Iterator[tuple[Sweep, NDArray[np.intp]]]:
    """Yield for each of ``slices`` its sweep, and of the A-scans recorded how many were taken before each.

    Columns lie ``ascans_per_column`` of the preset apart; the first −``turn.first`` of them, and as many last, are a
    margin beyond the A-scans.
    """
    oct_, size = sample.oct, PRESETS[sample.preset]
    every, one = size.ascans_per_column, spectrometer(oct_, 2 * size.n_depth)
    taken = [stream_position(oct_, i, size.n_ascans) for i in slices]
    rings = [round(size.n_ascans / every / oct_.turn_length[i]) for i in slices]
    widest_mm = REACH * float(spot_sigma_mm(oct_, np.array([2 * wall.radius_mm]))[0])
    margins = [math.ceil(widest_mm / (2 * np.pi * wall.radius_mm / n_ring)) + BEYOND for n_ring in rings]
    columns = [
        np.arange(-margin, -(-int(position[-1] + 1) // every) + margin, dtype=np.float64)
        for position, margin in zip(taken, margins, strict=True)
    ]
    # a column stands for the middle of its A-scans
    traced = trace_slices(sample, wall.scene, slices, [(k + 0.5) * every - 0.5 for k in columns])
    offset_mm = np.array(oct_.offset_mm) * np.exp(1j * np.array(oct_.offset_direction_rad))
    lean = _slope(offset_mm, np.array(oct_.z_mm))
    for i, position, n_ring, margin, echoes in zip(slices, taken, rings, margins, traced, strict=True):
        n = echoes.alpha_rad.size
        # one turn on, a helical scan is a pitch away
        turn = Turn(n if oct_.scan == "helical" else n_ring, -margin, n)
        wall_db, glint_db = (
            appearance.at(image, echoes.wall_z_mm, echoes.wall_theta_rad)
            for image in (appearance.wall_db, appearance.glint_db)
        )
        axis_x, axis_y = capillary_axis_mm(sample.bore, np.array([oct_.z_mm[i]]))
        yield (
            Sweep(
                oct_=oct_,
                spectrometer=one,
                turn=turn,
                echoes=echoes,
                wall_db=wall_db,
                glint_db=glint_db,
                radius_mm=wall.radius_mm,
                catheter_mm=complex(axis_x[0], axis_y[0]) + complex(offset_mm[i]),
                lean=complex(lean[i]),
                density=density_of(sample),
                seed=sample.seed,
                bore_seed=sample.bore_seed,
                slice_index=i,
            ),
            position,
        )


def _slope(values: NDArray[np.complex128], z_mm: Coordinates) -> NDArray[np.complex128]:
    """Return the slope of ``values`` over ``z_mm``, 0 where z does not change."""
    if values.size < 2:
        return np.zeros_like(values)
    rise, run = np.gradient(values), np.gradient(z_mm)
    return np.divide(rise, run, out=np.zeros_like(values), where=np.abs(run) > 1e-6)
