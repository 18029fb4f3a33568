"""What a comparison says of its sides: that the direction of z rests on a default, and doubts in their order."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.evidence.side import DrawnMask, Side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import TRAVEL_BY_DEFAULT
from endoct.workbench.pipeline.comparing import in_order, notes_on_travel

GRID = SurfaceGrid.full_circle(2, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
DRAWN = DrawnMask(GRID, np.eye(2, 8, dtype=np.bool_), "anna", "1")
STATED, UNKNOWN = "stated", "unknown"


def side(name: str, travel: str) -> Side:
    """A side whose travel is stated, unknown, or by default "in" or "out"."""
    by_default = {TRAVEL_BY_DEFAULT: travel} if travel in ("in", "out") else {}
    return Side(name, replace(DRAWN.panorama, travel_known=travel != UNKNOWN, provenance=by_default))


@pytest.mark.parametrize(
    ("of_a", "of_b", "noted"),
    [
        (UNKNOWN, "out", ["b: 'out'"]),
        ("in", UNKNOWN, ["a: 'in'"]),
        ("in", "out", ["a: 'in'", "b: 'out'"]),
        (STATED, "out", []),
        ("in", STATED, []),
        (STATED, STATED, []),
        (UNKNOWN, UNKNOWN, []),
    ],
)
def test_the_direction_of_z_rests_on_a_default(of_a: str, of_b: str, noted: list[str]) -> None:
    sides = side("a", of_a), side("b", of_b)
    said = [
        f"{each.name}: {note.split(', and ')[1].split(' was')[0]}"
        for each in sides
        for note in notes_on_travel(each, sides)
    ]
    assert said == noted


def test_a_mask_that_was_drawn_on_the_other_side_states_nothing() -> None:
    recorded = side("oct", "out")
    drawn = replace(DRAWN, drawn_on=recorded.panorama)
    sides = Side("mask", drawn.panorama, drawn), recorded
    assert drawn.panorama.travel_known
    assert len(list(notes_on_travel(recorded, sides))) == 1


def test_doubts_of_the_comparison_come_first_then_those_of_a_in_the_order_they_came_in() -> None:
    given = [Doubt("one", "x", "b"), Doubt("two", "x", "a"), Doubt("three", "x"), Doubt("four", "x", "a")]
    assert [doubt.code for doubt in in_order(given, "a")] == ["three", "two", "four", "one"]
