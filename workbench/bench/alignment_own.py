"""Pairs of recordings with truth as cases of the task "alignment": simulated specimens, in folders of one's own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.task import Case
from endoct.workbench.pipeline.truth import Pose, load_truth, true_pose


@dataclass(frozen=True, eq=False)
class TrueMap:
    """Where wall points of panorama B truly lie in panorama A's frame, the faults of both panoramas included."""

    a: Panorama
    pose_a: Pose
    pose_b: Pose

    def z_to_a(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return z in A's frame, mm; NaN where A does not reach."""
        in_bore = self.pose_a.z_bore(self.a.z_mm)
        order = np.argsort(in_bore)
        asked = self.pose_b.z_bore(np.asarray(z_b_mm, dtype=np.float64))
        return np.asarray(np.interp(asked, in_bore[order], self.a.z_mm[order], left=np.nan, right=np.nan))

    def theta_to_a(self, theta_b_rad: ArrayLike) -> Coordinates:
        """Return θ in A's frame, rad."""
        in_bore = self.pose_b.theta_bore(np.asarray(theta_b_rad, dtype=np.float64))
        return np.asarray((in_bore - self.pose_a.theta0_rad) * self.pose_a.sense)


def own_cases(specimen: Path) -> list[Case]:
    """Return a simulated specimen's endoscope (A) and OCT (B), unrolled by us, as a case.

    Raises :class:`EndoctError` where there is no pair, or no truth that says where it lies.
    """
    from endoct.workbench.api import unroll

    truth = load_truth(specimen)
    recordings = [specimen / name for name in ("endoscope", "oct")]
    if not all(path.is_dir() for path in recordings):
        raise EndoctError(f"{specimen} holds no pair", expected="both oct/ and endoscope/ in it")
    a, b = (unroll(path) for path in recordings)
    true = TrueMap(a, true_pose(a, truth), true_pose(b, truth))
    return [Case(specimen.name, (a, b), true, {"specimen": specimen.name})]
