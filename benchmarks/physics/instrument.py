"""What belongs to the bone and what to the instrument: speckle, focus, reflections, noise and sheath, from pixels.

Expected values are written anew from geometry and Gaussian optics; nothing of the renderer's is used for them. A spot
of full width w lets the intensity of speckle correlate over √2·w.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from benchmarks.physics import catheter
from benchmarks.physics.bscans import decibels, gaussian_fwhm, plain, wall_row
from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.oct.bscan import render_bscan
from endoct.synthetic.oct.sweep import build_appearance
from endoct.synthetic.sample.parameters import Sample, SheathLine
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.truth import recording

BRIGHT: dict[str, Any] = {"wall_db": 24.0, "attenuation_mm": 2.0, "floor_count": 110.0}
FRESNEL = ((1.46 - 1) / (1.46 + 1)) ** 2
BONE_ROWS = slice(8, 108)  # below the surface


@dataclass(frozen=True, eq=False)
class Comparison:
    """Measured values over ``x`` and what they should be."""

    x: Coordinates
    measured: Coordinates
    expected: Coordinates

    @property
    def worst_rel(self) -> float:
        """Largest relative departure."""
        return float(np.abs(self.measured / self.expected - 1).max())


def slices_db(sample: Sample, indices: range) -> NDArray[np.float64]:
    """Return B-scans in dB over the noise, (slice, depth, A-scan)."""
    wall = build_wall(sample)
    look = build_appearance(sample, wall)
    return np.stack([decibels(sample, render_bscan(sample, wall, look, i)) for i in indices])


def _placed(sample: Sample, **oct_: Any) -> Sample:
    return sample.model_copy(update={"oct": sample.oct.model_copy(update=oct_)})


@dataclass(frozen=True, eq=False)
class Grains:
    """The bone's ``intensity`` (slice, row, A-scan) against the mean of its row, less 1; ``clear``: its power's share
    that is no noise."""

    intensity: NDArray[np.float64]
    clear: float

    @classmethod
    def of(cls, level_db: NDArray[np.float64], first: int) -> "Grains":
        """Return those of the rows below ``first`` of B-scans (slice, depth, A-scan) in dB over the noise."""
        intensity = 10 ** (level_db[..., first + BONE_ROWS.start : first + BONE_ROWS.stop, :] / 10)
        mean = intensity.mean(axis=-1, keepdims=True)
        return cls(intensity / mean - 1, float(np.mean((1 - 1 / mean) ** 2)))

    def within(self, part: slice) -> "Grains":
        """Return those of some A-scans."""
        return Grains(self.intensity[..., part], self.clear)

    def width_px(self, most: int = 25, rows: int = 0) -> float:
        """Return over how many A-scans they correlate, full width at half maximum.

        Where the wall rises or falls, they are looked for up to ``rows`` higher and lower from A-scan to A-scan.
        """
        n, depth = self.intensity.shape[-1], self.intensity.shape[1]
        still = self.intensity[:, rows : depth - rows]
        value = np.ones(most)
        for k in range(1, most):
            shifted = [
                np.mean(still[..., : n - k] * self.intensity[:, rows + d : depth - rows + d, k:])
                for d in range(-rows, rows + 1)
            ]
            value[k] = _peak(np.array(shifted))
        return gaussian_fwhm(np.arange(float(most)), value / (self.clear * np.mean(still**2)))


def _peak(values: Coordinates) -> float:
    """Return the largest value, between samples of a bell too."""
    at = int(np.argmax(values))
    if not 0 < at < values.size - 1 or values[at - 1 : at + 2].min() <= 0:
        return float(values[at])
    before, here, after = np.log(values[at - 1 : at + 2])
    return float(np.exp(here + (before - after) ** 2 / (8 * (2 * here - before - after))))


def speckle_over_speed(swing: float = 0.19, windows: int = 6, slices: int = 10) -> Comparison:
    """Return the width of speckle in A-scans where the catheter turns at ``x`` times its mean speed."""
    sample = plain(**BRIGHT, rotation_error_rad=(((0.0, swing),),) * PRESETS["quick"].n_slices)
    grains = Grains.of(slices_db(sample, range(slices)), round(wall_row(sample)))
    n = grains.intensity.shape[-1]
    speed = 1 + swing * np.cos(2 * np.pi * np.arange(n) / n)
    arc_mm = 2 * np.pi / n * sample.bore.diameter_mm / 2
    parts = [slice(k * n // windows, (k + 1) * n // windows) for k in range(windows)]
    mean = np.array([1 / np.mean(1 / speed[part]) for part in parts])
    found = np.array([grains.within(part).width_px() for part in parts])
    return Comparison(mean, found, np.sqrt(2) * sample.oct.lateral_resolution_mm / arc_mm / mean)


def speed_from_speckle(slices: int = 12, window: int = 50, lag: int = 3) -> Comparison:
    """Return the catheter's speed over its mean, over its turn ``x`` in rad, as the likeness of A-scans tells it.

    It sticks and slips at three places, the same in every slice: behind by 0.02 rad within 0.5 rad, made up in 0.1.
    """
    turn = 2 * np.pi * (np.arange(4096) + 0.5) / 4096
    behind = np.zeros(turn.size)
    for begins in (0.8, 2.5, 4.9):
        since = np.mod(turn - begins, 2 * np.pi)
        behind -= 0.02 * (np.clip(since / 0.5, 0, 1) - np.clip((since - 0.5) / 0.1, 0, 1))
    orders = np.arange(1, 25)
    waves = np.stack([np.cos(np.outer(orders, turn)), np.sin(np.outer(orders, turn))], axis=1)
    error = waves @ behind * (2 / turn.size)
    sample = plain(**BRIGHT, rotation_error_rad=(tuple(map(tuple, error.tolist())),) * PRESETS["quick"].n_slices)
    grains = Grains.of(slices_db(sample, range(slices)), round(wall_row(sample)))
    n = grains.intensity.shape[-1]
    at = 2 * np.pi * np.arange(n) / n
    slope = sum(h * (b * np.cos(h * at) - a * np.sin(h * at)) for h, (a, b) in zip(orders, error, strict=True))
    likeness = np.mean(grains.intensity * np.roll(grains.intensity, -lag, axis=2), axis=(0, 1))
    power = grains.clear * np.mean(grains.intensity**2, axis=(0, 1))
    mean, of_power = (np.roll(uniform_filter1d(of, window, mode="wrap"), lag // 2) for of in (likeness, power))
    found = np.sqrt(-np.log(np.clip(mean / of_power, 0.05, 0.999)))
    some = slice(None, None, window // 2)
    true = uniform_filter1d(1 + slope, window, mode="wrap")
    return Comparison(at[some], (found / found.mean())[some], true[some])


def speckle_around_an_offset(offset_mm: float = 0.22, windows: int = 8, slices: int = 6) -> Comparison:
    """Return the width of speckle in A-scans over the direction ``x`` from that of the catheter's offset, rad."""
    n_slices = PRESETS["quick"].n_slices
    base = plain(**BRIGHT, offset_mm=(offset_mm,) * n_slices, offset_direction_rad=(0.7,) * n_slices)
    sample = _placed(base, focus_mm=0.9, lateral_resolution_mm=0.02)
    truths = json.loads(json.dumps(recording(sample)))
    rig = catheter.Rig.of(truths, json.loads(sample.model_dump_json()))
    level = slices_db(sample, range(slices))
    n = level.shape[-1]
    alpha = catheter.beam_rad(truths["oct"], 0, n)
    place = offset_mm * np.exp(0.7j)
    _, path, leaving, beyond = catheter.through_glass(rig, place, alpha)
    before = (leaving * beyond.conj()).real
    way = np.sqrt(rig.bore_radius_mm**2 - np.abs(leaving) ** 2 + before**2) - before
    ends = leaving + way * beyond
    # how far apart beams are across themselves, where they meet the wall
    arc_mm = np.abs(((np.roll(ends, -1) - np.roll(ends, 1)) / 2 * beyond.conj()).imag)
    wider = np.hypot(1, (path + way - 0.9) * 0.001284 * np.log(2) / (np.pi * 0.02**2))
    expected = np.sqrt(2) * 0.02 * wider / arc_mm
    centre = np.arange(n) * windows // n
    deepest = [int(np.ceil(rig.row(path + way)[centre == k].max())) for k in range(windows)]
    found = np.array([Grains.of(level[..., centre == k], deepest[k]).width_px(rows=4) for k in range(windows)])
    mean = np.array([expected[centre == k].mean() for k in range(windows)])
    direction = np.array([np.angle(np.mean(np.exp(1j * (alpha - 0.7))[centre == k])) for k in range(windows)])
    return Comparison(direction, found, mean)


def speckle_over_place() -> Comparison:
    """Return how the intensities of slices correlate that lie ``x`` mm apart, stopped at; noise taken away."""
    apart = np.array([0.0, 0.006, 0.012, 0.018, 0.024, 0.06, 0.2])
    base = plain(**BRIGHT)
    z = (5.0 + np.concatenate([apart, np.full(PRESETS["quick"].n_slices - apart.size, 0.5)])).tolist()
    sample = _placed(base, z_mm=tuple(z))
    grains = Grains.of(slices_db(sample, range(apart.size)), round(wall_row(sample)))
    power = np.mean(grains.intensity**2, axis=(1, 2))
    found = np.mean(grains.intensity * grains.intensity[0], axis=(1, 2)) / np.sqrt(power * power[0]) / grains.clear
    found[0] *= grains.clear  # its noise is its own
    width = np.sqrt(2) * sample.oct.lateral_resolution_mm
    return Comparison(apart, found, np.exp(-4 * np.log(2) * (apart / width) ** 2))


def repeated(moved_mm: float = 0.0, seed: int = 2000) -> float:
    """Return how the intensities of one slice correlate in two recordings of a bore with other noise.

    ``moved_mm``: by how much the second catheter is off where the first was.
    """
    base = plain(**BRIGHT)
    n = PRESETS["quick"].n_slices
    moved = {"offset_mm": (moved_mm,) * n, "offset_direction_rad": (0.0,) * n}
    other = _placed(base, **moved).model_copy(update={"seed": seed})
    first = round(wall_row(base))
    one, two = (Grains.of(slices_db(sample, range(1)), first).intensity for sample in (base, other))
    return float(np.corrcoef(one.ravel(), two.ravel())[0, 1])


def helical(windows: int = 20) -> Comparison:
    """Return how a slice pulled on during its turn correlates with one stopped at, over their distance ``x``, mm."""
    base = plain(**BRIGHT)
    n = PRESETS["quick"].n_slices
    stopped = _placed(base, z_mm=(5.0,) * n)
    pulled = _placed(base, z_mm=(4.9,) * n, scan="helical", z_advance_mm=0.2)
    first = round(wall_row(base))
    one, two = (Grains.of(slices_db(sample, range(1)), first).intensity[0] for sample in (stopped, pulled))
    parts = np.array_split(np.arange(one.shape[1]), windows)
    x = np.array([0.2 * (part.mean() + 0.5) / one.shape[1] - 0.1 for part in parts])
    found = np.array([np.corrcoef(one[:, part].ravel(), two[:, part].ravel())[0, 1] for part in parts])
    fine = 0.2 / windows * (np.arange(50) + 0.5) / 50 - 0.1 / windows
    width = np.sqrt(2) * base.oct.lateral_resolution_mm
    expected = np.exp(-4 * np.log(2) * ((x[:, None] + fine) / width) ** 2).mean(axis=1)
    return Comparison(x, found, expected)


def focus(lateral_mm: float, slices: int = 4) -> tuple[Comparison, Comparison]:
    """Return bone's loss in dB, and the width of its speckle in µm, with the focus ``x`` mm off the wall."""
    apart = np.array([0.0, 0.5, 1.0])
    losses, widths = [], []
    for away in apart:
        base = plain(**BRIGHT, lateral_resolution_mm=lateral_mm)
        sample = _placed(base, focus_mm=base.oct.focus_mm + float(away))
        level = slices_db(sample, range(slices))
        first = round(wall_row(sample))
        losses.append(np.mean(10 ** (level[:, first + 5 : first + 105] / 10)) - 1)
        arc_um = 1e3 * np.pi * sample.bore.diameter_mm / level.shape[2]
        widths.append(Grains.of(level, first).width_px(30) * arc_um)
    rayleigh = np.pi * lateral_mm**2 / np.log(2) / 0.001284
    loss = -10 * np.log10(np.array(losses) / losses[0])
    wider = np.sqrt(1 + (apart / rayleigh) ** 2)
    return (
        Comparison(apart, loss, 10 * np.log10(1 + (apart / (2 * rayleigh)) ** 2)),
        Comparison(apart, np.array(widths), 1e3 * np.sqrt(2) * lateral_mm * wider),
    )


@dataclass(frozen=True, eq=False)
class Reflections:
    """What an off-axis catheter gets back of its capillary.

    ``flares``: slices in which each face is brightest near both squares, out of ``slices``; ``off_rad``: how far the
    brightest A-scans lie from there, at most. ``ghost_db``, ``double_pass_db``: levels where beams are square, and what
    Fresnel says.
    """

    slices: int
    flares: int
    off_rad: float
    ghost_db: tuple[float, float]
    double_pass_db: tuple[float, float]


def reflections(slices: int = 6) -> Reflections:
    """Measure a capillary of 53 dB at its squares, which comes to a ghost of 24 dB."""
    n_slices = PRESETS["quick"].n_slices
    fresnel_db = 20 * np.log10(FRESNEL)
    sample = plain(
        offset_mm=(0.15,) * n_slices, offset_direction_rad=(1.0,) * n_slices, outer_face_db=34.0, inner_face_db=30.0,
        flare_db=19.0, ghost_db=float(fresnel_db), double_pass_db=-38.0, glass_mm=0.2, floor_count=45.0, glint_rad=0.2,
        excess_noise_db=8.0, roll_off_db=6.0,
    )  # fmt: skip
    truths = json.loads(json.dumps(recording(sample)))
    rig = catheter.Rig.of(truths, json.loads(sample.model_dump_json()))
    level = slices_db(sample, range(slices))
    n = level.shape[2]
    n_depth = 2 * level.shape[1]
    alpha = catheter.beam_rad(truths["oct"], 0, n)
    inner, outer, _, _ = catheter.through_glass(rig, 0.15 * np.exp(1j), alpha)

    def along(path_mm: Coordinates) -> NDArray[np.float64]:
        near = np.rint(rig.row(path_mm)).astype(int) + np.arange(-2, 3)[:, None]
        return np.asarray(level[:, near, np.arange(n)].max(axis=1))

    def unrolled_db(path_mm: Coordinates) -> Coordinates:
        row = rig.row(path_mm)
        blur = (6.0 + 20 * np.log10(np.sinc(0.5))) * (2 * row / n_depth) ** 2
        return np.asarray(20 * np.log10(np.sinc(row / n_depth)) - blur)

    flares, off = 0, 0.0
    squares = [np.abs(np.angle(np.exp(1j * (alpha - at)))) for at in (1.0, 1.0 + np.pi)]
    for i in range(slices):
        both = True
        for path in (inner, outer):
            bright = along(path)[i]
            for square in squares:
                half = square < 0.5
                peak = np.flatnonzero(half)[np.argmax(uniform_filter1d(bright, 9, mode="wrap")[half])]
                both &= bool(bright[square < 0.01].mean() > bright[(square > 0.15) & half].max() + 6)
                off = max(off, float(square[peak]))
        flares += both
    at = squares[0] < 0.008

    def ghost(path_mm: Coordinates) -> float:
        near = np.rint(rig.row(path_mm)).astype(int)[at] + np.arange(-2, 3)[:, None]
        power = 10 ** (level[:, near, np.flatnonzero(at)] / 10)
        return float(10 * np.log10(np.max(np.mean(power, axis=(0, 2))) - 1) - np.mean(unrolled_db(path_mm)[at]))

    glass, face_db = outer - inner, ghost(outer)
    return Reflections(
        slices, flares, off, (ghost(outer + glass), face_db + float(fresnel_db)), (ghost(2 * outer), face_db - 38.0)
    )


def noise_floor(bands_db: float = 2.6) -> tuple[float, Coordinates]:
    """Return by how much the noise differs between depths, dB, and its level over depth; a dark bore."""
    sample = plain("learning", floor_bands_db=bands_db, floor_count=150.0)
    level = slices_db(sample, range(16))[:, 8:-4]
    row_db = 10 * np.log10(uniform_filter1d((10 ** (level / 10)).mean(axis=(0, 2)), 9))
    return float(np.ptp(row_db[5:-5])), row_db


@dataclass(frozen=True)
class Sheath:
    """A band of the sheath: contrast of its speckle where it does not fade; over how many dB it fades around a turn."""

    contrast: float
    thickness_mm: float
    fades_db: float


def sheath(thickness_mm: float = 0.1) -> Sheath:
    """Measure one band of polymer 25 dB over the noise."""
    line = SheathLine(
        radius_mm=0.35, wobble_mm=0.015, phase_rad=0.0, level_db=-20.0, thickness_mm=thickness_mm, band_db=25.0
    ).model_copy(update={"wobble_mm": 0.0})
    sample = plain(floor_count=110.0, sheath_fade_db=5.0, sheath=(line,))
    level = slices_db(sample, range(6))
    first = (0.35 - sample.oct.first_sample_mm) / sample.oct.axial_pixel_mm
    rows = slice(round(first) + 4, round(first + thickness_mm / sample.oct.axial_pixel_mm) - 3)
    power = 10 ** (level / 10)
    course = uniform_filter1d(power[:, rows].mean(axis=1), 201, axis=1, mode="wrap")
    intensity = power[:, rows] / course[:, None]
    bright = course > 30
    contrast = float(np.std(intensity.transpose(0, 2, 1)[bright]))
    mean = power.mean(axis=(0, 2)) - 1
    half = mean > mean[rows].mean() / 2
    near = half[: 2 * round(first)].sum() * sample.oct.axial_pixel_mm
    return Sheath(contrast, float(near), float(10 * np.log10(np.quantile(course, 0.98) / np.quantile(course, 0.02))))
