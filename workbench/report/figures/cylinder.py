"""The bore as a solid, cut open lengthwise, cast ray by ray.

The bone is what lies between the wall, r = R + depth(θ, z), and an outer radius. Its axis lies in the cut. One half
shell is drawn at a time, the mouth to the left, θ growing upwards. It is seen from a little beyond the mouth, so that
the mouth's end face shows::

      v ↑   ┌ end face
        │  ╱▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒   cut face
        │  ██████ wall █████
        │  ╲▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒   cut face
        └────────────────────→ z          w: into the shell, away from the reader

A ray through (z₀, v) of the cut is z = z₀ + w·tan(tilt). Along it r = √(v² + w²) only grows: it meets the wall where r
first exceeds the wall's.
"""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.base.compute.compiled import compiled
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.drawing import (
    DEPTH_COLOURS,
    INTENSITY_COLOURS,
    PAGE_WIDTH_IN,
    bar_under,
    journal_style,
    new_figure,
    place,
    render,
    robust_limits,
)
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.wall_panels import thinned
from endoct.workbench.report.side_findings import SideFindings

TILT_RAD = math.radians(25)
REST_MM = 0.25
"""Bone drawn beyond the deepest place, mm."""
PIXELS_ALONG, PIXELS_ACROSS = 1500, 700
STEP_MM = 0.015
SLOPE_CAP = 3.0
"""Steeper walls are shaded like this one, as the flank of a cell rises within one sample."""

CUT_FACE, END_FACE, NOT_OBSERVED = (np.array(to_rgb(c), np.float32) for c in ("#e2d6bd", "#c4b595", "#b4bfd6"))
NOTHING, ON_CUT, ON_END, ON_WALL = 0, 1, 2, 3
"""What a ray meets."""
Floats = NDArray[np.float32]
Scalars = tuple[np.float32, ...]


@dataclass(frozen=True, eq=False)
class CutBore:
    """A bore to be cut open: ``depth_mm``, ``values`` and where they were ``observed``, (n_z, n_theta) on ``grid``.

    Bone reaches out to ``outer_mm``. ``colours`` are those of values. Where these are depths (``by_depth``), the flank
    of a cell has the colour of the depth at which a ray meets it.
    """

    grid: SurfaceGrid
    depth_mm: Floats
    values: NDArray[np.float64]
    observed: Mask
    colours: ScalarMappable
    by_depth: bool
    outer_mm: float


def draw_cylinder(side: SideFindings, grid: SurfaceGrid) -> Drawn | None:
    """Draw both half shells of the bore as ``side`` saw it on ``grid``, coloured by depth, else by intensity."""
    if side.is_drawn_mask:
        return None
    by_depth = side.depth_mm is not None
    values = np.where(side.valid, side.depth_mm if side.depth_mm is not None else side.intensity, np.nan)
    coarse, thin_values = thinned(grid, values)
    observed = np.isfinite(thin_values)
    low, high = robust_limits(thin_values, observed)
    mapping = ScalarMappable(Normalize(low, high), DEPTH_COLOURS if by_depth else INTENSITY_COLOURS)
    depth_mm = (
        np.where(observed, thin_values, 0).astype(np.float32) if by_depth else np.zeros(observed.shape, np.float32)
    )
    length_mm = grid.n_z * grid.dz_mm
    outer_mm = grid.radius_mm + float(np.percentile(depth_mm, 99.9)) + REST_MM
    bore = CutBore(coarse, depth_mm, thin_values, observed, mapping, by_depth, outer_mm)
    side_by_side = length_mm < 6 * outer_mm
    width_in = PAGE_WIDTH_IN / 2 - 0.65 if side_by_side else PAGE_WIDTH_IN - 0.7
    # across and along are drawn to one scale
    height_in = width_in * 2 * outer_mm / (length_mm * math.cos(TILT_RAD) + outer_mm * math.sin(TILT_RAD))
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, height_in if side_by_side else 2 * height_in + 0.5)
        for k, middle_deg in enumerate((90, 270)):
            left_in, top_in = (k * (width_in + 0.7), 0.0) if side_by_side else (0.0, k * (height_in + 0.5))
            axes = place(figure, 0.4 + left_in, top_in, width_in, height_in)
            image, extent = cast_half(bore, math.radians(middle_deg))
            axes.imshow(image, extent=extent, aspect=1 / math.cos(TILT_RAD), interpolation="auto")
            axes.set_title(f"({'ab'[k]}) θ from {middle_deg - 90}° to {middle_deg + 90}°", pad=2)
            axes.set_yticks([-grid.radius_mm, 0, grid.radius_mm], [f"{middle_deg + d}°" for d in (-90, 0, 90)])
            if k == 1 or side_by_side:
                axes.set_xlabel("z at the cut (mm)")
            for spine in axes.spines.values():
                spine.set_visible(False)
            _scale_bar(axes, extent[1], -outer_mm)
        below_in = (height_in if side_by_side else 2 * height_in + 0.5) + 0.5
        bar = place(figure, PAGE_WIDTH_IN / 2 - 1.3, below_in, 2.6, 0.08)
        bar_under(bar, mapping, "wall radius − bore radius (mm)" if by_depth else "intensity (a.u.)")
        rendered = render(figure, f"cylinder-{side.name}")
    shape = "the wall as measured" if by_depth else "the side has no depth, so the wall is drawn at the bore's radius"
    return Drawn(
        rendered,
        "cylinder",
        f"The bore cut open, {side.name}",
        f"Both half shells, seen from inside and {math.degrees(TILT_RAD):.0f}° from the mouth, in parallel projection; "
        f"{shape}. Grey-blue: not observed. Sand: cut through the bone, {REST_MM:g} mm beyond the deepest places.",
    )


def cast_half(bore: CutBore, middle_rad: float) -> tuple[Floats, tuple[float, float, float, float]]:
    """Return RGBA float32 (v, z) of the half shell around θ = ``middle_rad``, and its extent in mm of the cut."""
    grid, depth_mm, outer_mm, slope = bore.grid, bore.depth_mm, bore.outer_mm, math.tan(TILT_RAD)
    near_mm, far_mm = grid.z0_mm - grid.dz_mm / 2, grid.z0_mm + (grid.n_z - 0.5) * grid.dz_mm
    start_mm = near_mm - outer_mm * slope
    pixel_mm = max((far_mm - start_mm) * math.cos(TILT_RAD) / PIXELS_ALONG, 2 * outer_mm / PIXELS_ACROSS)
    n_along = math.ceil((far_mm - start_mm) * math.cos(TILT_RAD) / pixel_mm)
    n_across = math.ceil(2 * outer_mm / pixel_mm)
    z0_mm = np.linspace(start_mm, far_mm, n_along, dtype=np.float32)
    v_mm = np.linspace(outer_mm, -outer_mm, n_across, dtype=np.float32)
    turned_rad = middle_rad - grid.theta0_rad
    shell = near_mm, far_mm, outer_mm, grid.radius_mm, slope
    samples = grid.z0_mm, grid.dz_mm, turned_rad, grid.dtheta_rad
    met, rows, columns, r_mm, angle_rad = _cast(
        depth_mm, z0_mm, v_mm, tuple(map(np.float32, shell)), tuple(map(np.float32, samples))
    )
    image = np.zeros((n_across, n_along, 4), np.float32)
    image[met == ON_CUT, :3], image[met == ON_END, :3] = CUT_FACE, END_FACE
    image[met != NOTHING, 3] = 1
    wall = met == ON_WALL
    rows, columns = rows[wall], columns[wall]
    values = bore.values[rows, columns]
    by_value = np.minimum(r_mm[wall] - grid.radius_mm, depth_mm[rows, columns]) if bore.by_depth else values
    colour = bore.colours.to_rgba(by_value)[:, :3].astype(np.float32)
    colour[~bore.observed[rows, columns]] = NOT_OBSERVED
    image[wall, :3] = colour * _light(_normals(grid, depth_mm), rows, columns, angle_rad[wall])[:, np.newaxis]
    extent = (start_mm, far_mm, -outer_mm, outer_mm)
    return np.clip(image, 0, 1), extent


@compiled
def _cast(
    depth_mm: Floats, z0_mm: Floats, v_mm: Floats, shell: Scalars, samples: Scalars
) -> tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.int32], Floats, Floats]:
    """Return what the ray through each pixel meets, and of a wall the row, the column, the radius and the angle there.

    ``shell``: z of both its ends, its outer radius and the bore's, dz/dw of rays. ``samples``: z of the first and their
    step, the turn from the middle of the shell to the first column and their step.
    """
    near_mm, far_mm, outer_mm, radius_mm, slope = shell
    first_mm, dz_mm, turned_rad, dtheta_rad = samples
    shape = v_mm.size, z0_mm.size
    met = np.full(shape, NOTHING, np.uint8)
    rows, columns = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    radii_mm, angles_rad = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    n_z, n_theta = depth_mm.shape
    shallowest_mm = max(np.float32(0), radius_mm + depth_mm.min())
    for i in range(v_mm.size):
        v = v_mm[i]
        for j in range(z0_mm.size):
            w = max(np.float32(0), (near_mm - z0_mm[j]) / slope)
            if np.sqrt(v * v + w * w) >= outer_mm:
                continue
            at_face = True
            while z0_mm[j] + w * slope <= far_mm:
                angle = np.arctan2(v, w)
                row = min(max(int(np.rint((z0_mm[j] + w * slope - first_mm) / dz_mm)), 0), n_z - 1)
                column = int(np.rint((angle + turned_rad) / dtheta_rad)) % n_theta
                r = np.sqrt(v * v + w * w)
                if r >= min(radius_mm + depth_mm[row, column], outer_mm):
                    met[i, j] = ON_WALL
                    if at_face:
                        met[i, j] = ON_END if w > 0 else ON_CUT
                    rows[i, j], columns[i, j], radii_mm[i, j], angles_rad[i, j] = row, column, r, angle
                    break
                if at_face:  # nothing can be met before the shallowest place of the wall
                    w = max(w, np.sqrt(max(np.float32(0), shallowest_mm * shallowest_mm - v * v)))
                    at_face = False
                else:
                    w = w + np.float32(STEP_MM)
    return met, rows, columns, radii_mm, angles_rad


def _scale_bar(axes: Axes, x_mm: float, bottom_mm: float, length_mm: float = 1.0) -> None:
    """Draw an upright scale bar: along z the picture is foreshortened."""
    axes.plot([x_mm, x_mm], [bottom_mm, bottom_mm + length_mm], color="black", linewidth=2, solid_capstyle="butt")
    axes.annotate(
        f"{length_mm:g} mm", (x_mm, bottom_mm + length_mm / 2), xytext=(3, 0), textcoords="offset points",
        fontsize=6.5, rotation=90, va="center", annotation_clip=False,
    )  # fmt: skip


def _normals(grid: SurfaceGrid, depth_mm: Floats) -> tuple[Floats, Floats]:
    """Return the wall's slopes dr/(r dθ) and dr/dz, each (n_z, n_theta), over about 0.06 mm, capped."""
    across = max(1, round(0.03 / grid.dtheta_mm))
    around = (np.roll(depth_mm, -across, axis=1) - np.roll(depth_mm, across, axis=1)) / (2 * across * grid.dtheta_mm)
    along: Floats = np.gradient(depth_mm, grid.dz_mm, axis=0) if grid.n_z > 1 else np.zeros_like(depth_mm)
    return (
        np.clip(around, -SLOPE_CAP, SLOPE_CAP).astype(np.float32),
        np.clip(along, -SLOPE_CAP, SLOPE_CAP).astype(np.float32),
    )


def _light(normal: tuple[Floats, Floats], rows: NDArray[np.intp], columns: NDArray[np.intp], angle: Floats) -> Floats:
    """Return the brightness of wall samples at ``angle`` from the shell's middle, lit from the reader's upper left."""
    around, along = normal[0][rows, columns], normal[1][rows, columns]
    # the inward normal −e_r + r_θ/r e_θ + r_z e_z in (v, w, z); e_r = (sin, cos), e_θ = (cos, −sin)
    sine, cosine = np.sin(angle), np.cos(angle)
    towards_v = -sine + around * cosine
    towards_w = -cosine - around * sine
    length = np.sqrt(1 + around**2 + along**2)
    light_v, light_w, light_z = 0.45, -0.80, -0.40
    facing = (light_v * towards_v + light_w * towards_w + light_z * along) / length
    return np.asarray(0.42 + 0.62 * np.clip(facing, 0, 1), np.float32)
