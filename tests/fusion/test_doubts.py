"""What is doubted of a comparison: forced and bounded alignments, drifting cells, too little wall."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doubted import outside

from endoct.base.doubt import Doubt
from endoct.fusion.doubts import (
    doubts_of_alignment,
    doubts_of_bend,
    doubts_of_largest_cell,
    doubts_of_orientation,
    doubts_of_parts,
    doubts_of_scale,
    doubts_of_scores,
    scale_at_limit,
)
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.align import remedies
from endoct.fusion.registration.instruments import largest_cell_share
from endoct.fusion.registration.rigidity import LoosePart
from endoct.fusion.result import Drift, Line, Overlap, PairScores
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import AxialScale, Panorama

ALIGNED = Alignment(0.1, 0.2, 1.01, confidence=0.3)


def of_alignment(alignment: Alignment = ALIGNED, **parameters: Any) -> list[Doubt]:
    return outside(doubts_of_alignment(alignment, CompareParameters(**parameters)))


def side(
    name: str, stated: dict[str, float] | None = None, *, checked: bool = False, doubts: tuple[Doubt, ...] = ()
) -> Side:
    grid, ones = SurfaceGrid.full_circle(2, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25), np.ones((2, 8), np.float32)
    made = Panorama(grid, ones, None, ones > 0, ones, name, True, True)
    return Side(name, replace(made, doubts=doubts, axial_scale=AxialScale(stated or {}, checked)))


def of_scores(valid_fraction: float = 0.95, **changed: Any) -> list[Doubt]:
    scores = {"grid": Overlap(jaccard=0.8, dice=0.9)} | changed
    return outside(doubts_of_scores(valid_fraction, PairScores(**scores)))


def test_a_sound_comparison_is_not_doubted() -> None:
    assert of_alignment() == []
    assert of_scores() == []


def test_a_forced_alignment_is_doubted() -> None:
    (doubt,) = of_alignment(force=True)
    assert (doubt.code, doubt.side, doubt.value) == ("forced", None, 0.3)


@pytest.mark.parametrize(
    ("z_scale", "parameters", "doubted"),
    [
        (1.05, {}, True), (0.95, {}, True), (1.049, {}, False), (1.05, {"z_scale_max": 1.1}, False),
        (1.0, {"z_scale_min": 1.0, "z_scale_max": 1.0}, False),
    ],
)  # fmt: skip
def test_a_scale_at_a_limit_of_its_search_is_doubted(
    z_scale: float, parameters: dict[str, float], doubted: bool
) -> None:
    alignment = replace(ALIGNED, z_scale=z_scale)
    assert scale_at_limit(alignment, CompareParameters(**parameters)) == doubted
    (doubt,) = doubts_of_scale(alignment, None, CompareParameters(), side("endoscope"), side("oct"))
    assert (doubt.code, doubt.value, doubt.expected) == ("scale-at-limit", z_scale, (0.95, 1.05))
    assert "no other lays it there as one piece" in doubt.what


def test_a_pitch_is_contradicted_with_the_value_that_agrees() -> None:
    one, two = side("endoscope", {"visible_length_mm": 1.0}, checked=True), side("oct", {"pullback_pitch_mm": 0.25})
    at_limit, farther = replace(ALIGNED, z_scale=0.95), replace(ALIGNED, z_scale=0.8)
    of_scale, of_pitch = doubts_of_scale(at_limit, farther, CompareParameters(), one, two)
    assert of_scale.code == "scale-at-limit"
    assert "it fits best at 0.800" in of_scale.what
    assert (of_pitch.code, of_pitch.side, of_pitch.unit) == ("pitch-contradicted", "oct", "mm")
    assert (of_pitch.value, of_pitch.expected) == (pytest.approx(0.2), 0.25)
    assert "1.250 times as long as endoscope" in of_pitch.what
    assert "pullback_pitch_mm = 0.2 would agree; 0.25 is stated" in of_pitch.what


def test_either_of_two_unchecked_pitches_is_named() -> None:
    one, two = side("endoscope", {"feed_pitch_mm": 0.4}), side("oct", {"pullback_pitch_mm": 0.25})
    found = list(doubts_of_scale(ALIGNED, replace(ALIGNED, z_scale=0.8), CompareParameters(), one, two))[1:]
    assert {str(doubt.side): doubt.value for doubt in found} == pytest.approx({"endoscope": 0.5, "oct": 0.2})
    assert "Or else feed_pitch_mm = 0.5 of endoscope (0.4 is stated)" in found[1].what


def test_a_checked_length_is_suspected_where_its_own_recording_is_doubted() -> None:
    feed = Doubt("feed-against-nominal", "Frames lie farther apart.")
    doubted = side("endoscope", {"visible_length_mm": 1.0}, checked=True, doubts=(feed,))
    sound = side("endoscope", {"visible_length_mm": 1.0}, checked=True)
    other, placed = side("oct", checked=True), side("oct")
    assert [remedy.side for remedy in remedies(doubted, other, 0.8)] == ["endoscope"]
    assert [remedy.side for remedy in remedies(sound, other, 0.8)] == ["endoscope"]
    assert remedies(sound, placed, 0.8) == ()


@pytest.mark.parametrize(
    ("pairs", "per_mm", "error", "doubted"),
    [(12, 0.04, 0.01, True), (8, 0.04, 0.01, False), (12, 0.04, 0.03, False), (12, 0.005, 0.0, False)],
)
def test_cells_that_drift_apart_cast_doubt(pairs: int, per_mm: float, error: float, doubted: bool) -> None:
    """Four standard errors are sure of 12 pairs (Student's t of 10 degrees: 3.6), and are not of 8 (of 6: 4.3)."""
    still = Line(mean=0.0, per_mm=0.0, per_mm_error=0.01)
    moving = Line(mean=0.0, per_mm=-per_mm, per_mm_error=error)
    for drift in (Drift(pairs=pairs, length_mm=8.0, z_mm=moving, arc_mm=still),
                  Drift(pairs=pairs, length_mm=8.0, z_mm=still, arc_mm=moving)):  # fmt: skip
        found = of_scores(drift=drift)
        assert [doubt.code for doubt in found] == ["cells-drift-apart"] * doubted
        if doubted:
            where = "along" if drift.z_mm is moving else "around"
            start = f"Cells that both sides show drift apart {where} the bore, by 0.32 mm over 8.0 mm of it"
            assert found[0].what.startswith(start)
            assert (found[0].value, found[0].unit, found[0].expected) == (pytest.approx(-0.32), "mm", 0.0)


@pytest.mark.parametrize(
    ("overlap", "doubted"),
    [
        ({"sites": 9, "jaccard_interval": (0.7, 0.9), "jaccard_without_two": (0.74, 0.84)}, []),
        ({"sites": 9, "jaccard_interval": (0.38, 0.9), "jaccard_without_two": (0.74, 0.84)}, ["score-uncertain"]),
        ({"sites": 4, "jaccard_interval": None, "jaccard_without_two": (0.4, 0.84)}, ["few-cells-decide"]),
        ({"sites": 4, "jaccard_interval": None, "jaccard_without_two": (0.51, 0.96)}, []),
        ({"sites": 2, "jaccard_interval": None, "jaccard_without_two": None}, ["few-cells-decide"]),
        ({"sites": 0}, ["nothing-to-score"]),  # whatever index two empty masks are given
    ],
)
def test_a_score_with_nothing_behind_it_is_doubted(overlap: dict[str, Any], doubted: list[str]) -> None:
    found = of_scores(grid=Overlap(jaccard=0.8, **overlap))
    assert [doubt.code for doubt in found] == doubted


def test_an_alignment_that_rests_on_one_cell_is_doubted() -> None:
    relief = np.zeros((40, 80), np.float32)
    relief[5:25, np.arange(-10, 10)] = 0.3  # 400 samples, across the seam
    relief[30:34, 30:40] = 0.3  # 40
    valid = np.ones(relief.shape, np.bool_)
    evidence = Evidence(relief, valid, 0.1 * np.arange(40), 0.1, 0.0, 0.1 * 80 / (2 * np.pi), "relief")
    assert largest_cell_share(evidence) == pytest.approx(400 / 440)
    assert [doubt.code for doubt in doubts_of_largest_cell(400 / 440)] == ["one-cell-aligns"]
    assert list(doubts_of_largest_cell(0.89)) == []
    valid[:15] = False
    assert largest_cell_share(evidence) == pytest.approx(200 / 240)
    assert largest_cell_share(replace(evidence, kind="darkness")) == 0


def test_little_wall_and_no_cells_are_doubted() -> None:
    assert [doubt.code for doubt in of_scores(0.41)] == ["little-observed-by-both"]
    assert [doubt.code for doubt in of_scores(grid=Overlap(jaccard=None, dice=None))] == ["nothing-to-score"]


@pytest.mark.parametrize(
    ("mirrored", "z_reversed", "known", "doubted"),
    [
        (True, True, (True, True), True), (True, False, (True, True), True), (False, True, (True, True), False),
        (False, False, (True, True), False), (True, True, (True, False), False), (True, False, (False, True), False),
    ],
)  # fmt: skip
def test_a_stated_handedness_is_not_put_right_in_silence(
    mirrored: bool, z_reversed: bool, known: tuple[bool, bool], doubted: bool
) -> None:
    grid, ones = SurfaceGrid.full_circle(2, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25), np.ones((2, 8), np.float32)
    one, two = (Panorama(grid, ones, None, ones > 0, ones, "oct", each, True, "slice", {}) for each in known)
    alignment = replace(ALIGNED, mirrored=mirrored, z_reversed=z_reversed)
    found = list(doubts_of_orientation(alignment, one, two, "oct"))
    assert [doubt.code for doubt in found] == ["handedness-contradicted"] * doubted


WELL = 0.9, 0.1


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (LoosePart("band", 1.25, 2.5, 0.3, -0.4, WELL), "z = 1.2 and 2.5 mm it fits best +0.30 mm along and -0.40 mm"),
        (LoosePart("sector", 1.0, 2.0, 0.0, 0.2, WELL), "between θ = 57° and 115° it fits best +0.00 mm along"),
        (LoosePart("turn", 1.0, 2.0, 0.0, 0.2, WELL), "from where other directions do"),
    ],
)
def test_the_worst_of_parts_out_of_place_is_told(part: LoosePart, said: str) -> None:
    (doubt,) = outside(doubts_of_parts([part, LoosePart("band", 0.0, 1.0, 0.2, 0.0, WELL)], "oct"))
    assert said in doubt.what
    assert (doubt.side, doubt.expected) == ("oct", (0.0, 0.1 if part.kind == "turn" else 0.16))
    assert doubt.value == pytest.approx(0.5 if part.kind == "band" else 0.2)
    assert list(doubts_of_parts([], "oct")) == []


def test_a_bend_is_doubted_and_its_steps_are_said() -> None:
    bend = Bend((0.0, 2.6, 3.4, 6.0), (0.1, 0.1, -0.6, 0.0), (0.0, 0.0, 0.1, 0.0), (0.0,) * 4, (0.0,) * 4)
    (doubt,) = outside(doubts_of_bend(replace(ALIGNED, bend=bend), "oct"))
    assert (doubt.code, doubt.side, doubt.value, doubt.unit) == ("bent-along-the-bore", "oct", 0.6, "mm")
    assert "follows it by up to 0.60 mm along and 5.7° around" in doubt.what
    assert doubt.what.endswith("From z = 2.8 mm on it lies -0.70 mm farther along, turned by +5.7°.")
    assert outside(doubts_of_bend(ALIGNED, "oct")) == []


@pytest.mark.parametrize(("ratio", "chance", "said"), [(1.4, 1e-5, True), (1.39, 1e-5, False), (1.4, 2e-5, False)])
def test_an_alignment_by_rims_of_little_confidence_is_doubted(ratio: float, chance: float, said: bool) -> None:
    by_rims = replace(ALIGNED, confidence=0.1, ratio=ratio, chance=chance)
    assert [doubt.code for doubt in of_alignment(by_rims)] == ["aligned-by-rims"] * said
    assert of_alignment(replace(by_rims, confidence=0.18)) == []
    assert [doubt.code for doubt in of_alignment(by_rims, force=True)] == ["forced"]
