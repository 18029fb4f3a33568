"""The air around a plan: of a large CT only what lies near the plan is looked at, and it is the same."""

import numpy as np
import pytest

from endoct.fusion.pose import air
from endoct.fusion.pose.air import air_around
from endoct.modalities.ct.ct_volume import CtVolume, part_around
from endoct.modalities.ct.trajectory import Trajectory

VOXEL_MM = 0.3
SHAPE = (120, 110, 100)
PLAN = Trajectory((1.0, -1.0, -3.0), (0.0, 1.0, 3.0))


@pytest.fixture
def ct() -> CtVolume:
    voxels = np.random.default_rng(3).integers(-1000, 1500, SHAPE).astype(np.int16)
    steps = np.diag([VOXEL_MM] * 3)[::-1].copy()
    return CtVolume(voxels, -(np.array(SHAPE) - 1) / 2 @ steps, steps, "lps")


def test_the_part_around_the_plan_makes_the_same_air(ct: CtVolume, monkeypatch: pytest.MonkeyPatch) -> None:
    found = air_around(ct, PLAN)
    assert found.length_mm == PLAN.length_mm
    of_part = found.values
    monkeypatch.setattr(air, "SPLINE_VOXELS", max(SHAPE))
    assert float((air_around(ct, PLAN).values - of_part).abs().max()) < 1e-5


def test_a_part_lies_where_it_lay_in_the_whole(ct: CtVolume) -> None:
    ends = np.array([PLAN.entry_mm, PLAN.target_mm])
    part = part_around(ct, ends, 2.0)
    assert part.voxels.size < ct.voxels.size / 10
    inside = (ends - part.origin_mm) @ np.linalg.inv(part.steps_mm)
    margin = 2.0 / VOXEL_MM
    assert (inside >= margin - 1e-9).all()
    assert (inside <= np.array(part.voxels.shape) - 1 - margin + 1e-9).all()
    first = np.rint((part.origin_mm - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)).astype(int)
    there = tuple(slice(a, a + n) for a, n in zip(first, part.voxels.shape, strict=True))
    assert np.array_equal(part.voxels, ct.voxels[there])
    assert part_around(ct, ends + 500, 2.0).voxels.size == 0
