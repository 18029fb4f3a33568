"""The last fraction of a sample: the same answer however the work is cut up, and wherever it starts nearby."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tolerances import REFINED_MM, REFINED_RAD

from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration import equations
from endoct.fusion.registration.refinement import refine

SCALES = 0.95, 1.05


def sides(pair: Any) -> tuple[Any, Any]:
    return clipped(prepare(pair.a)), clipped(prepare(pair.b))


def assert_same(one: Alignment, other: Alignment) -> None:
    assert one.theta_shift_rad == pytest.approx(other.theta_shift_rad, abs=REFINED_RAD)
    assert one.z_to_a(3.0) == pytest.approx(other.z_to_a(3.0), abs=REFINED_MM)
    assert np.array(one.covariance) == pytest.approx(np.array(other.covariance), rel=0.01, abs=1e-9)


def test_it_does_not_matter_how_rows_are_cut_into_blocks(pair: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = sides(pair)
    whole = refine(a, b, pair.truth, SCALES)
    assert refine(a, b, pair.truth, SCALES) == whole
    monkeypatch.setattr(equations, "BLOCK_SAMPLES", 1000)
    assert_same(refine(a, b, pair.truth, SCALES), whole)


def test_it_ends_where_it_ends_wherever_it_starts(pair_of: Callable[..., Any]) -> None:
    pair = pair_of(2, theta_shift_rad=1.0)
    a, b = sides(pair)
    there = refine(a, b, pair.truth, SCALES)
    assert there.covariance is not None
    for turn_rad, shift_mm in ((0.02, -0.04), (-0.03, 0.05)):
        start = replace(
            pair.truth,
            theta_shift_rad=pair.truth.theta_shift_rad + turn_rad,
            z_shift_mm=pair.truth.z_shift_mm + shift_mm,
        )
        assert_same(refine(a, b, start, SCALES), there)


def test_what_one_side_did_not_see_pulls_at_nothing(pair_of: Callable[..., Any]) -> None:
    pair = pair_of(2, theta_shift_rad=1.0)
    a, b = sides(pair)
    seen = b.valid.copy()
    seen[:, : seen.shape[1] // 4] = False
    blank = replace(b, valid=seen, values=np.where(seen, b.values, np.float32(0)))
    spoiled = replace(b, valid=seen, values=np.where(seen, b.values, np.float32(0.1)))
    assert refine(a, spoiled, pair.truth, SCALES) == refine(a, blank, pair.truth, SCALES)


def test_waves_are_held_by_what_errs_as_one_whatever_the_blur(pair: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals err alike within 0.6 mm: a prior of 0.02 rad counts as much against fine edges as against wide ones."""
    a, b = sides(pair)
    fit = equations.Bending(pair.truth, np.zeros(1 + 2 * equations.WAVES))

    def held(sigma_mm: float) -> float:
        of = equations.level(a, b, 1, sigma_mm)
        with_prior = equations.equations(of, fit, SCALES)
        with monkeypatch.context() as without:
            without.setattr(equations, "BEND_RAD", 1e9)
            free = equations.equations(of, fit, SCALES)
        assert with_prior is not None
        assert free is not None
        return float(with_prior.normal[5, 5] - free.normal[5, 5])

    assert held(0.12) == pytest.approx(held(0.03), rel=1e-6)
    ours = held(0.03)
    monkeypatch.setattr(equations, "PATCH_MM", 0.3)
    assert ours == pytest.approx(4 * held(0.03), rel=1e-6)


def test_the_scale_is_expected_in_the_middle_of_its_range(pair: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its standard deviation there is that of any value as likely as any other: the width over √12."""
    a, b = sides(pair)
    of = equations.level(a, b, 1, 0.03)
    off = equations.Bending(replace(pair.truth, z_scale=1.02), np.zeros(1 + 2 * equations.WAVES))
    narrow, wide = (equations.equations(of, off, around) for around in ((0.9, 1.1), (0.6, 1.0)))
    assert narrow is not None
    assert wide is not None
    unit = (narrow.normal[2, 2] - wide.normal[2, 2]) / (12 / 0.2**2 - 12 / 0.4**2)
    monkeypatch.setattr(equations, "BEND_RAD", 1e9)
    free = equations.equations(of, off, (0.9, 1.1))
    assert free is not None
    assert unit == pytest.approx((narrow.normal[5, 5] - free.normal[5, 5]) * 0.02**2, rel=1e-6)
    pulled = (narrow.slope[2] - wide.slope[2]) / unit
    assert pulled == pytest.approx(12 / 0.2**2 * (1.0 - 1.02) - 12 / 0.4**2 * (0.8 - 1.02), rel=1e-6)
