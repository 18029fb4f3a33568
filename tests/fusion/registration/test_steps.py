"""A step along the bore: where it is found, how large, and where noise, a slope or single bands are none."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import make_pair

from endoct.base.doubt import Doubt
from endoct.fusion.doubts import doubts_of_step
from endoct.fusion.evidence.evidence import prepare
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration import steps
from endoct.fusion.registration.rigidity import FittedPart, PartFit
from endoct.fusion.registration.steps import BANDS, FEWEST_BANDS, LEAST_STEP_MM, Step, best_step, step_along

Z_MM = np.arange(0.5, 20, 0.25)
NOISE_MM = np.random.default_rng(3).normal(0, 0.02, Z_MM.size)


def bands_with(step_mm: float, at_mm: float = 8.1, slope: float = 0.0) -> np.ndarray:
    """How far along bands fit; those across the step lie between."""
    beyond = np.clip((Z_MM - at_mm) + 0.5, 0, 1)
    return step_mm * beyond + slope * Z_MM + NOISE_MM


@pytest.mark.parametrize("step_mm", [0.2, -0.2, 0.4])
@pytest.mark.parametrize("slope", [0.0, -0.01])
def test_a_step_is_found_beside_a_slope(step_mm: float, slope: float) -> None:
    along_mm = bands_with(step_mm, slope=slope)
    along_mm[[5, 40, 60]] += [0.4, -0.4, 0.3]  # by chance
    found = best_step(Z_MM, along_mm)
    assert found is not None
    assert found.along_mm == pytest.approx(step_mm, abs=0.02)
    assert found.at_mm == pytest.approx(8.1, abs=0.3)


@pytest.mark.parametrize(
    "along_mm",
    [
        bands_with(0.0),
        bands_with(0.0, slope=0.02),
        bands_with(0.9 * LEAST_STEP_MM) - 0.8 * NOISE_MM,  # clear, but too small
        0.06 * np.sin(Z_MM),  # it bends
        bands_with(0.2) + 8 * NOISE_MM,  # lost in noise
    ],
    ids=["none", "slope", "small", "bent", "noise"],
)
def test_what_is_no_clear_step_is_none(along_mm: np.ndarray) -> None:
    assert best_step(Z_MM, along_mm) is None


@pytest.mark.parametrize(("n", "found"), [(FEWEST_BANDS, True), (FEWEST_BANDS - 1, False)])
def test_a_step_has_bands_on_either_side(n: int, found: bool) -> None:
    z_mm = np.r_[np.arange(n), 20 + np.arange(n)].astype(float)
    assert (best_step(z_mm, np.where(z_mm < 19, 0.0, 0.3)) is not None) == found
    assert best_step(z_mm[:0], z_mm[:0]) is None


@pytest.mark.parametrize("lost", [True, False])
def test_a_lost_slice_is_placed_and_said(lost: bool) -> None:
    """At row 30 of 60, 0.2 mm apart, found from an alignment that splits the difference."""
    pair = make_pair(rows=60)
    rows = np.r_[0:30, 31:60, [59]] if lost else np.arange(60)
    b = pair.b
    assert b.depth_mm is not None
    b = replace(b, intensity=b.intensity[rows], depth_mm=b.depth_mm[rows])
    between = Alignment(pair.truth.theta_shift_rad, pair.truth.z_shift_mm + 0.1 * lost)
    found = step_along(prepare(pair.a), prepare(b), between)
    if not lost:
        assert found is None
        return
    assert found is not None
    assert 0.12 < found.along_mm < 0.28  # bands of 1 mm are five slices
    at_mm = float(b.grid.z_mm[30]) + pair.truth.z_shift_mm
    assert found.at_mm == pytest.approx(at_mm, abs=0.5)


@pytest.mark.parametrize(("along_mm", "cause", "other"), [(0.21, "lost", "doubled"), (-0.21, "doubled", "lost")])
def test_the_doubt_says_where_and_why_without_saying_whose_fault(along_mm: float, cause: str, other: str) -> None:
    (doubt,) = doubts_of_step(Step(3.14, along_mm), "oct")
    stated = Doubt("step-along-the-bore", doubt.what, side="oct", value=0.21, unit="mm", expected=(0.0, 0.12))
    assert doubt == replace(stated, z_mm=(3.14, 3.14))
    assert f"z = 3.1 mm on, the wall of oct fits best {along_mm:+.2f} mm" in doubt.what
    assert f"Its slices or frames may be {cause} there, or the other side's {other}, or the feed slipped." in doubt.what
    assert not list(doubts_of_step(None, "oct"))


def test_only_bands_that_are_sure_count_each_to_a_fraction_of_a_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    z_mm = np.arange(0, 20, 0.5)
    exactly_mm = np.where(z_mm < 10, 0.03, 0.23)
    exactly_mm[(z_mm == 9.5) | (z_mm == 10)] = 0.1, 0.16  # bands across the step fit neither side of it
    sure = [
        FittedPart("band", z - 0.4, z + 0.4, PartFit(0.1, 0.0, (BANDS.clear, -1.0), exact - 0.1))
        for z, exact in zip(z_mm, exactly_mm, strict=True)
    ]
    unsure = [FittedPart("band", 3.0, 3.8, PartFit(4.0, 0.0, (BANDS.clear - 1e-9, 1.0)))] * 50
    monkeypatch.setattr(steps, "bands", lambda *_: [*sure, *unsure])
    found = step_along(prepare(make_pair().a), prepare(make_pair().b), make_pair().truth)
    assert found is not None
    assert found.along_mm == pytest.approx(0.2)
    assert found.at_mm == pytest.approx(9.75)


@pytest.mark.parametrize(("noisy", "found"), [(1.0, True), (1.2, False)])
def test_a_step_must_explain_half_of_what_is_left(noisy: float, found: bool) -> None:
    """Two lines leave 0.49 and 0.57 of what one line leaves of the bands that do not lie across the step."""
    z_mm = np.arange(0.5, 20, 0.25)
    along_mm = np.where(z_mm < 10, 0.0, 0.2) + noisy * np.where(np.arange(z_mm.size) % 2, 0.02, -0.02)
    assert (best_step(z_mm, along_mm) is not None) == found
