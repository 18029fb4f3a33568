"""The air on and behind the wall as a volume, matched with a CT by SimpleITK."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.fusion.pose.air import STEP_MM, AirAround
from endoct.fusion.pose.observation import ROWS_MM, Observation
from endoct.fusion.pose.wall import Sense
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.pose_starts import RANKED_BY, Matching, Score

VOXEL_MM = 0.25
WITHIN_MM = 0.15
"""In front of the first layer, and behind the last one, the air is that of the layer up to this distance."""
LEAST_WEIGHT = 0.5
BLURS_MM = (0.3, 0.0)
"""The CT is blurred by these, one after the other."""
BINS, ITERATIONS, STEP, LEAST_STEP = 24, 60, 0.3, 1e-3
EDGES = (0.05, 0.95)
"""A voxel with a share of air between these is at an edge. Such voxels and their neighbours decide."""


def simpleitk_matching(air: AirAround) -> Callable[[Observation, Panorama], Matching]:
    """Match by Mattes' mutual information of a side's volume with the CT, near the edges that the side shows.

    Starts are ranked by correlation.
    """
    import SimpleITK as sitk

    whole = sitk.GetImageFromArray(air.values[0, 0].numpy())
    whole.SetSpacing((STEP_MM,) * 3)
    whole.SetOrigin(air.corner_mm)
    levels = [sitk.SmoothingRecursiveGaussian(whole, blur) if blur else whole for blur in BLURS_MM]

    def of(side: Observation, _panorama: Panorama) -> Matching:
        def samples(sense: Sense) -> tuple[Coordinates, Callable[[slice], Score]]:
            places, shares, known = volume_of(side, sense)
            step = max(1, int(known.sum()) // RANKED_BY)
            chosen, shown = places[known][::step], shares[known][::step]
            return chosen, lambda some: lambda there, _turn: _correlations(air, shown[some], there)

        def refine(sense: Sense, transform: Coordinates, scale: float) -> tuple[float, Coordinates]:
            places, shares, known = volume_of(side, sense)
            edges = known & (shares > EDGES[0]) & (shares < EDGES[1])
            near_edges = (known & ndimage.binary_dilation(edges)).astype(np.uint8)
            fixed, mask = (_image(sitk, values, places[0, 0, 0], scale) for values in (shares, near_edges))
            score = -np.inf
            for level in levels:
                score, transform = _registered(sitk, fixed, mask, level, transform)
            return score, transform

        return Matching(samples, refine)

    return of


def volume_of(side: Observation, sense: Sense) -> tuple[Coordinates, Image, Mask]:
    """Return a volume in the side's own frame: places (z, y, x, 3), shares of air and whether they are known."""
    behind = np.array([layer.behind_mm for layer in side.layers])
    reach = side.radius_mm + behind[-1] + WITHIN_MM
    across = np.arange(-reach, reach + VOXEL_MM / 2, VOXEL_MM)
    along = np.arange(-side.length_mm / 2, side.length_mm / 2 + 1e-9, VOXEL_MM)
    z, y, x = np.meshgrid(along, across, across, indexing="ij")
    layers = np.stack([layer.air for layer in side.layers])
    weights = np.stack([layer.weight for layer in side.layers])
    row = np.clip(np.rint((sense.inward * z + side.length_mm / 2) / ROWS_MM), 0, layers.shape[1] - 1).astype(int)
    angle = sense.turning * np.arctan2(y, x)
    column = np.rint(angle / (2 * np.pi) * layers.shape[2]).astype(int) % layers.shape[2]
    depth = np.hypot(x, y) - side.radius_mm
    at = np.interp(depth, behind, np.arange(behind.size))
    near, far = np.floor(at).astype(int), np.ceil(at).astype(int)
    share = (1 - (at - near)) * layers[near, row, column] + (at - near) * layers[far, row, column]
    known = np.minimum(weights[near, row, column], weights[far, row, column]) > LEAST_WEIGHT
    known &= (depth > behind[0] - WITHIN_MM) & (depth < behind[-1] + WITHIN_MM)
    return np.stack([x, y, z], axis=-1), share.astype(np.float32), known


def _image(sitk: Any, values: NDArray[Any], corner: Coordinates, scale: float) -> Any:
    image = sitk.GetImageFromArray(values)
    image.SetSpacing((VOXEL_MM, VOXEL_MM, VOXEL_MM * scale))
    image.SetOrigin((float(corner[0]), float(corner[1]), float(corner[2]) * scale))
    return image


def _registered(sitk: Any, fixed: Any, mask: Any, ct: Any, transform: Coordinates) -> tuple[float, Coordinates]:
    """Return the information that a volume and a CT share near a transform (4, 4), and the transform there."""
    rigid = sitk.Euler3DTransform()
    rigid.SetMatrix(transform[:3, :3].ravel().tolist(), 1e-4)
    rigid.SetTranslation(transform[:3, 3].tolist())
    method = sitk.ImageRegistrationMethod()
    method.SetNumberOfWorkUnits(1)
    method.SetMetricAsMattesMutualInformation(BINS)
    method.SetMetricFixedMask(mask)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(STEP, LEAST_STEP, ITERATIONS)
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetInitialTransform(rigid, inPlace=True)
    try:
        method.Execute(fixed, ct)
    except RuntimeError:  # all samples left the CT
        return -np.inf, transform
    found = np.eye(4)
    found[:3, :3] = np.array(rigid.GetMatrix()).reshape(3, 3)
    found[:3, 3] = rigid.GetTranslation()
    return -float(method.GetMetricValue()), found


def _correlations(air: AirAround, wall: Image, places: Coordinates) -> Image:
    """Return how the air of a CT at places (n, m, 3) correlates with ``wall`` (m,), (n,)."""
    values = air.values[0, 0].numpy()
    index = np.rint((places - np.array(air.corner_mm)) / STEP_MM).astype(np.intp)
    x, y, z = (np.clip(index[..., axis], 0, values.shape[2 - axis] - 1) for axis in range(3))
    there = values[z, y, x]
    there = there - there.mean(axis=1, keepdims=True)
    of = wall - wall.mean()
    return np.asarray(there @ of / np.sqrt((there**2).sum(axis=1) * (of**2).sum() + 1e-6))
