"""What holds a pose up: bare stretches, wide ellipses and weak patterns are named; few edges widen what is stated."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from endoct.fusion.pose.air import STEP_MM, AirAround
from endoct.fusion.pose.fit import PoseFit, fit_pose
from endoct.fusion.pose.observation import Layer, Observation
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.support import drawn_on, ellipse_mm, longest_bare_stretch, support_doubts, too_wide
from endoct.fusion.pose.wall import DEPTH, OF_SIDE, SHARED, Sense, wall_places
from endoct.modalities.ct.trajectory import Trajectory

LENGTH_MM, RADIUS_MM, SEEN_MM = 20.0, 1.25, 18.0
PLAN = Trajectory((0.0, 0.0, 0.0), (0.0, 0.0, LENGTH_MM))


def bone(last_mm: float, noise: float) -> AirAround:
    """Round cells along the axis up to a depth, in bone that is uneven."""
    across = STEP_MM * np.arange(round(14 / STEP_MM) + 1) - 7
    along = STEP_MM * np.arange(round((LENGTH_MM + 14) / STEP_MM) + 1) - 7
    z, y, x = np.meshgrid(along, across, across, indexing="ij")
    rng, share = np.random.default_rng(4), np.zeros(z.shape)
    for depth in np.arange(1.5, last_mm, 0.9):
        angle = rng.uniform(0, 2 * np.pi)
        apart = np.hypot(np.hypot(x - 1.3 * np.cos(angle), y - 1.3 * np.sin(angle)), z - depth)
        share = np.maximum(share, np.clip(0.5 + (0.55 - apart) / 0.5, 0, 1))
    share += noise * rng.normal(size=share.shape)
    by_z, by_y, by_x = np.gradient(share, STEP_MM)
    values = np.stack([share, by_x, by_y, by_z]).astype(np.float32)
    return AirAround(torch.from_numpy(values)[None], (-7.0, -7.0, -7.0), LENGTH_MM)


def observed(air: AirAround) -> Observation:
    """What is seen along the plan, from 1 mm on, across the seam, but for a sector that is not."""
    z = np.arange(0, SEEN_MM + 0.01, 0.2)
    weight = np.ones((z.size, 64), np.float32)
    weight[:, 60:62] = 0
    blank = Layer(0.0, np.zeros_like(weight), weight)
    side = Observation("camera", z, RADIUS_MM, (blank,), 0.02, 0.7, 0.03, 0.15, handed=True, directed=True)
    places, _ = wall_places(side, Sense(), LENGTH_MM / 2, true_parameters(), 0.0)
    shown = np.where(air.share(places).numpy() > 0.3, air.share(places).numpy(), 0).clip(0, 1)
    return replace(side, layers=(Layer(0.0, shown.astype(np.float32), weight),))


def true_parameters() -> torch.Tensor:
    parameters = torch.zeros(SHARED + OF_SIDE, dtype=torch.float64)
    parameters[SHARED + DEPTH] = 1 + SEEN_MM / 2
    return parameters


def posed(last_mm: float, noise: float = 0.03) -> BorePose:
    clean, noisy = bone(last_mm, 0.0), bone(last_mm, noise)
    start = true_parameters()
    start[0], start[3] = 0.1, 0.01
    return BorePose(PLAN, fit_pose(noisy, [observed(clean)], [Sense()], start))


@pytest.fixture(scope="module")
def sparse() -> BorePose:
    return posed(6.0)


@pytest.fixture(scope="module")
def full() -> BorePose:
    return posed(LENGTH_MM)


def test_bare_wall_is_no_evidence(sparse: BorePose, full: BorePose) -> None:
    assert ellipse_mm(sparse) > 3 * ellipse_mm(full)
    # of a CT that is noisier the bare wall says no more: it would, if its gradients counted
    assert ellipse_mm(posed(6.0, 0.1)) > 0.9 * ellipse_mm(sparse)


@pytest.mark.parametrize("last_mm", [6.0, LENGTH_MM])
def test_the_ellipse_holds_the_truth(last_mm: float, sparse: BorePose, full: BorePose) -> None:
    pose = sparse if last_mm < LENGTH_MM else full
    off = (pose.bore_to_plan[:3, 3] + (LENGTH_MM + 5) * pose.bore_to_plan[:3, 2])[:2]
    assert off @ np.linalg.solve(pose.axis_covariance(LENGTH_MM + 5), off) < 5.99


def test_the_longest_bare_stretch_is_where_no_edge_is_seen(sparse: BorePose, full: BorePose) -> None:
    bare = longest_bare_stretch(sparse)
    assert bare.from_mm == pytest.approx(6.0, abs=1.0)
    assert bare.to_mm == pytest.approx(1 + SEEN_MM, abs=0.3)
    assert longest_bare_stretch(full).length_mm < 3
    # the side sees the bore from 1 mm on
    before, after = drawn_on(full)
    assert (before.from_mm, after.to_mm) == (0.0, LENGTH_MM)
    assert (before.to_mm, after.from_mm) == pytest.approx((1, 1 + SEEN_MM), abs=0.3)
    assert drawn_on(sparse)[-1] == bare


def test_what_is_hardly_held_up_is_doubted_or_not_told(sparse: BorePose, full: BorePose) -> None:
    assert list(support_doubts(full, [5.0])) == []
    (weak,) = support_doubts(full, [3.4, 3.1])
    assert "3.4 spreads" in weak.what
    assert any("show no edge of a cell" in doubt.what for doubt in support_doubts(sparse, [5.0]))
    assert too_wide(full) is None
    loose = BorePose(PLAN, _scaled(full.fit, 1.5 / ellipse_mm(full)))
    assert "leave open" in (too_wide(loose) or "")
    wide = BorePose(PLAN, _scaled(full.fit, 0.7 / ellipse_mm(full)))
    assert too_wide(wide) is None
    assert ["known to 0.7 mm only" in doubt.what for doubt in support_doubts(wide, [5.0])] == [True]


def _scaled(fit: PoseFit, by: float) -> PoseFit:
    return replace(fit, covariance=by**2 * fit.covariance)
