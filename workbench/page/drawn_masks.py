"""Masks drawn and corrected on the page of a comparison: shown as they will be saved, saved as label images.

They lie in the comparison's folder, ``masks/SIDE/RATER_SESSION.png``, on the samples of that side's panorama. None is
ever replaced: what corrects one is a further session. The page sends strokes of a brush and polygons, in mm and rad, on
the circle of θ.
"""

import io
import shlex
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomlkit
from PIL import Image as Pillow

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.base.files.files import read_small
from endoct.base.files.json_values import object_in
from endoct.base.files.output import new_output
from endoct.base.files.scratch import clear_dead_scratch
from endoct.base.zarr.zarr_store import read_arrays
from endoct.fusion.files.outlines import fill
from endoct.fusion.files.session import MASKS
from endoct.fusion.files.store import COMPARISON_STORE, ComparisonOutline
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.modalities.acquisition import MOST_PLACE_MM
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.layers import mask_outlines
from endoct.workbench.page.presence import Gone, Origin
from endoct.workbench.page.saved_masks import NAME, flooded, read_saved, saved_names, scores_against
from endoct.workbench.page.sessions import POSTED

KIND = "mask"
CELLS = "cells"
"""The ground that stands for the cells that were segmented on the side."""
TOLERANCE_MM = 0.1
"""By which outlines are judged where a comparison does not say."""
MOST_SHAPES, MOST_POINTS = 5000, 20_000
MOST_RADIUS_MM = 2.0
MOST_TURNS = 3
LARGEST = 1e9
"""Largest number that is accepted: anything larger is no place, and may be no float."""
MOST_STROKED = 400_000_000
"""Samples that the pieces of one stroke may cover: some seconds of work."""


@dataclass(frozen=True, eq=False)
class DrawnMasks:
    """The masks of the comparison at ``origin``: its sides by name, and how each lies in the frame that is shown."""

    origin: Origin
    outline: ComparisonOutline
    sides: Mapping[str, PanoramaOutline]
    refused: str = ""
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def listed(self) -> dict[str, Any]:
        """Return for the page which masks there are, by side; ``refused`` says why none can be saved, else ""."""
        names = {side: saved_names(self.origin.folder, side) for side in self.sides}
        return {"masks": names, "refused": self.refused}

    def outlined(self, data: bytes) -> dict[str, Any]:
        """Return the outlines of a posted drawing, as it would be saved, in the frame that is shown; its share too.

        Raises :class:`EndoctError` for nonsense.
        """
        side, mask, _ = self._posted(data)
        grid = self.sides[side].grid
        return {"lines": mask_outlines(mask, grid, self._where(side)), "share": float(mask.mean())}

    def save(self, data: bytes) -> dict[str, Any]:
        """Save a posted drawing; return where, and the command line that scores against it.

        Raises :class:`EndoctError` for nonsense, a drawing without cells, and a name that is taken.
        """
        if self.refused:
            raise EndoctError(self.refused)
        side, mask, posted = self._posted(data)
        name = f"{posted.get('rater')}_{posted.get('session')}"
        if not NAME.fullmatch(name):
            raise EndoctError(
                "the mask needs a name", found=name[:60], expected="rater and session of letters, digits, '.' and '-'"
            )
        if not mask.any() or mask.all():
            raise EndoctError("the mask shows no cells", found="one and the same value everywhere")
        with self._lock, self.origin.held() as folder:
            _write(folder, side, name, mask, self.sides[side].grid)
            try:
                self.origin.check_present()
            except Gone:  # the page says that nothing was saved
                for suffix in (".png", ".toml"):
                    (folder / MASKS / side / f"{name}{suffix}").unlink(missing_ok=True)
                raise
        path = self.origin.folder / MASKS / side / f"{name}.png"
        return {"saved": name, "file": str(path), "command": self._command(side, path)}

    def score(self, data: bytes) -> dict[str, Any]:
        """Return how well each side agrees with the saved mask that is posted, and the command line that says so.

        Raises :class:`EndoctError` where there is none, or it cannot be placed.
        """
        self.origin.check_present()
        posted = object_in(data, POSTED)
        side, name = self._side(posted), posted.get("mask")
        stated = (self.outline.result.parameters.get("compare") or {}).get("tolerance_mm")
        tolerance_mm = float(stated) if isinstance(stated, int | float) else TOLERANCE_MM
        scores = scores_against(self.origin.folder, side, name, self.sides[side].grid, tolerance_mm)
        path = self.origin.folder / MASKS / side / f"{name}.png"
        return {"scores": scores, "command": self._command(side, path)}

    def _side(self, posted: Mapping[str, Any]) -> str:
        side = posted.get("side")
        if not isinstance(side, str) or side not in self.sides:
            raise EndoctError("there is no such side", found=repr(side)[:40], expected=", ".join(self.sides))
        return side

    def _posted(self, data: bytes) -> tuple[str, Mask, dict[str, Any]]:
        self.origin.check_present()
        posted = object_in(data, POSTED)
        side = self._side(posted)
        shapes, ground = shapes_from(posted.get("shapes")), self._ground(side, posted)
        return side, painted(shapes, self.sides[side].grid, ground), posted

    def _ground(self, side: str, posted: Mapping[str, Any]) -> Mask | None:
        """Return what is drawn on: nothing, the cells of the side, or a mask that was saved."""
        ground = posted.get("ground")
        if not ground:
            return None
        grid = self.sides[side].grid
        if ground == CELLS:
            return self._cells(side, grid)
        return read_saved(self.origin.folder, side, ground, grid)

    def _cells(self, side: str, grid: SurfaceGrid) -> Mask:
        """Return the cells of a side on its own samples: those of the nearest sample of the common grid."""
        common, where = self.outline.grid, self._where(side) or IN_PLACE
        stored = read_arrays(self.origin.folder / COMPARISON_STORE, ("mask",))["mask"][self.outline.names.index(side)]
        rows_mm = where.z_to_a(grid.z_mm)
        rows = np.rint(np.interp(rows_mm, common.z_mm, np.arange(common.n_z))).astype(np.intp)
        is_covered = (rows_mm >= common.z_mm[0] - common.dz_mm / 2) & (rows_mm <= common.z_mm[-1] + common.dz_mm / 2)
        theta_rad = where.theta_to_a(grid.theta_rad, grid.z_mm[:, None])
        columns = np.rint(common.column_of(theta_rad)).astype(np.intp) % common.n_theta
        return np.asarray(stored[rows[:, None], columns].astype(np.bool_) & is_covered[:, None])

    def _where(self, side: str) -> Alignment | None:
        return self.outline.alignment if side == self.outline.names[1] else None

    def _command(self, side: str, path: Path) -> str:
        folder, (a, b) = self.origin.folder, self.outline.names
        stores = {name: folder / "panoramas" / f"{name}.zarr" for name in (a, b)}
        output = folder.parent / f"{folder.resolve().name}-{path.stem}"
        if side == a:  # a truth lies in side A's frame
            parts = ["endoct", "compare", stores[a], stores[b], "--truth", path, "-o", output]
        else:
            parts = ["endoct", "compare", path, stores[b], "-o", output]
        return shlex.join(map(str, parts))


def _sidecar(grid: SurfaceGrid) -> bytes:
    """Return the sidecar of a mask; empty where only its panorama says where its samples lie."""
    if grid.rows_mm is not None or grid.theta0_rad != 0:
        return b""
    keys = {"modality": "mask", "bore_diameter_mm": 2 * grid.radius_mm, "z0_mm": grid.z0_mm, "dz_mm": grid.dz_mm}
    return tomlkit.dumps(keys).encode()


def _write(folder: Path, side: str, name: str, mask: Mask, grid: SurfaceGrid) -> None:
    """Write a mask below ``folder``, its sidecar first; where one cannot be written, neither stays.

    A mask whose save was killed is not there: at most its sidecar is, which the same save takes over.
    """
    path = folder / MASKS / side / f"{name}.png"
    if (folder / MASKS).is_symlink() or path.parent.is_symlink():
        raise EndoctError(f"{path.parent} is a link", remedy="move the link away")
    sidecar, text = path.with_suffix(".toml"), _sidecar(grid)
    if path.exists() or (sidecar.exists() and read_small(sidecar) != text):
        raise EndoctError(f"the mask {name} of {side} exists already", remedy="save it as another session")
    file = io.BytesIO()
    Pillow.fromarray(mask.astype(np.uint8) * 255).save(file, "PNG")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        clear_dead_scratch(path.parent)
        is_new = bool(text) and not sidecar.exists()
        if is_new:
            with new_output(sidecar, KIND) as scratch:
                scratch.write_bytes(text)
        try:
            with new_output(path, KIND) as scratch:
                scratch.write_bytes(file.getvalue())
        except BaseException:
            if is_new and not path.exists():  # else it belongs to a mask that another window has saved meanwhile
                sidecar.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise EndoctError(f"the mask {name} cannot be written", found=error.strerror or str(error)) from error


@dataclass(frozen=True, eq=False)
class Shape:
    """A stroke of a brush with ``radius_mm``, or a polygon where that is None; it ``adds`` cell, or takes it away.

    With the radius 0 its one point fills the hole there, or takes the cell there away.

    ``points``: float64 (n, 2), θ in rad, which runs on over the seam, and z in mm, in the frame of the side.
    """

    points: Coordinates
    adds: bool
    radius_mm: float | None


def shapes_from(posted: object) -> tuple[Shape, ...]:
    """Return shapes as a page sends them. Raises :class:`EndoctError` for anything else."""
    if not isinstance(posted, list) or len(posted) > MOST_SHAPES:
        raise EndoctError("what was drawn cannot be used", expected=f"{MOST_SHAPES} shapes at most")
    return tuple(_shape(each) for each in posted)


def painted(shapes: Sequence[Shape], grid: SurfaceGrid, ground: Mask | None = None) -> Mask:
    """Return ``ground``, bool (n_z, n_theta), empty where None, with ``shapes`` painted on it one after another.

    Raises :class:`EndoctError` for a stroke that is too long, and a hole that no cell encloses.
    """
    mask = np.zeros(grid.shape, np.bool_) if ground is None else ground.copy()
    for shape in shapes:
        if shape.radius_mm == 0:
            theta_rad, z_mm = shape.points[0]
            row, column = int(np.abs(grid.z_mm - z_mm).argmin()), round(float(grid.column_of(theta_rad))) % grid.n_theta
            mask = flooded(mask, row, column, adds=shape.adds)
        elif shape.radius_mm is None:
            rows = np.interp(shape.points[:, 1], grid.z_mm, np.arange(grid.n_z), left=-1, right=grid.n_z)
            columns = (shape.points[:, 0] - grid.theta0_rad) / grid.dtheta_rad
            mask[fill(np.stack([rows, columns], axis=1), grid.shape)] = shape.adds
        else:
            _stroke(mask, shape.points, shape.radius_mm, grid, shape.adds)
    return mask


def _stroke(mask: Mask, points: Coordinates, radius_mm: float, grid: SurfaceGrid, value: bool) -> None:
    """Set what lies within ``radius_mm`` of the line through ``points`` on the wall.

    Raises :class:`EndoctError` for a stroke that is too long to be drawn by hand.
    """
    z_mm, step_mm = grid.z_mm, grid.dtheta_mm
    line = np.stack([(points[:, 0] - grid.theta0_rad) * grid.radius_mm, points[:, 1]], axis=1)
    pieces = _pieces(line, radius_mm)
    low, high = pieces.min(axis=1) - radius_mm, pieces.max(axis=1) + radius_mm
    samples = np.prod(np.ceil((high - low) / (step_mm, grid.dz_mm)), axis=1)
    if samples.sum() > MOST_STROKED:
        raise EndoctError("a stroke is too long for its radius", expected="several shorter ones, or an outline")
    for (start, end), (left, top), (right, bottom) in zip(pieces, low, high, strict=True):
        rows = slice(*np.searchsorted(z_mm, [top, bottom]))
        columns = np.arange(int(np.ceil(left / step_mm)), int(np.floor(right / step_mm)) + 1)
        along = end - start
        x = columns[None, :] * step_mm - start[0]
        y = z_mm[rows, None] - start[1]
        share = np.clip((x * along[0] + y * along[1]) / max(float(along @ along), 1e-12), 0, 1)
        near = np.hypot(x - share * along[0], y - share * along[1]) <= radius_mm
        row, column = np.nonzero(near)
        mask[row + rows.start, columns[column] % grid.n_theta] = value


def _pieces(line: Coordinates, radius_mm: float) -> Coordinates:
    """Return a line, float64 (n, 2) in mm, as pieces (m, 2, 2) no longer than the brush is wide.

    Points that change its course by less than a twentieth of the radius are left out.
    """
    course = cv2.approxPolyDP(line.astype(np.float32), radius_mm / 20, closed=False)[:, 0].astype(np.float64)
    course = line[:1] if len(line) == 1 else np.concatenate([line[:1], course[1:-1], line[-1:]])
    if len(course) == 1:
        return np.stack([course, course], axis=1)
    lengths_mm = np.hypot(*np.diff(course, axis=0).T)
    counts = np.maximum(1, np.ceil(lengths_mm / (2 * radius_mm)))
    if counts.sum() > MOST_POINTS:
        raise EndoctError("a stroke is too long for its radius", expected="several shorter ones, or an outline")
    ends = [np.linspace(one, other, int(n) + 1) for one, other, n in zip(course[:-1], course[1:], counts, strict=True)]
    return np.concatenate([np.stack([points[:-1], points[1:]], axis=1) for points in ends])


def _shape(posted: Any) -> Shape:
    if not isinstance(posted, Mapping) or not isinstance(posted.get("adds"), bool):
        raise EndoctError("what was drawn cannot be used", found=repr(posted)[:80], expected="a stroke or a polygon")
    radius_mm = posted.get("radius_mm")
    if radius_mm is not None and not (_is_number(radius_mm) and 0 <= radius_mm <= MOST_RADIUS_MM):
        raise EndoctError("a brush cannot be used", found=repr(radius_mm)[:40], expected=f"up to {MOST_RADIUS_MM:g} mm")
    points = posted.get("points")
    listed = points if isinstance(points, list) and len(points) <= MOST_POINTS else []
    if not listed or not all(isinstance(at, list) and len(at) == 2 and all(map(_is_number, at)) for at in listed):
        raise EndoctError("a shape has points that cannot be used", expected=f"1 to {MOST_POINTS} of θ and z")
    places = np.asarray(listed, np.float64)
    farthest = np.abs(places).max(axis=0)
    if not np.isfinite(places).all() or farthest[0] > MOST_TURNS * 2 * np.pi or farthest[1] > MOST_PLACE_MM:
        raise EndoctError("a shape lies far outside the wall", found=f"{farthest[0]:g} rad, {farthest[1]:g} mm")
    if radius_mm is None and len(places) < 3:
        raise EndoctError("an outline encloses nothing", found=f"{len(places)} points", expected="three at least")
    if radius_mm == 0 and len(places) != 1:
        raise EndoctError("a click has one place", found=f"{len(places)} points")
    return Shape(places, posted["adds"], None if radius_mm is None else float(radius_mm))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
