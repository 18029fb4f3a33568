"""The cavities of a bore's cells as arrays: where each lies, how it is shaped, and what it can reach."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Cell

FIRST_HARMONIC = 2
# directions around a cavity's axis at which its outline is kept, even along a square about it, as a place on that takes
# no arctangent; between them linear to 1e-5
TABLE = 2048


@dataclass(frozen=True, eq=False)
class Cavities:
    """All cells of a bore, n of them, float64 but for the table, the last a cavity nothing is in.

    ``centre`` (n, 3): of the widest part, mm; ``axes`` (n, 3, 3): rows u, v and w, unit vectors over
    semi-axes; ``offset`` (n, 3): the centre in them; ``outward`` (n, 3): radial direction where the axis
    meets the wall; ``reach``: radius of a ball about the centre that holds the cavity from where it leaves the
    bore; ``inverse`` float32 (n·(TABLE + 1) + 1,): 1/outline in all directions; ``steepest``: Lipschitz factor of s
    that the outline causes; ``power``; ``closed``: 0 for a shaft, open towards the bore, and 1 otherwise;
    ``across``, ``along``: semi-axes, mm; ``edge``, ``bulge``; ``dust``, ``fluid``: depth of its surface along the
    axis, ∞ without.
    """

    centre: Numbers
    axes: Numbers
    offset: Numbers
    outward: Numbers
    reach: Numbers
    inverse: Numbers
    steepest: Numbers
    power: Numbers
    closed: Numbers
    across: Numbers
    along: Numbers
    edge: Numbers
    bulge: Numbers
    dust: Numbers
    fluid: Numbers

    def __len__(self) -> int:
        return int(self.centre.shape[0])


def cavities(cells: Sequence[Cell], radius_mm: float) -> Cavities:
    """Return the cavities of ``cells`` in a bore of that nominal radius."""
    frames = [frame(cell, radius_mm) for cell in cells]
    nothing = (np.full(3, 1e6), np.eye(3), np.eye(3)[0])
    centre, axes, outward = (np.stack(parts) for parts in zip(*frames, nothing, strict=True))
    place = 4 / TABLE * np.arange(TABLE + 1) - 1
    y = np.where(place > 1, 2 - place, place)
    angle = np.arctan2(y, np.where(place > 1, -1, 1) * (1 - np.abs(y)))
    inverse = np.stack([1 / _outline(cell, angle) for cell in cells] + [np.ones(TABLE + 1)])
    slope = np.diff(inverse, axis=1) / np.diff(np.unwrap(angle))
    slope = np.append(slope, slope[:, :1], axis=1)
    # a chord's slope and the curve's differ by half a step's change
    steepest = 1.01 * np.sqrt((inverse**2 + slope**2).max(axis=1))
    along = np.array([cell.depth_mm - cell.bulge_mm for cell in cells] + [1.0])
    across = np.array([cell.diameter_mm / 2 for cell in cells] + [1.0])
    longest = across / np.sqrt(np.array([cell.aspect for cell in cells] + [1.0])) / inverse.min(axis=1)
    closed = np.array([float(cell.bulge_mm > 0) for cell in cells] + [1.0])
    below = np.array([sag(cell, radius_mm, half) for cell, half in zip(cells, longest[:-1], strict=True)] + [0.0])
    dust = [cell.fill_mm if cell.filling == "dust" else math.inf for cell in cells] + [math.inf]
    fluid = [cell.fill_mm if cell.filling == "fluid" else math.inf for cell in cells] + [math.inf]

    def array(values: object) -> Numbers:
        return np.asarray(values, dtype=np.float64)

    return Cavities(
        centre=array(centre),
        axes=array(axes),
        offset=array(np.einsum("nij,nj->ni", axes, centre)),
        outward=array(outward),
        reach=array(np.hypot(longest, np.maximum(along, (1 - closed) * below))),
        inverse=np.append(inverse, 1.0).astype(np.float32),
        steepest=array(steepest),
        power=array([cell.squareness for cell in cells] + [2.0]),
        closed=array(closed),
        across=array(across),
        along=array(along),
        edge=array([cell.edge_mm for cell in cells] + [0.005]),
        bulge=array([cell.bulge_mm for cell in cells] + [0.0]),
        dust=array(dust),
        fluid=array(fluid),
    )


def frame(cell: Cell, radius_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the cavity's centre (3,), its rows u, v, w over the semi-axes (3, 3), and the radial direction (3,)."""
    cos, sin = math.cos(cell.theta_rad), math.sin(cell.theta_rad)
    outward, around, inward = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0]), np.array([0.0, 0.0, 1.0])
    leans = math.cos(cell.lean_direction_rad) * inward + math.sin(cell.lean_direction_rad) * around
    w = math.cos(cell.lean_rad) * outward + math.sin(cell.lean_rad) * leans
    u = math.cos(cell.tilt_rad) * inward + math.sin(cell.tilt_rad) * around
    u = u - (u @ w) * w
    u /= math.sqrt(u @ u)
    v = np.array([u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]])
    half = cell.diameter_mm / 2
    semi = half / math.sqrt(cell.aspect), half * math.sqrt(cell.aspect), cell.depth_mm - cell.bulge_mm
    centre = radius_mm * outward + cell.z_mm * inward + cell.bulge_mm * w
    return centre, np.stack([u / semi[0], v / semi[1], w / semi[2]]), outward


def sag(cell: Cell, radius_mm: float, half_mm: float) -> float:
    """Return how far along its axis, from the nominal wall towards the bore, a cell's side can still meet the wall.

    ``half_mm``: its largest half width. The wall curves away from the plane across the axis, and that plane leans.
    """
    aside = min(half_mm / math.cos(cell.lean_rad), 0.99 * radius_mm)
    sagitta = radius_mm - math.sqrt(radius_mm**2 - aside**2)
    return (sagitta + half_mm * math.sin(cell.lean_rad)) / math.cos(cell.lean_rad) + 0.05


def _outline(cell: Cell, angle: np.ndarray) -> np.ndarray:
    outline = np.ones_like(angle)
    for k, (cos, sin) in enumerate(cell.outline, FIRST_HARMONIC):
        outline += cos * np.cos(k * angle) + sin * np.sin(k * angle)
    return outline
