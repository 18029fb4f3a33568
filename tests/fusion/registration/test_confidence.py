"""What an alignment says of itself: how likely chance is, how far it may be off, and that only the turn turns."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np
import pytest
from bore_pairs import Pair
from tolerances import ROLLED_RAD, ROLLED_Z_MM

from endoct.base.numeric.circle import gaussian, wrap_rad
from endoct.fusion.evidence.evidence import Evidence, prepare, reoriented
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, as_covariance
from endoct.fusion.registration import search
from endoct.fusion.registration.align import BELIEVABLE, LIKELY_CHANCE, Alignment, NotAligned, align
from endoct.fusion.registration.refinement import refine
from endoct.fusion.registration.search import chance_of, score
from endoct.stitching.panorama import Panorama

UPRIGHT = ALL_ORIENTATIONS[:1]


def texture(seed: int, shape: tuple[int, int] = (60, 96), dz_mm: float = 0.08) -> Evidence:
    values = gaussian(np.random.default_rng(seed).normal(size=shape).astype(np.float32), 2.0, 2.0)
    z_mm = dz_mm * np.arange(shape[0])
    return Evidence(values / values.std(), np.ones(shape, np.bool_), z_mm, dz_mm, 0.0, 1.25, "darkness")


def rolled(panorama: Panorama, columns: int) -> Panorama:
    depth = panorama.depth_mm
    return replace(
        panorama,
        intensity=np.roll(panorama.intensity, columns, axis=1),
        depth_mm=None if depth is None else np.roll(depth, columns, axis=1),
        valid=np.roll(panorama.valid, columns, axis=1),
        weight=np.roll(panorama.weight, columns, axis=1),
    )


@pytest.mark.parametrize("columns", [(1, 1), (137, 137), (511, 40)])
def test_rolling_the_inputs_rolls_the_answer_and_nothing_else(pair_of: Callable, columns: tuple[int, int]) -> None:
    pair = pair_of(2, mirrored=True)
    sides = pair.a, pair.b
    before = align(*map(prepare, sides), orientations=ALL_ORIENTATIONS[:2])
    after = align(
        *(prepare(rolled(s, k)) for s, k in zip(sides, columns, strict=True)), orientations=ALL_ORIENTATIONS[:2]
    )
    assert isinstance(before, Alignment)
    assert isinstance(after, Alignment)
    step_rad = 2 * np.pi / 512
    expected = before.theta_shift_rad + step_rad * (columns[0] + columns[1])  # B is mirrored
    assert abs(wrap_rad(after.theta_shift_rad - expected)) < ROLLED_RAD
    assert np.abs(after.z_to_a(pair.b.z_mm) - before.z_to_a(pair.b.z_mm)).max() < ROLLED_Z_MM
    assert (after.mirrored, after.z_reversed) == (before.mirrored, before.z_reversed)


def test_the_same_input_gives_the_same_bits(pair: Pair) -> None:
    first, second = (align(prepare(pair.a), prepare(pair.b)) for _ in range(2))
    assert first == second


def test_the_score_of_no_overlap_is_none() -> None:
    correlation = np.array([1.0, -0.5, 0.5, 0.5], np.float32)
    scores = score(correlation, np.array([0.5, 30.0, 30.0, 60.0], np.float32))
    assert scores[0] == 0
    assert scores[1] == scores[2] > 0  # the sign carries no information
    assert scores[3] > scores[2]


def test_chance_is_what_it_says() -> None:
    """Of unrelated textures about a tenth reach what has a chance of a tenth, and what matches has next to none."""
    chances = []
    for seed in range(12):
        a, b = texture(seed), texture(seed + 100)
        best = max(_highest(a, b, orientation) for orientation in UPRIGHT)
        chances.append(chance_of(best, a, b, (False, False), 1))
    assert min(chances) > 1e-3
    assert 0.2 < np.median(chances) < 0.8
    one = texture(3)
    assert chance_of(_highest(one, one, (False, False)), one, one, (False, False), 1) < 1e-12


def _highest(a: Evidence, b: Evidence, orientation: tuple[bool, bool]) -> float:
    from endoct.fusion.registration.search import masked_correlation, padded_rows, spectra

    assert orientation == (False, False)
    n = padded_rows(a.z_mm.size, b.z_mm.size)
    correlation, overlap = masked_correlation(spectra(a.values, a.valid, n), spectra(b.values, b.valid, n))
    return float(score(correlation, overlap * np.float32(a.dz_mm * a.column_mm)).max())


@pytest.mark.parametrize("orientation", ALL_ORIENTATIONS)
def test_what_matches_is_shuffled_in_the_other_orientations_only(
    orientation: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    laid: list[tuple[bool, bool]] = []

    def noted(evidence: Evidence, *, mirrored: bool, z_reversed: bool, z_scale: float) -> Evidence:
        laid.append((mirrored, z_reversed))
        return reoriented(evidence, mirrored=mirrored, z_reversed=z_reversed, z_scale=z_scale)

    monkeypatch.setattr(search, "reoriented", noted)
    small = texture(1, (20, 24), 0.3)
    chance_of(3.0, small, texture(2, (20, 24), 0.3), orientation, 4)
    assert laid == search.SHUFFLES * [other for other in ALL_ORIENTATIONS if other != orientation]


@pytest.mark.parametrize("seed", range(3))
def test_walls_without_cells_are_not_aligned(panorama_of: Callable, seed: int) -> None:
    rng = np.random.default_rng(seed)
    light = 1 + 0.3 * np.cos(2 * np.pi / 512 * np.arange(512) - 1)
    dark = light * (1 + 0.1 * rng.normal(size=(120, 512)))
    depth = 0.03 * np.cos(2 * np.pi / 512 * np.arange(512)) + 0.008 * rng.normal(size=(30, 512))
    a = panorama_of(dark, dz_mm=0.05, known=False)
    b = panorama_of(rng.gamma(2, 1, depth.shape), dz_mm=0.2, depth_mm=depth, known=False)
    found = align(prepare(a), prepare(b))
    assert isinstance(found, NotAligned)
    assert "chance would give as much" in found.reason
    assert found.best is not None
    assert found.best.chance > LIKELY_CHANCE
    assert found.best.confidence < BELIEVABLE


def test_the_covariance_covers_the_error(pair_of: Callable) -> None:
    """Over pairs with noise of their own the errors are as large as the covariances say, to a factor of two."""
    squares = []
    for seed in range(8):
        pair = pair_of(seed, theta_shift_rad=2.0)
        found = refine(prepare(pair.a), prepare(pair.b), pair.truth, (0.95, 1.05))
        assert found.covariance is not None
        covariance = np.array(found.covariance)
        assert np.all(np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))) > 0)
        middle_mm = pair.b.z_mm.mean()
        off_rad = float(wrap_rad(found.theta_shift_rad - pair.truth.theta_shift_rad))
        off_mm = float(found.z_to_a(middle_mm) - pair.truth.z_to_a(middle_mm))
        squares.append((off_rad**2 / covariance[0, 0], off_mm**2 / float(found.z_error_mm(middle_mm)) ** 2))
        assert json.loads(json.dumps(asdict(found)))["covariance"][0][0] == covariance[0, 0]
    assert np.all(np.sqrt(np.mean(squares, axis=0)) < 2.0)
    assert np.all(np.sqrt(np.mean(squares, axis=0)) > 0.3)


def test_the_covariance_of_the_inverse_is_that_of_what_it_maps() -> None:
    rng = np.random.default_rng(0)
    spread = 1e-3 * rng.normal(size=(3, 3))
    there = Alignment(1.0, 3.0, 1.04, True, True, covariance=as_covariance(spread @ spread.T))
    drawn = rng.multivariate_normal([1.0, 3.0, 1.04], np.array(there.covariance), 4000)
    back = [replace(there, theta_shift_rad=t, z_shift_mm=z, z_scale=k).inverse() for t, z, k in drawn]
    expected = np.cov(np.array([(one.theta_shift_rad, one.z_shift_mm, one.z_scale) for one in back]).T)
    assert np.allclose(there.inverse().covariance, expected, rtol=0.15, atol=1e-7)
    assert np.allclose(there.inverse().inverse().covariance, there.covariance)
