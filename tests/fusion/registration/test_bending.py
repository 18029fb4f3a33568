"""A bend along the bore: found where rows slipped, turned or were lost, none where nothing did or sides differ."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair, make_pair

from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.evidence import Evidence, clipped, prepare
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.fusion.registration import bending
from endoct.fusion.registration.align import align
from endoct.fusion.registration.bending import find_bend
from endoct.fusion.registration.equations import Level
from endoct.stitching.panorama import Panorama

ROWS, ROW_MM = 45, 0.2


@pytest.fixture(scope="module")
def pair() -> Pair:
    return make_pair(3, rows=ROWS)


def rows_of(b: Panorama, rows: np.ndarray) -> Panorama:
    """``b`` with these of its rows, at the places of its own."""
    assert b.depth_mm is not None
    return replace(b, intensity=b.intensity[rows], depth_mm=b.depth_mm[rows])


def turned(b: Panorama, by_rad: np.ndarray) -> Panorama:
    """``b`` with each row turned on by whole columns."""
    assert b.depth_mm is not None
    column = (np.arange(b.grid.n_theta) - np.round(by_rad / b.grid.dtheta_rad).astype(int)[:, None]) % b.grid.n_theta
    row = np.arange(b.grid.n_z)[:, None]
    return replace(b, intensity=b.intensity[row, column], depth_mm=b.depth_mm[row, column])


def bend_of(pair: Pair, b: Panorama, start: Alignment | None = None) -> Bend | None:
    return find_bend(clipped(prepare(pair.a)), clipped(prepare(b)), start or pair.truth)


def test_a_wall_that_lies_as_one_piece_does_not_bend(pair: Pair) -> None:
    assert bend_of(pair, pair.b) is None


@pytest.mark.parametrize("way", [{}, {"mirrored": True}, {"z_reversed": True, "mirrored": True, "z_scale": 1.02}])
def test_rows_that_turned_on_the_way_are_followed(way: dict) -> None:
    pair = make_pair(3, rows=ROWS, **way)
    roll_rad = 0.2 * np.linspace(-0.5, 0.5, ROWS)
    found = bend_of(pair, turned(pair.b, roll_rad))
    assert found is not None
    bent = replace(pair.truth, bend=found)
    z_mm = pair.b.grid.z_mm
    shared = (pair.truth.z_to_a(z_mm) > 0) & (pair.truth.z_to_a(z_mm) < pair.a.grid.z_mm[-1])
    # what row k shows at θ lies at θ - roll of the wall
    off_rad = wrap_rad(bent.theta_to_a(0.3, z_mm) - pair.truth.theta_to_a(0.3 - roll_rad))[shared]
    assert np.abs(off_rad).max() < 0.02
    assert np.abs(bent.z_to_a(z_mm) - pair.truth.z_to_a(z_mm))[shared].max() < 0.03
    assert np.sqrt(np.mean((off_rad / np.interp(z_mm, found.z_mm, found.roll_error_rad)[shared]) ** 2)) < 3


@pytest.mark.parametrize(("rows", "step_mm"), [(np.r_[:18, 21:45, [44] * 3], 0.6), (np.r_[:21, 18:42], -0.6)])
def test_lost_and_doubled_slices_are_a_step(pair: Pair, rows: np.ndarray, step_mm: float) -> None:
    between = replace(pair.truth, z_shift_mm=pair.truth.z_shift_mm + step_mm / 2)
    found = bend_of(pair, rows_of(pair.b, rows), between)
    assert found is not None
    ((at_mm, along_mm, roll_rad),) = found.steps
    assert along_mm == pytest.approx(step_mm, abs=0.05)
    assert at_mm == pytest.approx(float(pair.truth.z_to_a(3.8)), abs=0.1)
    assert abs(roll_rad) < 0.02
    whole = np.r_[0:18, 23:42] if step_mm < 0 else np.r_[0:18, 19:42]  # wall seen twice lies on neither side
    placed_mm = replace(between, bend=found).z_to_a(pair.b.grid.z_mm[whole])
    true_mm = pair.truth.z_to_a(ROW_MM * rows[whole])
    assert np.abs(placed_mm - true_mm)[true_mm < pair.a.grid.z_mm[-1]].max() < 0.04
    assert 0 < max(found.shift_error_mm) < 0.05


def test_the_coarser_side_may_be_the_first(pair: Pair) -> None:
    b = turned(pair.b, np.where(np.arange(ROWS) < 20, 0.08, -0.08))
    here = bend_of(pair, b)
    sides = clipped(prepare(b)), clipped(prepare(pair.a))
    there = find_bend(*sides, pair.truth.inverse())
    assert here is not None
    assert there is not None
    again = replace(pair.truth.inverse(), bend=there).inverse()
    assert again.bend is not None
    assert again.bend.roll_rad == pytest.approx(here.roll_rad, abs=1e-9)
    assert again.bend.z_mm == pytest.approx(here.z_mm, abs=1e-9)


def test_an_alignment_bends_only_once_it_is_believed(monkeypatch: pytest.MonkeyPatch, pair: Pair) -> None:
    asked = list[Alignment]()

    def bend(a: Evidence, b: Evidence, alignment: Alignment) -> Bend:
        asked.append(alignment)
        return Bend((0.0,), (0.1,), (0.0,), (0.0,), (0.0,))

    monkeypatch.setattr("endoct.fusion.registration.align.find_bend", bend)
    # instruments are corrected for afterwards: that moves all of the wall alike
    corrected = "endoct.fusion.registration.align.corrected_for_instruments"
    monkeypatch.setattr(corrected, lambda found, *_: replace(found, z_shift_mm=found.z_shift_mm + 1))
    believed = align(prepare(pair.a), prepare(pair.b))
    assert isinstance(believed, Alignment)
    assert believed.bend is not None
    other = make_pair(3, rows=ROWS, other_bore=True)
    forced = align(prepare(other.a), prepare(other.b), force=True)
    assert isinstance(forced, Alignment)
    assert forced.bend is None
    assert len(asked) == 1
    assert asked[0].z_shift_mm == believed.z_shift_mm - 1


def test_what_does_not_explain_wall_left_out_is_no_bend(monkeypatch: pytest.MonkeyPatch, pair: Pair) -> None:
    b = turned(pair.b, np.where(np.arange(ROWS) < 20, 0.08, -0.08))
    assert bend_of(pair, b) is not None
    gains = {False: (10.0, 7.0), True: (12.0, 8.1)}  # 1.43 and 1.48 standard errors
    monkeypatch.setattr(bending, "_gain", lambda *_, jumping: gains[jumping])
    assert bend_of(pair, b) is None
    gains[True] = 12.0, 7.9
    assert bend_of(pair, b) is not None
    monkeypatch.setattr(bending, "LEAST_MM", 0.2)
    assert bend_of(pair, b) is None  # it moves nothing by so much


def test_sides_that_show_nothing_in_common_do_not_bend(pair: Pair) -> None:
    apart = replace(pair.truth, z_shift_mm=100.0)
    assert bend_of(pair, pair.b, apart) is None


def test_a_quarter_of_the_directions_is_left_out_in_turn(monkeypatch: pytest.MonkeyPatch, pair: Pair) -> None:
    shares = list[np.ndarray]()

    def fit(_: Evidence, b: Evidence, __: Alignment, levels: list[Level], *, jumping: bool) -> None:
        del jumping
        shares.append(b.valid.mean(axis=0))
        assert all(of.coarse.valid.mean() == pytest.approx(b.valid.mean(), abs=0.02) for of in levels)

    monkeypatch.setattr(bending, "_fit", fit)
    assert bend_of(pair, pair.b) is None
    assert len(shares) == 8  # with jumps and without
    for four in (shares[:4], shares[4:]):
        assert [share.mean() for share in four] == pytest.approx([0.75] * 4, abs=0.06)
        assert np.stack(four).sum(axis=0) == pytest.approx(3.0)
