"""Where turns start, measured from lines drawn by formula and on a phantom."""

import numpy as np
import pytest
from tolerances import COORDINATE_ATOL, FREE_START_RAD, START_RAD

from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning import start_angle
from endoct.modalities.oct.turning.rotation import Rotation, even_rotation
from endoct.modalities.oct.turning.start_angle import measure_starts
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.turning.drawn_slices import N_COLUMNS, RADIUS_MM, Array, drawn_slice, faces_of
from tests.modalities.oct.unrolling import UnrollPhantom

ACQUISITION = OctAcquisition(
    modality="oct",
    axial_pixel_mm=0.005,
    pullback_pitch_mm=0.2,
    bore_diameter_mm=2.5,
    capillary_outer_diameter_mm=2 * RADIUS_MM,
)


def measured_starts(starts: Array, offset: Array, sheaths: int) -> tuple[Rotation, str]:
    """Starts measured in even turns that begin at ``starts``."""
    slices = [
        drawn_slice(np.zeros(N_COLUMNS), start, at, i, sheaths=sheaths)
        for i, (start, at) in enumerate(zip(starts, offset, strict=True))
    ]
    return measure_starts(
        slices, faces_of(slices), Glass(RADIUS_MM), even_rotation(len(slices)), ACQUISITION, OctParameters()
    )


def test_free_starts_are_measured_from_the_sheath_though_the_capillary_drifts() -> None:
    rng = np.random.default_rng(5)
    starts = rng.uniform(0, 2 * np.pi, 14)
    drifting = 0.2 * np.exp(1j * np.cumsum(0.1 * rng.normal(size=14)))
    rotation, note = measured_starts(starts, drifting, 3)
    left = wrap_rad(rotation.start_rad - starts)
    assert rotation.start_known.all()
    assert np.abs(wrap_rad(left - left[0])).max() < FREE_START_RAD
    assert "sheath" in note
    # what creeps with the sheath cannot be known: the farther, the less sure
    assert rotation.start_sigma_rad[-1] > rotation.start_sigma_rad[1] > 0


def test_triggered_starts_scatter_less_than_before() -> None:
    rng = np.random.default_rng(6)
    starts = 0.03 * rng.normal(size=16)
    rotation, note = measured_starts(starts, 0.2 * np.exp(0.1j * np.arange(16)), 3)
    left = starts - rotation.start_rad
    assert np.std(left) < START_RAD
    assert np.std(starts) > 3 * START_RAD
    assert abs(rotation.start_rad.mean()) < 1e-9
    assert not note


def test_starts_that_make_a_steady_capillary_jump_are_not_believed() -> None:
    starts = np.random.default_rng(7).uniform(-1, 1, 16)
    # the capillary is seen in one direction all along, sheath lines in any
    rotation, note = measured_starts(starts, 0.2 * np.exp(1j * starts), 3)
    assert not rotation.start_rad.any()
    assert "not used" in note


def test_triggered_starts_are_left_alone_where_one_line_only_could_tell() -> None:
    rotation, _ = measured_starts(0.03 * np.random.default_rng(7).normal(size=12), np.full(12, 0.2 + 0j), 1)
    assert not rotation.start_known.any()
    assert not rotation.start_rad.any()


def test_slices_that_start_anywhere_are_turned_back_by_capillary_and_cells(unrolled: UnrollPhantom) -> None:
    """One sheath line alone is no mark; the way is from slice to slice, and the twist's uncertainty grows."""
    phantom = Phantom(turning_rad=0.05)
    pages = phantom.log_counts()
    rolls = np.array([0, 250, 600, 90, 400, 510])
    _, _, straight = unrolled(phantom, pages)
    _, calibration, turned_back = unrolled(
        phantom, np.stack([np.roll(p, r, axis=1) for p, r in zip(pages, rolls, strict=True)])
    )
    assert straight.depth_mm is not None
    assert turned_back.depth_mm is not None
    start = turned_back.per_frame["start_angle_rad"].values
    assert np.abs(wrap_rad(start + 2 * np.pi * rolls / 720)).max() < 0.06
    assert np.all(np.diff(turned_back.per_frame["start_angle_sigma_rad"].values) > 0)
    assert any("uncertain" in note for note in calibration.notes)
    both, either = [
        op(straight.depth_mm > 0.1, turned_back.depth_mm > 0.1).sum() for op in (np.logical_and, np.logical_or)
    ]
    assert both / either > 0.85


def test_an_angle_common_to_all_slices_only_rolls_the_panorama(unrolled: UnrollPhantom) -> None:
    phantom = Phantom()
    pages = phantom.log_counts()
    _, _, straight = unrolled(phantom, pages)
    _, _, rolled = unrolled(phantom, np.roll(pages, 180, axis=2))
    assert straight.depth_mm is not None
    assert rolled.depth_mm is not None
    shifted = np.roll(straight.depth_mm, 180, axis=1)
    assert np.mean(np.abs(shifted - rolled.depth_mm) > 0.03) < 0.02


def by_matrix(moved: np.ndarray, sigma: np.ndarray, usual: float, creep: float) -> tuple[np.ndarray, np.ndarray]:
    """The least squares for starts as written down: all unknowns, the landmark's directions too, by all rows."""
    n, seen = moved.size, np.flatnonzero(np.isfinite(sigma))
    creeping = (np.eye(n, k=1) - np.eye(n)) / creep
    creeping[-1] = start_angle.MEAN_WEIGHT / n
    sights = (np.eye(n)[seen], -np.eye(n)[seen])  # the landmark is seen at its direction less the start
    matrix = np.block([[np.zeros((n, n)), creeping], [np.eye(n) / usual, np.zeros((n, n))]])
    matrix = np.vstack([matrix, np.hstack(sights[::-1]) / sigma[seen, None]])
    values = np.concatenate([np.zeros(2 * n), moved[seen] / sigma[seen]])
    weight = np.ones(values.size)
    for _ in range(start_angle.ROBUST_STEPS):
        weighted = matrix * weight[:, None]
        covariance = np.linalg.inv(weighted.T @ weighted)
        solution = covariance @ (weighted.T @ (weight * values))
        weight[n:] = 1 / np.sqrt(1 + ((matrix @ solution - values)[n:] / 2) ** 2)
    return solution[:n], np.sqrt(np.diag(covariance)[:n])


@pytest.mark.parametrize("n", [2, 3, 120])
def test_starts_are_those_of_least_squares_over_everything(n: int) -> None:
    rng = np.random.default_rng(3)
    seen = (rng.random(n) < 0.9) | (np.arange(n) < 2)
    moved = np.where(seen, 0.005 * rng.normal(size=n) + np.cumsum(0.0017 * rng.normal(size=n)), 0.0)
    moved[np.flatnonzero(seen)[n // 6]] += 0.2
    sigma = np.where(seen, rng.uniform(0.001, 0.004, n), np.inf)
    for estimate, expected in zip(
        start_angle.separated(moved, sigma, 0.005, 0.0017), by_matrix(moved, sigma, 0.005, 0.0017), strict=True
    ):
        np.testing.assert_allclose(estimate, expected, rtol=0, atol=COORDINATE_ATOL)
