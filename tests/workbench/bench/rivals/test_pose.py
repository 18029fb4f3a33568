"""A bore found in a CT with other people's libraries."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from pose_case import LENGTH_MM, SEEN_MM, PoseCase

from endoct.fusion.pose.air import air_around
from endoct.modalities.ct.ct_volume import read_ct
from endoct.workbench.bench.cases import bores
from endoct.workbench.bench.rivals import pose as rivals
from endoct.workbench.bench.rivals.pose_points import points_of, surface_of
from endoct.workbench.bench.rivals.pose_starts import observed, transform_of
from endoct.workbench.bench.task import Case, NotInstalled
from endoct.workbench.bench.tasks.pose import Located, judge
from endoct.workbench.pipeline.truth import TruePose

TURN_RAD = 0.7
LIBRARIES = ("small_gicp", "open3d")


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> bores.PoseCase:
    """A bore of which a ranger sees the wall, 0.5 mm and 1° off its plan."""
    bore = PoseCase.drawn()
    panorama = bore.panorama("ranger", turn_rad=TURN_RAD, columns=96)
    ct = read_ct(bore.write_ct(tmp_path_factory.mktemp("bore") / "ct.nrrd"))
    side = TruePose(TURN_RAD, 1, panorama.z_mm, panorama.z_mm + SEEN_MM[0])
    return Case("bore", ((panorama,), ct, bore.plan), bores.TrueBore(bore.to_lps, LENGTH_MM, (side,)), {})


@pytest.mark.slow
@pytest.mark.parametrize("library", LIBRARIES)
def test_a_rival_finds_a_small_bore(case: bores.PoseCase, library: str) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed", exc_type=ImportError)
    method = getattr(rivals, library)
    scores = judge(case, method(*case.given))
    assert scores["target_mm"] < 0.5
    assert scores["roll_deg"] < 5


@pytest.mark.parametrize("library", ["small_gicp", "open3d"])
def test_a_rival_that_is_not_installed_says_so(
    case: bores.PoseCase, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(NotInstalled, match=f"{library} is not installed"):
        getattr(rivals, library)(*case.given)


def test_the_points_of_a_wall_lie_on_the_surface_in_the_ct(case: bores.PoseCase) -> None:
    (panorama,), ct, plan = case.given
    side = observed(panorama)
    points = points_of(side, rivals.Sense(), panorama)
    surface = surface_of(air_around(ct, plan))
    to_plan = np.linalg.inv(plan.to_lps) @ case.truth.to_lps
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(TURN_RAD), -np.sin(TURN_RAD)], [np.sin(TURN_RAD), np.cos(TURN_RAD)]]
    turn[2, 3] = side.middle_mm + SEEN_MM[0]
    place = to_plan @ turn
    there, facing = points.places @ place[:3, :3].T + place[:3, 3], points.normals @ place[:3, :3].T
    nearest = np.array([np.argmin(((surface.places - one) ** 2).sum(axis=1)) for one in there])
    apart = np.linalg.norm(surface.places[nearest] - there, axis=1)
    assert np.median(apart) < 0.12
    assert np.median((surface.normals[nearest] * facing).sum(axis=1)) > 0.7


def test_a_start_puts_the_middle_of_a_side_where_it_says() -> None:
    transform = transform_of(np.array([0.4, -0.2, 0.0, 0.02, 3.0, np.pi / 2]), 12.0)
    # 3 mm before the pivot a tilt about y by 0.02 takes 0.06 mm off x
    assert transform[:3, 3] == pytest.approx([0.4 - 3 * np.sin(0.02), -0.2, 6 - 3 * np.cos(0.02)])
    assert transform[:3, 0] == pytest.approx([0, 1, 0], abs=0.001)


def test_of_two_sides_the_one_with_depth_is_located(case: bores.PoseCase, monkeypatch: pytest.MonkeyPatch) -> None:
    (panorama,), ct, plan = case.given
    camera = replace(panorama, depth_mm=None, modality="camera")
    asked: list[str] = []

    def best(side: object, *_: object, **__: object) -> object:
        asked.append(side.name)  # type: ignore[attr-defined]
        return rivals._Result(1.0, rivals.Sense(), np.eye(4), 1.0)

    monkeypatch.setattr(rivals, "_best", best)
    answer = rivals.matched_by(lambda air: lambda side, panorama: None)((camera, panorama), ct, plan)
    assert isinstance(answer, Located)
    assert asked == ["ranger"]
    assert answer.sides[0] is None
    assert answer.sides[1] is not None
