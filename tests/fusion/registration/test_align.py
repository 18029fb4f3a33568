"""Where one side lies on the other: found over the whole circle, in every orientation, or refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair, make_pair
from hypothesis import given
from hypothesis import strategies as st
from tolerances import ALIGNMENT_THETA_RAD, ALIGNMENT_Z_MM, COORDINATE_ATOL

from endoct.base.arrays import Mask
from endoct.base.numeric.circle import wrap_rad
from endoct.base.numeric.regions import label
from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, as_covariance
from endoct.fusion.registration.align import (
    Alignment,
    NotAligned,
    RoughAlignment,
    align,
    align_sides,
    find_place,
    orientations_of,
)
from endoct.fusion.registration.instruments import corrected_for_instruments
from endoct.stitching.panorama import Panorama

alignments = st.builds(
    Alignment,
    theta_shift_rad=st.floats(0, 6.28),
    z_shift_mm=st.floats(-50, 50),
    z_scale=st.floats(0.9, 1.1),
    mirrored=st.booleans(),
    z_reversed=st.booleans(),
)


@given(alignment=alignments, theta=st.floats(0, 6.28), z=st.floats(-50, 50))
def test_mapping_there_and_back(alignment: Alignment, theta: float, z: float) -> None:
    assert alignment.z_to_b(alignment.z_to_a(z)) == pytest.approx(z, abs=1e-9)
    assert abs(wrap_rad(alignment.theta_to_b(alignment.theta_to_a(theta)) - theta)) < COORDINATE_ATOL
    inverse = alignment.inverse()
    assert inverse.z_to_a(z) == pytest.approx(alignment.z_to_b(z), abs=1e-9)
    assert abs(wrap_rad(inverse.theta_to_a(theta) - alignment.theta_to_b(theta))) < COORDINATE_ATOL


def test_the_mapping_by_hand() -> None:
    there = Alignment(theta_shift_rad=1.0, z_shift_mm=10.0, z_scale=0.5, mirrored=True, z_reversed=True)
    assert there.theta_to_a(0.25) == pytest.approx(0.75)
    assert there.z_to_a(4.0) == pytest.approx(8.0)


def test_what_is_known_is_not_searched(pair: Pair) -> None:
    whole, turning, moving = (
        replace(pair.a, handedness_known=handed, travel_known=directed)
        for handed, directed in ((True, True), (False, True), (True, False))
    )
    assert orientations_of(whole, whole) == ((False, False),)
    assert set(orientations_of(whole, turning)) == {(False, False), (True, False)}
    assert len(orientations_of(moving, whole)) == 4


def assert_found(pair: Pair, found: Alignment | NotAligned) -> None:
    assert isinstance(found, Alignment), found.reason
    truth: Alignment = pair.truth
    assert (found.mirrored, found.z_reversed) == (truth.mirrored, truth.z_reversed)
    assert abs(wrap_rad(found.theta_shift_rad - truth.theta_shift_rad)) < ALIGNMENT_THETA_RAD / 4
    shared = pair.b.z_mm[(truth.z_to_a(pair.b.z_mm) >= 0) & (truth.z_to_a(pair.b.z_mm) <= pair.a.z_mm[-1])]
    assert np.abs(found.z_to_a(shared) - truth.z_to_a(shared)).max() < ALIGNMENT_Z_MM


@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
@pytest.mark.parametrize("seed", [0, 1])
def test_every_orientation_is_recovered(pair_of: Callable, mirrored: bool, z_reversed: bool, seed: int) -> None:
    turn = 6.1 if seed else 2.0
    pair = pair_of(seed, mirrored=mirrored, z_reversed=z_reversed, theta_shift_rad=turn, z_scale=1.03 - 0.04 * seed)
    assert_found(pair, align(prepare(pair.a), prepare(pair.b)))
    # and the other way round
    back = align(prepare(pair.b), prepare(pair.a))
    assert isinstance(back, Alignment)
    assert_found(pair, back.inverse())


@pytest.mark.parametrize("overlap", [0.6, 1.0])
def test_partial_overlap(pair_of: Callable, overlap: float) -> None:
    pair = pair_of(3, overlap=overlap, theta_shift_rad=0.01)
    assert_found(pair, align(prepare(pair.a), prepare(pair.b)))


def test_either_polarity_is_found(pair_of: Callable) -> None:
    pair = pair_of(4, bright_cells=True)
    found = align(prepare(pair.a), prepare(pair.b))
    assert_found(pair, found)
    assert isinstance(found, Alignment)
    assert found.correlation < 0


@pytest.mark.parametrize("seed", range(5))
def test_another_bore_is_refused(pair_of: Callable, seed: int) -> None:
    pair = pair_of(seed, other_bore=True)
    found = align(prepare(pair.a), prepare(pair.b))
    assert isinstance(found, NotAligned)
    assert "stands out" in found.reason
    assert isinstance(align(prepare(pair.a), prepare(pair.b), force=True), Alignment)


def test_a_wrong_sidecar_is_named(pair_of: Callable) -> None:
    pair = pair_of(1, mirrored=True)
    found = align(prepare(pair.a), prepare(pair.b), orientations=((False, False),))
    assert isinstance(found, NotAligned)
    assert "Mirrored they would align: check handedness" in found.reason


def test_true_pairs_stand_out_far(pair: Pair) -> None:
    found = align(prepare(pair.a), prepare(pair.b))
    assert isinstance(found, Alignment)
    assert found.correlation > 0.8
    assert found.ratio > 2
    assert found.confidence > 0.4


@pytest.mark.parametrize(("slant", "z_reversed"), [(0.3, False), (-0.3, True)])
def test_what_an_oblique_view_hides_of_cells_does_not_move_the_other_side(
    pair_of: Callable, slant: float, z_reversed: bool
) -> None:
    pair = pair_of(5, slant=slant, z_reversed=z_reversed)
    told = replace(pair.a, per_frame={"view_slant": np.full(4, slant)})

    def off_mm(a: Panorama, *, turned: bool = False) -> float:
        one, two = prepare(a), prepare(pair.b)
        found = align(two, one) if turned else align(one, two)
        assert isinstance(found, Alignment)
        middle_mm = pair.b.z_mm.mean()
        return float((found.inverse() if turned else found).z_to_a(middle_mm) - pair.truth.z_to_a(middle_mm))

    assert np.sign(off_mm(pair.a)) == -np.sign(slant)
    assert abs(off_mm(told)) < 0.5 * abs(off_mm(pair.a))
    assert off_mm(told, turned=True) == pytest.approx(off_mm(told), abs=1e-3)


def test_where_there_are_no_cells_the_place_is_known_less_surely(pair_of: Callable) -> None:
    """It follows from the scale there, whichever side has depth."""
    pair = pair_of(5)
    middle_mm = float(pair.b.z_mm.mean())
    one, two = prepare(pair.a), prepare(pair.b)
    one = replace(one, values=np.where((one.z_mm < pair.truth.z_to_a(middle_mm))[:, np.newaxis], one.values, 0))
    two = replace(two, values=np.where((two.z_mm < middle_mm)[:, np.newaxis], two.values, 0))
    assert {one.kind, two.kind} == {"relief", "darkness"}
    for found, z_mm in ((align(one, two), two.z_mm), (align(two, one), one.z_mm)):
        assert isinstance(found, Alignment)
        near_mm, far_mm = found.z_error_mm(np.quantile(z_mm, [0.1, 0.9]))
        assert far_mm > 1.2 * near_mm


def lit(pair: Pair, seed: int) -> Evidence:
    """Darkness on A where half of the cells are dark, and the others brighter than the wall."""
    dark = prepare(pair.a)
    labels, n = label(pair.cells_a)
    signs = np.r_[1, np.random.default_rng(seed).permutation(np.resize([-1, 1], n))]
    return replace(dark, values=dark.values * signs[labels].astype(np.float32))


def test_cells_that_are_lit_as_often_as_dark_are_aligned_by_their_rims() -> None:
    pair = make_pair(5, rows=45)
    found = align(lit(pair, 1), prepare(pair.b))
    assert_found(pair, found)
    assert isinstance(found, Alignment)
    assert abs(found.correlation) < 0.3
    assert found.bend is None
    assert find_place(lit(pair, 1), prepare(pair.b), ALL_ORIENTATIONS, (0.95, 1.05)).by == "rims"
    other = make_pair(5, rows=45, other_bore=True)
    assert isinstance(align(lit(other, 1), prepare(other.b)), NotAligned)


@pytest.mark.parametrize(
    ("ratio", "chance", "is_believed"), [(1.4, 1e-5, True), (1.39, 1e-5, False), (1.4, 1.1e-5, False)]
)
def test_a_place_by_rims_of_little_confidence_must_be_clear(
    monkeypatch: pytest.MonkeyPatch, pair: Pair, ratio: float, chance: float, is_believed: bool
) -> None:
    best = replace(pair.truth, confidence=0.05, correlation=0.2, ratio=ratio, chance=chance)
    monkeypatch.setattr("endoct.fusion.registration.align.search", lambda *_: best)
    assert isinstance(align(prepare(pair.a), prepare(pair.b)), Alignment) == is_believed


def seen_by_an_eye(pair: Pair, cells: Mask | None = None) -> tuple[Evidence, Evidence]:
    """The cells of A as an eye sees them, sure but for noise, and the relief of B."""
    dark = prepare(pair.a)
    noise = np.random.default_rng(7).normal(0, 0.1, dark.values.shape).astype(np.float32)
    values = np.clip((pair.cells_a if cells is None else cells) + noise, 0, 1)
    return replace(dark, values=values, kind="probability"), prepare(pair.b)


def sides(pair: Pair) -> tuple[Side, Side]:
    return Side("endoscope", pair.a), Side("oct", pair.b)


def test_cells_seen_find_what_the_sides_own_evidence_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = make_pair(5, rows=45)
    a, b = sides(pair)
    nothing = RoughAlignment(None, replace(pair.truth, theta_shift_rad=pair.truth.theta_shift_rad + 1))
    assert align_sides(a, b, rough=nothing).alignment is None
    assert_found(pair, align_sides(a, b, rough=nothing, by_eye=seen_by_an_eye(pair)).alignment)
    other = make_pair(5, rows=45, other_bore=True)
    assert align_sides(*sides(other), rough=nothing, by_eye=seen_by_an_eye(other)).alignment is None
    # what rims have found is searched for anew, and stands where cells seen find nothing
    by_rims = RoughAlignment(pair.truth, pair.truth, "rims")
    alignment = align_sides(a, b, rough=by_rims, by_eye=seen_by_an_eye(pair)).alignment
    assert alignment is not None
    assert alignment.confidence > 0.3
    blind = seen_by_an_eye(pair, np.zeros(pair.cells_a.shape, np.bool_))
    assert_found(pair, align_sides(a, b, rough=by_rims, by_eye=blind).alignment)


@pytest.mark.parametrize(
    ("confidence", "chance", "is_believed"), [(0.4, 1e-5, True), (0.39, 1e-5, False), (0.4, 1.1e-5, False)]
)
def test_a_place_that_only_cells_seen_tell_must_be_clear(
    monkeypatch: pytest.MonkeyPatch, pair: Pair, confidence: float, chance: float, is_believed: bool
) -> None:
    best = replace(pair.truth, confidence=confidence, correlation=0.9, ratio=2.0, chance=chance)
    monkeypatch.setattr("endoct.fusion.registration.align.search", lambda *_: best)
    outcome = align_sides(*sides(pair), rough=RoughAlignment(None, best), by_eye=seen_by_an_eye(pair))
    assert (outcome.alignment is not None) == is_believed


def test_cells_seen_refine_a_place_where_they_agree_better(pair: Pair) -> None:
    a, b = sides(pair)
    by_own = align_sides(a, b).alignment
    by_eye = align_sides(a, b, by_eye=seen_by_an_eye(pair)).alignment
    blind = align_sides(a, b, by_eye=seen_by_an_eye(pair, ~pair.cells_a)).alignment
    assert by_own is not None
    assert by_eye is not None
    assert by_eye.correlation > by_own.correlation
    middle_mm = float(pair.b.z_mm.mean())
    assert by_eye.z_error_mm(np.array([middle_mm])) < by_own.z_error_mm(np.array([middle_mm]))
    assert_found(pair, by_eye)
    assert blind == by_own


def test_cells_as_an_eye_sees_them_need_no_correction_for_a_slant() -> None:
    relief = Evidence(
        np.zeros((21, 32), np.float32), np.ones((21, 32), np.bool_), np.linspace(-1, 1, 21), 0.1, 0, 1.0, "relief"
    )
    exact = Alignment(0.3, 0.1, covariance=as_covariance(np.zeros((3, 3))))
    seen = replace(relief, kind="probability", slant=0.5)
    corrected = corrected_for_instruments(exact, seen, relief)
    assert corrected.z_shift_mm == 0.1
    np.testing.assert_allclose(np.diag(corrected.covariance), np.square([0.002, 0.005, 0.0015]), rtol=1e-6)
    np.testing.assert_allclose(
        np.diag(corrected_for_instruments(exact, replace(seen, kind="darkness"), relief).covariance),
        np.square([0.002, 0.009, 0.002]),
        rtol=1e-6,
    )
    deep = replace(
        relief, values=np.where(np.arange(32) < 9, np.float32(0.2), np.float32(0)) * np.ones((21, 1), np.float32)
    )
    by_eye = corrected_for_instruments(exact, seen, deep)
    moved = corrected_for_instruments(exact, replace(seen, kind="darkness"), deep)
    assert by_eye.z_shift_mm == 0.1
    assert moved.z_shift_mm == pytest.approx(0.1 + 0.5 * 0.5 * 0.15)
    # all else that is left of cells is the same, and nothing for a slant that nobody knows
    of_eye, of_darkness = (np.array(each.covariance)[1, 1] for each in (by_eye, moved))
    assert of_eye - 0.005**2 == pytest.approx(of_darkness - 0.009**2, rel=1e-6)
