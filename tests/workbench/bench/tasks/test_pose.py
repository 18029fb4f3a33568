"""The task "pose" of the bench: the judge measures what can be reckoned by hand, and ours finds a small bore."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pose_case import LENGTH_MM, SEEN_MM, PoseCase
from scipy.spatial.transform import Rotation

from endoct.base.arrays import Coordinates
from endoct.modalities.ct.ct_volume import read_ct
from endoct.workbench.bench.cases import bores
from endoct.workbench.bench.task import Case, Declined
from endoct.workbench.bench.tasks.pose import BEYOND_MM, TASK, Located, LocatedSide, judge, ours
from endoct.workbench.pipeline.truth import TruePose

TURN_RAD = 0.7


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> bores.PoseCase:
    """A bore of which a ranger sees the wall."""
    bore = PoseCase.drawn()
    panorama = bore.panorama("ranger", turn_rad=TURN_RAD, columns=96)
    ct = read_ct(bore.write_ct(tmp_path_factory.mktemp("bore") / "ct.nrrd"))
    side = TruePose(TURN_RAD, 1, panorama.z_mm, panorama.z_mm + SEEN_MM[0])
    truth = bores.TrueBore(bore.to_lps, LENGTH_MM, (side,))
    return Case("bore", ((panorama,), ct, bore.plan), truth, {})


def placed(
    case: bores.PoseCase, *, shift: Coordinates | None = None, turn_rad: float = 0.0, tilt_rad: float = 0.0
) -> LocatedSide:
    """Return the truth, moved by ``shift`` in the bore frame, turned, or tilted about x at the mouth."""
    tilt = Rotation.from_rotvec([tilt_rad, 0, 0]).as_matrix()
    ends = np.array([[0.0, 0.0, z] for z in SEEN_MM]) @ tilt.T + (0.0 if shift is None else shift)
    angle = TURN_RAD + turn_rad
    to_lps = case.truth.to_lps
    zero = to_lps[:3, :3] @ np.array([np.cos(angle), np.sin(angle), 0.0])
    return LocatedSide(ends @ to_lps[:3, :3].T + to_lps[:3, 3], zero)


def located(case: bores.PoseCase, **moved: Any) -> Located:
    return Located((placed(case, **moved),))


def test_the_truth_has_no_error(case: bores.PoseCase) -> None:
    scores = judge(case, located(case))
    assert scores.pop("success") == 1
    assert scores.keys() == {"target_mm", "across_mm", "axis_deg", "roll_deg"}
    assert list(scores.values()) == pytest.approx([0] * 4, abs=1e-5)


def test_a_shift_a_tilt_and_a_turn_are_measured(case: bores.PoseCase) -> None:
    shifted = judge(case, located(case, shift=np.array([0.3, 0.0, 0.4])))
    assert (shifted["target_mm"], shifted["across_mm"]) == pytest.approx((0.5, 0.3), abs=1e-9)
    assert judge(case, located(case, shift=np.array([0.0, 0.0, 0.6])))["success"] == 0
    turned = judge(case, located(case, turn_rad=np.radians(-3) + 2 * np.pi))
    assert turned["roll_deg"] == pytest.approx(3)
    assert turned["target_mm"] == pytest.approx(0, abs=1e-9)
    tilted = judge(case, located(case, tilt_rad=0.01))
    assert tilted["axis_deg"] == pytest.approx(np.degrees(0.01))
    assert tilted["across_mm"] == pytest.approx((LENGTH_MM + BEYOND_MM) * np.sin(0.01))


def test_a_side_recorded_from_the_end_is_judged_beyond_the_end(case: bores.PoseCase) -> None:
    rows = case.given[0][0].z_mm
    backwards = TruePose(TURN_RAD, 1, rows, SEEN_MM[1] - rows)
    turned_round = replace(case, truth=replace(case.truth, sides=(backwards,)))
    side = placed(case)
    answer = Located((replace(side, ends_mm=side.ends_mm[::-1]),))
    assert judge(turned_round, answer)["target_mm"] == pytest.approx(0, abs=1e-9)
    # one who takes the wrong end for the end is far off
    assert judge(turned_round, located(case))["target_mm"] > LENGTH_MM


def test_depth_is_judged_by_the_side_that_has_depth(case: bores.PoseCase) -> None:
    panorama, wrong = case.given[0][0], placed(case, shift=np.array([0.0, 0.0, 3.0]))
    camera = replace(panorama, depth_mm=None, modality="camera")
    sides = case.truth.sides * 2
    both = replace(case, given=((camera, panorama), *case.given[1:]), truth=replace(case.truth, sides=sides))
    right = placed(case)
    assert judge(both, Located((wrong, right)))["target_mm"] == pytest.approx(0, abs=1e-9)
    assert judge(both, Located((right, wrong)))["target_mm"] == pytest.approx(3)
    assert judge(both, Located((None, right)))["target_mm"] == pytest.approx(0, abs=1e-9)
    with pytest.raises(ValueError, match="ranger was not located"):
        judge(both, Located((right, None)))


@pytest.mark.parametrize(("deviation_mm", "inside"), [(0.1, 0.0), (0.2, 1.0)])
def test_a_stated_ellipse_holds_the_truth_or_does_not(case: bores.PoseCase, deviation_mm: float, inside: float) -> None:
    # 0.3 mm are 3 deviations of 0.1 mm, and 1.5 of 0.2 mm; the ellipse has 2.45
    answer = replace(
        located(case, shift=np.array([0.3, 0.0, 0.0])), covariance=lambda place: deviation_mm**2 * np.eye(3)
    )
    assert judge(case, answer)["inside_95"] == inside


def test_where_only_the_line_is_known_the_depth_is_not_judged(case: bores.PoseCase) -> None:
    line = replace(case, truth=replace(case.truth, sides=()))
    scores = judge(line, located(case, shift=np.array([0.3, 0.0, 2.0])))
    assert scores["across_mm"] == pytest.approx(0.3)
    assert scores.keys() == {"success", "across_mm", "axis_deg"}
    side = placed(case)
    assert judge(line, Located((replace(side, ends_mm=side.ends_mm[::-1]),)))["axis_deg"] == pytest.approx(0, abs=1e-5)


def test_ours_finds_a_small_bore_and_says_how_sure_it_is(case: bores.PoseCase) -> None:
    scores = TASK.judge(case, ours(*case.given))
    assert scores["target_mm"] < 0.15
    assert scores["roll_deg"] < 3
    assert scores["inside_95"] in (0.0, 1.0)


def test_ours_declines_what_cannot_be_told(case: bores.PoseCase, monkeypatch: pytest.MonkeyPatch) -> None:
    cannot = SimpleNamespace(reason="the ranger's pattern fits as well at another place")
    monkeypatch.setattr("endoct.fusion.pose.finding.find_pose", lambda *given: cannot)
    with pytest.raises(Declined, match="as well at another place"):
        ours(*case.given)


def test_conditions_reach_the_case(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, object] = {}
    scratch = SimpleNamespace(name="folder", cleanup=lambda: None)

    def simulated(*given: object, **named: object) -> object:
        asked.update(simulated=(given, named))
        return scratch

    monkeypatch.setattr("endoct.workbench.bench.tasks.pose.simulated", simulated)
    monkeypatch.setattr("endoct.workbench.bench.tasks.pose.posed_case", partial(_asked, asked))
    TASK.cases(1003, 0, {"sides": ("oct",), "oct.wall_db": (9.0, 9.0)})
    (preset, seed, _, difficulties), named = asked["simulated"]  # type: ignore[misc]
    assert (preset, seed, named) == ("patient", 1003, {"ct": True})
    assert difficulties == {"ct.voxel_mm": 0.3, "oct.wall_db": 9.0}
    sides, of = asked["posed"]  # type: ignore[misc]
    assert sides == ("oct",)
    assert (of["seed"], of["plan_aside_mm"]) == (1003, 1.0)


def _asked(asked: dict[str, object], specimen: object, sides: object, **named: object) -> Case[object, object]:
    asked["posed"] = sides, named
    return Case("posed", None, None, {})
