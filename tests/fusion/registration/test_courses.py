"""The cheapest course of shift and roll along the bore, and where it jumps."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import make_pair

from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.registration import courses
from endoct.fusion.registration.courses import Course, cheapest_course, jumps_of

Z_MM = np.arange(0, 8, 0.05)
NONE = np.zeros(Z_MM.size)


def test_a_course_follows_what_is_cheap_and_pays_for_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(courses, "CHANGE_COST", 1.0)
    monkeypatch.setattr(courses, "JUMP_COST", 4.0)
    cost = np.full((6, 7, 3), 9.0)
    for row, (shift, turn) in enumerate([(0, 0), (1, 0), (1, 0), (6, 2), (6, 2), (6, 2)]):
        cost[row, shift, turn] = 0
    shifts, turns = courses._cheapest(cost)
    assert shifts.tolist() == [0, 1, 1, 6, 6, 6]
    assert turns.tolist() == [0, 0, 0, 2, 2, 2]
    cost[3:, 1, 0] = 1.0  # three rows a little dearer are cheaper than a jump
    assert courses._cheapest(cost)[0].tolist() == [0, 1, 1, 1, 1, 1]


def test_a_rigid_wall_has_no_course_and_a_moved_one_has() -> None:
    pair = make_pair(3, rows=45)
    sides = clipped(prepare(pair.a)), clipped(prepare(pair.b))
    rigid = cheapest_course(*sides, pair.truth)
    assert rigid is not None
    assert np.median(np.abs(rigid.shift_mm)) < 0.03
    assert np.median(np.abs(rigid.roll_rad)) < 0.03
    assert jumps_of(rigid) == ()
    z_mm, turn_rad = pair.truth.z_shift_mm - 0.3, pair.truth.theta_shift_rad + 0.1
    moved = replace(pair.truth, z_shift_mm=z_mm, theta_shift_rad=turn_rad)
    found = cheapest_course(*sides, moved)
    assert found is not None
    assert np.median(found.shift_mm) == pytest.approx(0.3, abs=0.03)
    assert np.median(found.roll_rad) == pytest.approx(-0.1, abs=0.02)
    bare = [replace(side, values=np.zeros_like(side.values)) for side in sides]
    assert cheapest_course(*bare, pair.truth) is None


@pytest.mark.parametrize(
    ("course", "jumps"),
    [
        (Course(Z_MM, np.where(Z_MM < 3, 0, 0.15), NONE), [3.0]),
        (Course(Z_MM, np.where(Z_MM < 3, 0, 0.1), NONE), []),  # too small
        (Course(Z_MM, NONE, np.where(Z_MM < 3, 0, -0.07)), [3.0]),
        (Course(Z_MM, 0.1 * Z_MM, NONE), []),
        (Course(Z_MM, np.where(Z_MM < 3, 0, 0.2) + np.where(Z_MM < 3.4, 0, 0.4), NONE), [3.4]),  # the larger of two
        (Course(Z_MM, np.where(Z_MM < 3, 0, 0.2) + np.where(Z_MM < 5, 0, 0.4), NONE), [3.0, 5.0]),
        (Course(Z_MM, np.where(Z_MM < 0.5, 0, 0.2), NONE), []),  # too near the end
        (Course(Z_MM[:2], NONE[:2], NONE[:2]), []),
    ],
)
def test_jumps(course: Course, jumps: list[float]) -> None:
    assert list(jumps_of(course)) == pytest.approx(jumps, abs=0.06)
