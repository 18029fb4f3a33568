"""Intervals hold what they say, distances are those of a cylinder, and agreement is as the textbooks have it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from endoct.base.errors import EndoctError
from endoct.fusion.pose.fit import PoseFit
from endoct.fusion.pose.observation import Layer, Observation
from endoct.fusion.pose.paired import equivalence, limits_of_agreement
from endoct.fusion.pose.pose import BorePose, angle_of, difference, ends_of, length_of, offset_at, sampled_axes
from endoct.fusion.pose.structures import Structure, clearance, depth_of_passing, structures_near
from endoct.fusion.pose.wall import OF_SIDE, SHARED, Sense, directions
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.stored import Segment
from endoct.modalities.ct.trajectory import Trajectory

PLAN = Trajectory((3.0, -20.0, 40.0), (15.0, 8.0, 35.0))
RADIUS_MM = 1.25


def a_pose(
    name: str = "camera", aside: tuple[float, float] = (0.3, -0.4), tilt: float = 0.02, deviation: float = 0.05
) -> BorePose:
    z = np.arange(0, 20.01, 0.2)
    layer = Layer(0.0, np.zeros((z.size, 64), np.float32), np.ones((z.size, 64), np.float32))
    side = Observation(name, z, RADIUS_MM, (layer,), 0.1, 0.7, 0.07, 0.15, handed=True, directed=True)
    parameters = np.zeros(SHARED + OF_SIDE)
    parameters[:4], parameters[SHARED] = (*aside, tilt, -tilt / 2), 15.0
    covariance = np.diag([deviation**2] * 2 + [(deviation / 10) ** 2] * 2 + [0.01] * OF_SIDE)
    return BorePose(PLAN, PoseFit((side,), (Sense(),), parameters, covariance, (0.9,)))


@pytest.mark.parametrize("true", [(0.0, 0.0), (0.05, 0.0), (1.0, -0.5)])
def test_the_interval_of_a_length_holds_the_truth(true: tuple[float, float]) -> None:
    rng = np.random.default_rng(1)
    covariance = np.array([[0.01, 0.004], [0.004, 0.03]])
    held = 0
    for seen in rng.multivariate_normal(true, covariance, 1500):
        estimate = length_of(seen, covariance)
        held += estimate.low <= np.hypot(*true) <= estimate.high
        assert estimate.low <= estimate.value <= estimate.high
    assert 0.94 <= held / 1500 <= 0.995


def test_sampled_axes_scatter_as_the_covariance_says() -> None:
    pose = a_pose()
    entries, inward = sampled_axes(pose, 20_000, np.random.default_rng(2))
    to_lps = pose.bore_to_lps
    for depth in (0.0, PLAN.length_mm, PLAN.length_mm + 5):
        local = (entries + depth * inward - to_lps[:3, 3]) @ to_lps[:3, :3]
        assert np.cov(local[:, :2].T) == pytest.approx(pose.axis_covariance(depth), abs=3e-4)
    angle = torch.tensor([0.02, -0.01], dtype=torch.float64)
    assert np.allclose(inward.mean(axis=0), PLAN.to_lps[:3, :3] @ directions(angle).numpy()[:, 2], atol=2e-4)


def test_offset_and_angle_are_those_of_the_geometry() -> None:
    pose = a_pose()
    for depth in (0.0, 12.0, 36.0):
        on_axis = pose.axis_lps(np.array([depth]))[0]
        local = (on_axis - PLAN.entry_mm) @ PLAN.to_lps[:3, :3]
        offset = offset_at(pose, depth)
        assert offset.across_mm == pytest.approx(local[:2])
        assert offset.distance_mm.value == pytest.approx(np.hypot(*local[:2]))
    between = np.degrees(np.arccos(pose.bore_to_lps[:3, 2] @ PLAN.to_lps[:3, 2]))
    assert angle_of(pose).value == pytest.approx(between)


def test_the_difference_of_two_sides_is_antisymmetric() -> None:
    one, other = a_pose(), a_pose("ranger", (0.1, 0.2), -0.01, 0.1)
    there, back = difference(one, other), difference(other, one)
    assert (there.of, back.of) == (("camera", "ranger"), ("ranger", "camera"))
    assert there.at_target.across_mm == pytest.approx(tuple(-v for v in back.at_target.across_mm))
    assert there.at_target.distance_mm == back.at_target.distance_mm
    spread = one.axis_covariance(0.0) + other.axis_covariance(0.0)
    assert np.allclose(there.at_entry.covariance_mm2, spread)


def a_structure(local: np.ndarray, pose: BorePose, voxel_mm: float = 0.0) -> Structure:
    to_lps = pose.bore_to_lps
    return Structure(2, local @ to_lps[:3, :3].T + to_lps[:3, 3], voxel_mm, "facial nerve")


@pytest.mark.parametrize(
    ("place", "distance"),
    [
        ((3.0, 0.0, 10.0), 3.0 - RADIUS_MM),
        ((0.0, 0.5, 10.0), 0.5 - RADIUS_MM),
        ((0.0, 0.0, PLAN.length_mm + 2), 2.0),
        ((0.0, RADIUS_MM + 3, -4.0), 5.0),
        ((0.2, 0.0, 0.1), -0.1),
    ],
)
def test_distance_is_that_to_a_cylinder(place: tuple[float, float, float], distance: float) -> None:
    pose = a_pose(deviation=1e-6)
    found = clearance(pose, a_structure(np.array([place]), pose), RADIUS_MM, np.random.default_rng(0))
    assert found.distance_mm.value == pytest.approx(distance)
    assert found.margin_mm == pytest.approx(distance, abs=1e-3)


def test_the_margin_grows_less_with_uncertainty_of_axis_and_labels() -> None:
    pose, sharp = a_pose(deviation=0.1), a_pose(deviation=1e-6)
    line = np.column_stack([np.full(41, 3.0), np.linspace(-4, 4, 41), np.full(41, 20.0)])
    generator = np.random.default_rng
    wide = clearance(pose, a_structure(line, pose), RADIUS_MM, generator(0))
    coarse = clearance(sharp, a_structure(line, sharp, 0.4), RADIUS_MM, generator(0))
    deviation = float(np.sqrt(pose.axis_covariance(20.0)[0, 0]))
    assert wide.margin_mm == pytest.approx(3.0 - RADIUS_MM - 1.96 * deviation, abs=0.02)
    assert coarse.margin_mm == pytest.approx(3.0 - RADIUS_MM - 0.19, abs=0.01)
    assert depth_of_passing(pose, a_structure(line, pose)) == pytest.approx(20.0)
    assert wide == clearance(pose, a_structure(line, pose), RADIUS_MM, generator(0))


def test_structures_are_found_by_label_and_lie_where_they_are() -> None:
    voxels = np.ones((40, 50, 60), np.uint8)
    k, j, i = np.indices(voxels.shape)
    voxels[np.hypot(np.hypot(k - 20, j - 20), i - 30) < 8] = 7
    steps = np.diag([0.4, 0.4, 0.4])[:, ::-1]
    bone = (Segment(1, "Temporal_Bone_L", (1,)),)
    volume = CtVolume(voxels, np.array([1.0, 2.0, 3.0]), steps, "lps", segments=bone)
    middle = np.array([1.0, 2.0, 3.0]) + 0.4 * np.array([30.0, 20.0, 20.0])
    plan = Trajectory(
        (float(middle[0]) - 6, float(middle[1]), float(middle[2])),
        (float(middle[0]), float(middle[1]), float(middle[2])),
    )
    (found,) = structures_near(volume, plan)
    assert (found.label, found.name, found.voxel_mm) == (7, "unknown label 7", 0.4)
    apart = np.linalg.norm(found.points_mm - middle, axis=1)
    assert apart.mean() == pytest.approx(8 * 0.4, abs=0.2)
    assert np.ptp(apart) < 0.8
    with pytest.raises(EndoctError, match="no labelled structure"):
        structures_near(replace(volume, voxels=np.ones_like(voxels)), plan)
    with pytest.raises(EndoctError, match="not whole"):
        structures_near(CtVolume(voxels + np.float32(0.5), volume.origin_mm, steps, "lps"), plan)


def test_limits_of_agreement_hold_their_share() -> None:
    rng = np.random.default_rng(3)
    held = bias_held = 0
    for _ in range(400):
        differences = rng.normal(0.2, 0.1, 12)
        found = limits_of_agreement(differences)
        held += found.low_interval[0] <= 0.2 - 1.96 * 0.1 <= found.low_interval[1]
        bias_held += found.bias_interval[0] <= 0.2 <= found.bias_interval[1]
    assert 0.91 <= held / 400 <= 0.99
    assert 0.91 <= bias_held / 400 <= 0.99
    assert limits_of_agreement(np.array([0.1, 0.2, 0.3])).bias == pytest.approx(0.2)


def test_equivalence_is_found_where_there_is_any_and_at_5_percent_at_the_bound() -> None:
    rng = np.random.default_rng(4)
    assert equivalence(rng.normal(0.0, 0.05, 20), 0.1).equivalent
    assert not equivalence(rng.normal(0.2, 0.05, 20), 0.1).equivalent
    at_bound = sum(equivalence(rng.normal(0.1, 0.05, 20), 0.1).equivalent for _ in range(600))
    assert at_bound / 600 < 0.08
    assert equivalence(np.full(4, 0.05), 0.1).equivalent
    with pytest.raises(EndoctError, match="must be positive"):
        equivalence(np.ones(4), 0.0)
    with pytest.raises(EndoctError, match="3 bores at least"):
        limits_of_agreement(np.ones(2))


def test_the_ends_of_a_side_are_the_depths_of_its_first_and_last_row() -> None:
    sides = SimpleNamespace(z_mm=np.array([9.0])), SimpleNamespace(z_mm=np.array([1.0, 2.0, 4.0]))
    pose: Any = SimpleNamespace(
        names=("a", "b"), fit=SimpleNamespace(sides=sides), depth_of=lambda name, z_mm: 10 * z_mm + (name == "b"),
        depth_deviation_mm=lambda name, z_mm: z_mm / 10,
    )  # fmt: skip
    first, last = ends_of(pose, "b")
    assert (first.value, last.value) == (11, 41)
    assert (last.high - last.value) / (first.high - first.value) == pytest.approx(4)
    (only, same) = ends_of(pose, "a")
    assert only == same
