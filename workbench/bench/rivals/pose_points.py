"""Points of the wall for rivals of the task "pose": of the air's surface that a side shows, and of that in the CT."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from skimage.measure import find_contours, marching_cubes

from endoct.base.arrays import Coordinates, Image
from endoct.fusion.evidence.side import Side
from endoct.fusion.pose.air import STEP_MM, AirAround
from endoct.fusion.pose.observation import COLUMNS, ROWS_MM, Layer, Observation
from endoct.fusion.pose.wall import Sense
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.pose_starts import RANKED_BY, Matching, Score
from endoct.workbench.bench.task import NotInstalled

LEAST_WEIGHT = 0.5
FLOORS_MM = (0.15, 0.6)
"""A floor is believed between these distances behind the wall: a nearer one is roughness, and a farther echo is
faint."""
FLOOR_STEP_MM = 0.2
NEAR_MM, TABLE_MM = 0.4, 0.2
DISTANCES_MM, LEAST_REACH_MM = (0.8, 0.4, 0.2), 0.4
"""Points farther apart do not correspond, in one round after the other. A robust kernel of that width reaches a little
farther."""
NEIGHBOURS = 10
"""A normal of the CT's surface is estimated from this many neighbouring points."""
JUDGED_WITHIN_MM = 0.3
WITHIN_MM = 6.5
"""A bore may meet what lies within this distance of the plan."""


@dataclass(frozen=True, eq=False)
class Points:
    """Places (n, 3), mm, and unit normals (n, 3) from air into bone."""

    places: Coordinates
    normals: Coordinates

    def thinned(self, most: int) -> "Points":
        """Return every n-th point, some ``most`` of them or up to twice as many."""
        step = max(1, len(self.places) // most)
        return Points(self.places[::step], self.normals[::step])


def points_of(side: Observation, sense: Sense, panorama: Panorama) -> Points:
    """Return the air's surface that a side shows, in its own frame: outlines of cells on the wall, and floors."""
    parts = [_outlines(side, sense, side.layers[0])]
    if panorama.depth_mm is not None:
        parts.append(_floors(side, sense, panorama))
    return Points(np.concatenate([part.places for part in parts]), np.concatenate([part.normals for part in parts]))


def surface_of(air: AirAround) -> Points:
    """Return the surface of the air in a CT where its share is a half, in the plan's bore frame."""
    values = air.values[0].numpy()
    vertices = marching_cubes(values[0], 0.5)[0]
    z, y, x = np.rint(vertices).astype(np.intp).T
    gradient = values[1:, z, y, x].T.astype(np.float64)
    places = vertices[:, ::-1] * STEP_MM + np.array(air.corner_mm)
    steep = np.linalg.norm(gradient, axis=1)
    near = (np.hypot(places[:, 0], places[:, 1]) < WITHIN_MM) & (steep > 1e-3)
    return Points(places[near], -gradient[near] / steep[near, np.newaxis])


@dataclass(frozen=True, eq=False)
class Nearness:
    """The surface of the air in a CT, to look up how near it is.

    ``table`` (n, 3): by cell of ``TABLE_MM``, x slowest, of ``shape`` from ``corner`` on: how near the surface is, 0 to
    1, times its normal.
    """

    surface: Points
    tree: KDTree
    corner: Coordinates
    shape: tuple[int, ...]
    table: Image

    @classmethod
    def of(cls, surface: Points, air: AirAround) -> "Nearness":
        """Return the table around the plan."""
        corner = np.array(air.corner_mm)
        extent = STEP_MM * (np.array(air.values.shape[:1:-1]) - 1)
        axes = [corner[axis] + np.arange(0, extent[axis], TABLE_MM) for axis in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        tree = KDTree(surface.places)
        distance, index = tree.query(grid.reshape(-1, 3), distance_upper_bound=NEAR_MM)
        near = np.maximum(0, 1 - distance / NEAR_MM)[:, np.newaxis]
        table = near * np.vstack([surface.normals, np.zeros(3)])[index]
        return cls(surface, tree, corner, grid.shape[:3], table.astype(np.float32))

    def roughly(self, places: Coordinates, normals: Coordinates) -> Image:
        """Return how near places (n, m, 3) with normals (m, 3) come to a surface that faces the same way, (n,)."""
        cell = np.rint((places - self.corner) / TABLE_MM).astype(np.intp)
        cell = np.clip(cell, 0, np.array(self.shape) - 1)
        flat = (cell[..., 0] * self.shape[1] + cell[..., 1]) * self.shape[2] + cell[..., 2]
        facing = np.einsum("nmi,mi->nm", self.table[flat], normals.astype(np.float32))
        return np.asarray(np.maximum(0, facing).mean(axis=1))

    def exactly(self, points: Points, transform: Coordinates, within_mm: float) -> float:
        """Return the share of points within a distance of a surface that faces the same way, the nearer the more."""
        places = points.places @ transform[:3, :3].T + transform[:3, 3]
        distance, index = self.tree.query(places, distance_upper_bound=within_mm)
        found = np.isfinite(distance)
        facing = (self.surface.normals[index[found]] * (points.normals[found] @ transform[:3, :3].T)).sum(axis=1)
        aside = ((places[found] - self.surface.places[index[found]]) * self.surface.normals[index[found]]).sum(axis=1)
        return float((np.maximum(0, 1 - (aside / within_mm) ** 2) * np.maximum(0, facing)).sum() / len(places))


Refine = Callable[[Points, Coordinates], Coordinates]
"""Points of a side and a transform (4, 4) to begin with, to a better one."""


def small_gicp_matching(air: AirAround) -> Callable[[Observation, Panorama], Matching]:
    """Match by small_gicp's ICP, from points to the planes of the CT's surface."""
    try:
        import small_gicp as library
    except ImportError:
        raise NotInstalled("small_gicp") from None
    surface = surface_of(air)
    target = library.PointCloud(surface.places)
    tree = library.KdTree(target)
    library.estimate_normals_covariances(target, tree, NEIGHBOURS)

    def refine(points: Points, transform: Coordinates) -> Coordinates:
        source = library.PointCloud(points.places)
        for distance_mm in DISTANCES_MM:
            result = library.align(
                target, source, tree, transform, registration_type="PLANE_ICP", max_correspondence_distance=distance_mm
            )
            transform = np.asarray(result.T_target_source)
        return transform

    return _matching(air, surface, refine)


def open3d_matching(air: AirAround) -> Callable[[Observation, Panorama], Matching]:
    """Match by Open3D's ICP, from points to the planes of the CT's surface, with Tukey's kernel."""
    try:
        import open3d as library
    except ImportError:
        raise NotInstalled("open3d") from None
    registration = library.pipelines.registration
    surface = surface_of(air)

    def cloud(points: Points) -> Any:
        made = library.geometry.PointCloud(library.utility.Vector3dVector(points.places))
        made.normals = library.utility.Vector3dVector(points.normals)
        return made

    def refine(points: Points, transform: Coordinates) -> Coordinates:
        target, source = cloud(_around(surface, points, transform)), cloud(points)
        for distance_mm in DISTANCES_MM:
            estimation = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(distance_mm))
            reach = max(distance_mm, LEAST_REACH_MM)
            result = registration.registration_icp(source, target, reach, transform, estimation)
            transform = np.asarray(result.transformation)
        return transform

    return _matching(air, surface, refine)


def _matching(air: AirAround, surface: Points, better: Refine) -> Callable[[Observation, Panorama], Matching]:
    near = Nearness.of(surface, air)

    def of(side: Observation, panorama: Panorama) -> Matching:
        def samples(sense: Sense) -> tuple[Coordinates, Callable[[slice], Score]]:
            few = points_of(side, sense, panorama).thinned(RANKED_BY)
            return few.places, lambda some: lambda places, turn: near.roughly(places, few.normals[some] @ turn.T)

        def refine(sense: Sense, transform: Coordinates, scale: float) -> tuple[float, Coordinates]:
            points = points_of(side, sense, panorama)
            stretched = Points(points.places * np.array([1.0, 1.0, scale]), points.normals)
            found = better(stretched, transform)
            return (near.exactly(stretched, found, JUDGED_WITHIN_MM) if np.isfinite(found).all() else -np.inf), found

        return Matching(samples, refine)

    return of


def _around(surface: Points, points: Points, transform: Coordinates) -> Points:
    """Return the part of a surface that points may come to lie on: Open3D makes a tree of it every time."""
    local = (surface.places - transform[:3, 3]) @ transform[:3, :3]
    radius = np.hypot(local[:, 0], local[:, 1])
    of_points = np.hypot(points.places[:, 0], points.places[:, 1])
    reach = 2 * DISTANCES_MM[0]
    kept = (radius > of_points.min() - reach) & (radius < of_points.max() + reach)
    kept &= np.abs(local[:, 2]) < np.abs(points.places[:, 2]).max() + reach
    return Points(surface.places[kept], surface.normals[kept])


def _outlines(side: Observation, sense: Sense, layer: Layer) -> Points:
    n = layer.air.shape[1]
    around = np.concatenate([layer.air, layer.air[:, :1]], axis=1)  # θ is a circle
    contours = find_contours(around, 0.5)
    if not contours:
        return Points(np.empty((0, 3)), np.empty((0, 3)))
    row, column = np.concatenate(contours).T
    known = layer.weight[np.rint(row).astype(int), np.rint(column).astype(int) % n] > LEAST_WEIGHT
    row, column = row[known], column[known]
    padded = np.pad(layer.air, ((0, 0), (1, 1)), mode="wrap")
    by_row, by_column = (np.asarray(np.gradient(padded, axis=axis)) for axis in (0, 1))
    at = np.rint(row).astype(int), np.rint(column).astype(int) % n + 1
    radius = side.radius_mm + layer.behind_mm
    z_slope = -by_row[at] / ROWS_MM * sense.inward
    arc_slope = -by_column[at] / (2 * np.pi * radius / COLUMNS) * sense.turning
    angle = sense.turning * 2 * np.pi / n * column
    normals = np.column_stack([-np.sin(angle) * arc_slope, np.cos(angle) * arc_slope, z_slope])
    steep = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return Points(_places(side, sense, side.z_mm[0] + ROWS_MM * row, angle, radius), normals / steep)


def _floors(side: Observation, sense: Sense, panorama: Panorama) -> Points:
    relief = Side(panorama.modality, panorama).evidence
    every = max(1, round(FLOOR_STEP_MM / relief.column_mm))
    row, column = np.nonzero(relief.valid & (relief.values > FLOORS_MM[0]) & (relief.values < FLOORS_MM[1]))
    row, column = row[column % every == 0], column[column % every == 0]
    angle = sense.turning * panorama.grid.theta_rad[column]
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(angle.size)])
    return Points(_places(side, sense, panorama.z_mm[row], angle, side.radius_mm + relief.values[row, column]), outward)


def _places(
    side: Observation, sense: Sense, z_mm: Coordinates, angle: Coordinates, radius: Coordinates | float
) -> Coordinates:
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), sense.inward * (z_mm - side.middle_mm)])
