"""The tube to print and calibrate by: its file, an STL, and a drawing with its dimensions."""

import math
from pathlib import Path

import numpy as np
import tomlkit
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.modalities.tube.target import Target
from endoct.workbench.exporting.mesh_files import Mesh, quads, save_stl
from endoct.workbench.requests import TargetRequest, by_request
from endoct.workbench.running.outputs import TUBE

LEAST_BORE_MM, MOST_BORE_MM = 1.5, 4.0
"""In narrower bores, grooves of six pixels of a 50 µm printer take too much of the wall. In wider ones, nothing sees
their floors."""
LENGTH_MM, WALL_MM = 12.0, 0.8
STEP_Z_MM, N_AROUND = 0.05, 480
EDGE_MM = 0.002
"""An edge across z is made of two rows of the mesh, this far before and behind it."""
FLAT_MM = 0.4
"""A flat so deep, outside along the third of the tube at its mouth, marks θ = 0 for the hand that mounts it."""


def tube_of(bore_diameter_mm: float) -> Target:
    """Return the tube for a bore. Raises :class:`EndoctError` for one that cannot be printed, or is too wide."""
    if not LEAST_BORE_MM <= bore_diameter_mm <= MOST_BORE_MM:
        raise EndoctError(
            "there is no tube of that bore",
            found=f"{bore_diameter_mm:g} mm",
            expected=f"{LEAST_BORE_MM:g} to {MOST_BORE_MM:g} mm",
        )
    ring_mm, groove_mm = 0.4, 0.3
    return Target(
        bore_diameter_mm=bore_diameter_mm,
        outer_diameter_mm=bore_diameter_mm + 2 * (ring_mm + groove_mm + WALL_MM + FLAT_MM),
        length_mm=LENGTH_MM,
        groove_width_mm=0.35,
        helix_width_mm=0.5,
        groove_depth_mm=groove_mm,
        helix_theta_rad=round(math.pi / 2, 4),
        helix_lead_mm=7.0,
        ring_z_mm=(3.6, 7.2),
        ring_width_mm=(0.6, 1.8),
        ring_depth_mm=ring_mm,
    )


@by_request(TargetRequest)
def write_tube(request: TargetRequest) -> Target:
    """Write ``tube.toml``, ``tube.stl`` and ``tube.pdf`` into the folder ``output``.

    Arguments are those of :class:`~endoct.workbench.requests.TargetRequest`. Raises :class:`EndoctError` where there is
    no such tube, or the folder cannot be written.
    """
    tube = tube_of(request.bore_diameter_mm)
    with new_output(Path(request.output), TUBE, overwrite=request.overwrite) as scratch:
        scratch.mkdir()
        (scratch / "tube.toml").write_text(_toml(tube), encoding="utf-8")
        save_stl(tube_mesh(tube), scratch / "tube.stl")
        draw_tube(tube, scratch / "tube.pdf")
    return tube


def tube_mesh(tube: Target) -> Mesh:
    """Return the closed surface of a tube, facing outward from its material; mm, z inward from the mouth."""
    edges = tube.ring_edges_mm
    z = np.concatenate([np.arange(0, tube.length_mm, STEP_Z_MM), [tube.length_mm]])
    z = np.unique(np.concatenate([z, edges - EDGE_MM, edges + EDGE_MM]).round(6))
    theta = np.linspace(0, 2 * np.pi, N_AROUND, endpoint=False)
    inner = tube.radius_mm + tube.relief_mm(z[:, None], theta)
    outer = np.full_like(inner, tube.outer_diameter_mm / 2)
    on_flat = z < tube.length_mm / 3
    with np.errstate(divide="ignore"):
        flat = np.where(np.cos(theta) > 0, (tube.outer_diameter_mm / 2 - FLAT_MM) / np.cos(theta), np.inf)
    outer[on_flat] = np.minimum(outer[on_flat], flat)
    points = np.concatenate([_cylinder(inner, z, theta), _cylinder(outer, z, theta)])
    n, ring, corners = inner.size, np.arange(N_AROUND), quads(*inner.shape)
    following, last = np.roll(ring, -1), n - N_AROUND
    outward = np.concatenate([corners[:, (3, 2, 1)], corners[:, (2, 0, 1)]])
    at_mouth = _between(ring, following, ring + n, following + n)
    at_end = _between(following + last, ring + last, following + last + n, ring + last + n)
    faces = np.concatenate([outward[:, ::-1], outward + n, at_mouth, at_end])
    grey = np.zeros((len(points), 3), np.uint8)
    return Mesh(points.astype(np.float32), grey, faces.astype(np.int32), {"faces": len(faces)})


def _cylinder(radius_mm: Coordinates, z_mm: Coordinates, theta: Coordinates) -> Coordinates:
    z = np.broadcast_to(z_mm[:, None], radius_mm.shape)
    return np.stack([radius_mm * np.cos(theta), radius_mm * np.sin(theta), z], axis=-1).reshape(-1, 3)


def _between(a: NDArray[np.intp], b: NDArray[np.intp], c: NDArray[np.intp], d: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return two triangles for each quadrangle a, b, d, c."""
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def draw_tube(tube: Target, path: Path) -> None:
    """Write a drawing of a tube as PDF: the wall unrolled, and a section along its axis, with dimensions in mm."""
    figure = Figure(figsize=(8.3, 11.7), layout="constrained")
    FigureCanvasAgg(figure)
    wall, section = figure.subplots(2, 1)
    theta, z = np.linspace(0, 2 * np.pi, 721), np.linspace(0, tube.length_mm, 600)
    depth = tube.relief_mm(z[:, None], theta)
    image = wall.imshow(depth, extent=(0, 360, tube.length_mm, 0), aspect="auto", cmap="Greys", interpolation="nearest")
    figure.colorbar(image, ax=wall, label="depth below the bore, mm")
    wall.set(xlabel="θ, degrees, clockwise as seen looking in", ylabel="z from the mouth, mm")
    wall.set_title(f"wall of the bore, unrolled: ⌀ {tube.bore_diameter_mm:g} mm; ink both grooves to the brim")
    _section(section, tube)
    figure.savefig(path, metadata={"Creator": "endoct"})


def _section(axes: Axes, tube: Target) -> None:
    z = np.linspace(0, tube.length_mm, 2000)
    ring = tube.radius_mm + tube.ring_depth_mm * (tube.ring_inside_mm(z) > 0)
    for side in (1, -1):
        axes.fill_between(z, side * ring, side * tube.outer_diameter_mm / 2, color="0.8", lw=0.8, edgecolor="k")
    axes.set_aspect("equal")
    axes.set(xlabel="z from the mouth, mm", ylabel="mm", title="section away from the grooves")
    for middle, width in zip(tube.ring_z_mm, tube.ring_width_mm, strict=True):
        axes.annotate(f"{width:g} wide, {tube.ring_depth_mm:g} deep, at {middle:g}", (middle, 0), ha="center", size=7)
    low = -tube.outer_diameter_mm / 2
    notes = [
        f"length {tube.length_mm:g}, outside ⌀ {tube.outer_diameter_mm:g}, inside ⌀ {tube.bore_diameter_mm:g}",
        f"axial groove at θ = 0: {tube.groove_width_mm:g} wide along the circumference, {tube.groove_depth_mm:g} deep",
        f"helical groove: {tube.helix_width_mm:g} wide along the circumference, {tube.groove_depth_mm:g} deep, "
        f"θ = {math.degrees(tube.helix_theta_rad):.2f}° + 360°·z/{tube.helix_lead_mm:g}",
        f"flat outside at θ = 0 along the first {tube.length_mm / 3:g} from the mouth; depths add up where marks cross",
        "measure and enter in tube.toml: bore (pin gauge), depth of a ring, distance of the rings",
    ]
    for k, note in enumerate(notes, 1):
        axes.annotate(note, (0, low - 0.7 * k), annotation_clip=False, size=8)
    axes.set_ylim(low - 0.7 * (len(notes) + 1), tube.outer_diameter_mm / 2 + 0.5)


def _toml(tube: Target) -> str:
    about = {name: field.description for name, field in Target.model_fields.items()}
    of_errors = {name: field.description for name, field in type(tube.standard_errors).model_fields.items()}
    values = tube.model_dump(mode="json")
    errors = values.pop("standard_errors")
    lines = ["# A tube to calibrate by. Print it, measure it, and enter what was measured.", ""]
    for name, value in values.items():
        lines += [f"# {about[name]}", tomlkit.dumps({name: value}).rstrip()]
    lines += ["", "[standard_errors]  # mm; smaller ones for what was measured"]
    for name, value in errors.items():
        lines += [f"# {of_errors[name]}", f"{name} = {value}"]
    return "\n".join(lines) + "\n"
