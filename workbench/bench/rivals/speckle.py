"""How far the catheter turned from one A-scan to the next, from how fast the speckle of bone changes.

After Uribe-Patarroyo and Bouma (2015), "Rotational distortion correction in endoscopic optical coherence tomography
based on speckle decorrelation", Optics Letters 40, 5518. Two A-scans see the same speckle as far as their spots
overlap, so their correlation falls with the square of the way between them. The ruler is the recording itself: on
average it turned by one A-scan from one to the next. For one angle, a spot goes farther the farther away the wall is.
Noise lowers all correlations of equally bright bone alike.
"""

from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import robust_sigma
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.bscan import logarithmic, sector_means
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.turned import nominal_rad, stated_errors_rad, unrolled_as_turned
from endoct.workbench.bench.task import Declined
from endoct.workbench.bench.tasks.oct import even, ours

MOST_ASCANS = 1024
STEP_MM = 0.016
"""The way along the wall over which speckle is compared: about the width of a spot."""
WINDOWS = 32
"""Speed is measured in so many windows around the turn."""
LEVELS_DB = (2.0, 4.0, 6.0, 8.0, 10.0, 13.0, 17.0)
"""Bone between two of these levels over the noise is one class. Darker bone is left out."""
SMOOTH_ASCANS, SMOOTH_ROWS, DETREND = 8.0, 3.0, 6.0
THICK_ROWS, THICK_SHARE = 31, 0.8
"""Bone is bright over so many rows; what is thinner are reflections."""
LEAST_MM = 0.85
"""The catheter's sheath lies before this depth."""
FAR = 3
"""Steps after which nothing of the speckle is left."""
NEAREST_MM = 0.15
"""The wall may lie off the nominal bore by so much. What lies deeper is a cell."""
RATIOS = 0.05, 5.0
ORDERS = range(1, 5)
LEAST_RAD, USUAL_LENGTH, DIFFERENT = 0.01, 0.02, 0.36
"""The least first harmonic (others go by 1/h), the usual error of a turn's length, a slice's share of its own."""
UNSURE_RAD = 0.02
"""How wrong the first harmonic common to all slices may be (others in proportion to 1/h), however many there are."""
NEIGHBOURS = 8
SIGMA_RAD = 0.04
"""Angles by speckle are off by so much over a turn: 2.4° in the median of 16 recordings near the axis, tuning seeds."""
FLOOR_PERCENT = 3
LEAST_WEIGHT, LEAST_LIKENESS = 0.1, 0.05
SLOWEST, SLOWEST_FALL = 0.2, 0.1


def speckle(recording: Path) -> Panorama:
    """Unroll a pullback with turns as its speckle shows them. Raises :class:`Declined` where no bone shows any."""
    base = even(recording)
    return unrolled_as_turned(recording, lambda stream: speckle_errors_rad(stream, base))


def face_and_speckle(recording: Path) -> Panorama:
    """Unroll a pullback with turns as endoct finds them in the capillary's face, speckle added as either is sure."""
    base, by_face = even(recording), ours(recording)

    def both(stream: FrameStream) -> Coordinates:
        of_face, sigma_rad = stated_errors_rad(by_face, len(stream[0].samples))
        try:
            of_speckle = speckle_errors_rad(stream, base)
        except Declined:
            return of_face
        share = (1 / (1 + (sigma_rad / SIGMA_RAD) ** 2))[:, np.newaxis]
        return np.asarray(share * of_face + (1 - share) * of_speckle)

    return unrolled_as_turned(recording, both)


def speckle_errors_rad(stream: FrameStream, base: Panorama) -> Coordinates:
    """Return by how much A-scans are off their nominal angles, float64 (n_slices, n_ascans), in recording order.

    ``base`` is the panorama of the same recording, of turns taken for even. Raises :class:`Declined` where too little
    of the wall is bright.
    """
    speeds, weights = _speeds(stream, base)
    factors = _smooth_factors(speeds - 1, weights)
    turn = nominal_rad(len(stream[0].samples))
    return np.asarray(factors @ _basis(turn)[0].T)


def _speeds(stream: FrameStream, base: Panorama) -> tuple[Coordinates, Coordinates]:
    """Return the speed of every window over the mean, and its weight (0 where unknown), both (n_slices, WINDOWS)."""
    acquisition = cast(OctAcquisition, stream.acquisition)
    levels_db = [_levels_db(stream[i].samples, acquisition) for i in range(len(stream))]
    floor_db = np.median([np.percentile(_smooth(db), FLOOR_PERCENT, axis=0) for db in levels_db], axis=0)
    columns_mm = 2 * np.pi * base.grid.radius_mm / len(levels_db[0])
    step = max(1, round(STEP_MM / columns_mm))
    seen = [_products(db, floor_db, step, acquisition.mm_per_px) for db in levels_db]
    likeness, weights, fall = _likeness(*(np.stack(part) for part in zip(*seen, strict=True)))
    way = np.sqrt(np.maximum(1 - np.log(np.clip(likeness, *RATIOS)) / fall, SLOWEST**2))
    speeds = way / _reach_mm(base, acquisition)
    weights = np.where(weights < LEAST_WEIGHT * np.median(weights), 0, weights)
    return speeds * weights.sum() / (speeds * weights).sum(), weights / weights.max()


def _levels_db(samples: NDArray[np.generic], acquisition: OctAcquisition) -> Image:
    """Return a B-scan in dB, float32 (at most MOST_ASCANS, depth)."""
    few = sector_means(samples, min(len(samples), MOST_ASCANS))
    return np.asarray(logarithmic(few, acquisition.intensity), np.float32) * np.float32(acquisition.db_per_count or 1)


def _smooth(bscan: Image) -> Image:
    """Return a B-scan (A-scan, depth) blurred, a circle of A-scans."""
    return np.asarray(gaussian_filter(bscan, (SMOOTH_ASCANS, SMOOTH_ROWS), mode=("wrap", "nearest")), np.float32)


def _products(
    db: Image, floor_db: Image, step: int, mm_per_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sums over the bone of each window, by how bright it is.

    Of products of speckle with that 1, 2 and FAR steps on, float64 (3, WINDOWS, classes); and of its square,
    (WINDOWS, classes).
    """
    bright = np.digitize(_smooth(db) - floor_db, LEVELS_DB)
    bone = uniform_filter1d((bright > 0).astype(np.float32), THICK_ROWS, axis=1) > THICK_SHARE
    bone &= (bright > 0) & (np.arange(db.shape[1]) * mm_per_px > LEAST_MM)
    amplitude: Image = (10 ** (db / 20)).astype(np.float32)
    amplitude /= _smooth(amplitude)
    speckle = amplitude - gaussian_filter1d(amplitude, DETREND * step, axis=0, mode="wrap")
    n = len(db)
    window = np.arange(n) * WINDOWS // n
    place = window[:, np.newaxis] * len(LEVELS_DB) + bright - 1

    def summed(values: Image, of: NDArray[np.bool_]) -> NDArray[np.float64]:
        sums = np.bincount(place[: len(of)][of], values[of], minlength=WINDOWS * len(LEVELS_DB))
        return np.asarray(sums.reshape(WINDOWS, len(LEVELS_DB)), np.float64)

    products = []
    for lag in (step, 2 * step, FAR * step):  # a turn does not end where it began
        products.append(summed(speckle[:-lag] * speckle[lag:], bone[:-lag] & bone[lag:]))
    return np.stack(products), summed(speckle**2, bone)


def _likeness(products: NDArray[np.float64], energy: NDArray[np.float64]) -> tuple[Coordinates, Coordinates, float]:
    """Return how alike neighbours are over the mean, and its weight, (n_slices, WINDOWS); and how fast that falls.

    ``products`` (n_slices, 3, WINDOWS, classes) and ``energy`` (n_slices, WINDOWS, classes) as of :func:`_products`.
    Likeness is exp(−fall·(way² − 1)). What is alike far away is no speckle, and taken off. Raises :class:`Declined`
    where nothing is alike.
    """
    near, next_ = products[:, 0] - products[:, 2], products[:, 1] - products[:, 2]
    total = np.maximum(energy.sum(axis=(0, 1)), 1e-9)
    usual, usual_next = near.sum(axis=(0, 1)) / total, next_.sum(axis=(0, 1)) / total
    sound = (usual > LEAST_LIKENESS) & (usual_next > 0)
    if not sound.any():
        raise Declined("no bone shows speckle that neighbouring A-scans share")
    usual, near, energy = usual[sound], near[..., sound], energy[..., sound]
    trust = usual**2 * total[sound]
    fall = float(np.sum(trust * np.log(usual / usual_next[sound])) / trust.sum() / 3)
    weights = energy @ usual**2
    return near @ usual / np.maximum(weights, 1e-9), weights, max(fall, SLOWEST_FALL)


def _reach_mm(base: Panorama, acquisition: OctAcquisition) -> Coordinates:
    """Return how far the wall is from the catheter in every window, float64 (n_slices, WINDOWS), mm."""
    of = {name: one.values for name, one in base.per_frame.items()}
    theta = base.grid.theta_rad
    reach = np.empty((base.grid.n_z, WINDOWS))
    for row, index in enumerate(of[f"{base.frame_dim}_index"]):
        depth = np.zeros(theta.size) if base.depth_mm is None else np.clip(base.depth_mm[row], -NEAREST_MM, NEAREST_MM)
        wall = (base.grid.radius_mm + np.where(base.valid[row], depth, 0)) * np.exp(1j * theta)
        beam = wall - of["offset_mm"][row] * np.exp(1j * of["offset_direction_rad"][row])
        turn = np.mod(acquisition.sense * (np.angle(beam) - acquisition.theta_origin_rad), 2 * np.pi)
        order = np.argsort(turn)
        middle = 2 * np.pi * (np.arange(WINDOWS) + 0.5) / WINDOWS
        reach[int(index)] = np.interp(middle, turn[order], np.abs(beam)[order], period=2 * np.pi)
    return reach


def _smooth_factors(faster: Coordinates, weights: Coordinates) -> Coordinates:
    """Return the factors of :func:`_basis` of every slice, float64 (n_slices, 1 + 2·orders), from speeds less one.

    Friction changes slowly along the bore. So a slice is first taken to turn as its neighbours do, as far as that
    stands out. It then differs from that by a share.
    """
    middle = 2 * np.pi * (np.arange(WINDOWS) + 0.5) / WINDOWS
    rates = _basis(middle)[1]
    normal = np.einsum("wk,iw,wl->ikl", rates, weights, rates)
    seen = np.einsum("wk,iw,iw->ik", rates, weights, faster)
    ridge = 1e-6 * np.eye(rates.shape[1])
    left = (faster - np.linalg.solve(normal + ridge, seen[..., np.newaxis])[..., 0] @ rates.T) * np.sqrt(weights)
    noise = robust_sigma(left[weights > 0]) ** 2 * WINDOWS / (WINDOWS - rates.shape[1])
    doubted = 1 / (1 + (left / np.sqrt(noise) / 3) ** 2)
    normal = np.einsum("wk,iw,wl->ikl", rates, weights * doubted, rates) / noise
    seen = np.einsum("wk,iw,iw->ik", rates, weights * doubted, faster) / noise
    order = np.concatenate([[1], np.repeat(np.arange(1, ORDERS.stop), 2)])
    unsure = (UNSURE_RAD / order) ** 2
    factors = np.empty((len(faster), order.size))
    for i in range(len(faster)):
        near = slice(max(0, i - NEIGHBOURS), i + NEIGHBOURS + 1)
        spread = np.linalg.inv(normal[near].sum(axis=0) + ridge)
        common = spread @ seen[near].sum(axis=0)
        # as large as it is beyond its own error
        size = np.maximum(_by_order(common**2) - _by_order(np.diag(spread)) - unsure, 0)
        common *= size / (size + np.diag(spread) + unsure)
        common[0] = 0  # turns are as long as they are, each for itself
        own = DIFFERENT**2 * np.maximum(size, (LEAST_RAD / order) ** 2)
        own[0] = USUAL_LENGTH**2
        factors[i] = np.linalg.solve(normal[i] + np.diag(1 / own), seen[i] + common / own)
    return factors


def _by_order(squares: Coordinates) -> Coordinates:
    """Return the mean of the squares of cosine and sine of each order in place of either, float64 (1 + 2·orders,)."""
    pairs = squares[1:].reshape(-1, 2).mean(axis=1)
    return np.concatenate([squares[:1], np.repeat(pairs, 2)])


def _basis(turn_rad: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return what factors are of, as errors of angle, and as speeds, float64 (n, 1 + 2·orders) each."""
    waves = harmonics(turn_rad, ORDERS)
    rates = np.empty_like(waves)
    orders = np.arange(1, ORDERS.stop)
    rates[:, ::2], rates[:, 1::2] = -orders * waves[:, 1::2], orders * waves[:, ::2]
    lengths = turn_rad - np.pi
    return np.column_stack([lengths, waves]), np.column_stack([np.ones_like(lengths), rates])
