"""What is doubted of a comparison: forced and bounded alignments, drifting cells, too little wall."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from endoct.fusion.doubts import doubt_of_twist, doubts_of_alignment, doubts_of_orientation, doubts_of_result
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import CorrectedTwist, Drift, Line, PairScores, Result, StoredAlignment
from endoct.stitching.doubt import Doubt
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

ALIGNED = Alignment(0.1, 0.2, 1.01, confidence=0.3)


def of_alignment(alignment: Alignment = ALIGNED, **parameters: Any) -> list[Doubt]:
    return list(doubts_of_alignment(alignment, CompareParameters(**parameters), "oct"))


def of_result(**changed: Any) -> list[Doubt]:
    stated = {"jaccard": 0.8, "dice": 0.9, "valid_fraction": 0.95} | changed
    made = Result(sides=("endoscope", "oct"), aligned=True, alignment=StoredAlignment.of(ALIGNED), **stated)
    return list(doubts_of_result(made))


def test_a_sound_comparison_is_not_doubted() -> None:
    assert of_alignment() == []
    assert of_result() == []


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
    found = of_alignment(replace(ALIGNED, z_scale=z_scale), **parameters)
    assert [doubt.code for doubt in found] == ["scale-at-limit"] * doubted
    if doubted:
        assert (found[0].value, found[0].expected) == (z_scale, (0.95, 1.05))


@pytest.mark.parametrize(("per_mm", "error", "doubted"), [(0.04, 0.01, True), (0.04, 0.03, False), (0.005, 0.0, False)])
def test_cells_that_drift_apart_cast_doubt(per_mm: float, error: float, doubted: bool) -> None:
    still = Line(mean=0.0, per_mm=0.0, per_mm_error=0.01)
    moving = Line(mean=0.0, per_mm=-per_mm, per_mm_error=error)
    for drift in (Drift(pairs=12, length_mm=8.0, z_mm=moving, arc_mm=still),
                  Drift(pairs=12, length_mm=8.0, z_mm=still, arc_mm=moving)):  # fmt: skip
        found = of_result(scores=PairScores(drift=drift))
        assert [doubt.code for doubt in found] == ["cells-drift-apart"] * doubted
        if doubted:
            where = "along" if drift.z_mm is moving else "around"
            start = f"Cells that both sides show drift apart {where} the bore, by 0.32 mm over 8.0 mm of it"
            assert found[0].what.startswith(start)
            assert (found[0].value, found[0].unit, found[0].expected) == (pytest.approx(-0.32), "mm", 0.0)


def test_little_wall_and_no_cells_are_doubted() -> None:
    assert [doubt.code for doubt in of_result(valid_fraction=0.41)] == ["little-observed-by-both"]
    assert [doubt.code for doubt in of_result(jaccard=None, dice=None)] == ["nothing-to-score"]


def test_a_twist_corrected_against_the_other_side_is_doubted_with_both_figures() -> None:
    doubt = doubt_of_twist(CorrectedTwist(jaccard_without=0.71, jaccard_with=0.78), ("endoscope", "oct"))
    assert doubt.code == "twist-corrected"
    assert "0.710 without it, 0.780 with it" in doubt.what
    assert doubt.value == pytest.approx(0.07)


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
