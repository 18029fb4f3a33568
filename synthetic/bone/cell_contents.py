"""What is in the cells of a bone: their lining, and what fills them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.field import Field
from endoct.synthetic.sample.parameters import Cell, Sample
from endoct.synthetic.sample.randomness import Stage, generator

CELLS_STREAM = 100  # of the wall's generators, beyond those of its textures


@dataclass(frozen=True, eq=False)
class Contents:
    """One value a cell, the first for no cell, (n + 1,).

    ``lining``: albedo of the inside over that of bone; ``rim_gain``: light added on its rim; ``filling``: what is in
    it; ``down`` float64 (n + 1, 3): unit vector across the surface of its fluid, into the fluid; 0 for no cell.
    """

    lining: Image
    rim_gain: Image
    filling: tuple[str, ...]
    down: Coordinates


def contents_of_planted(cells: Sequence[Cell]) -> Contents:
    """Return the contents of cells that were planted on the wall: their fluid lies across their axis."""
    down = np.zeros((len(cells) + 1, 3))
    for number, cell in enumerate(cells, 1):
        radial = np.array([np.cos(cell.theta_rad), np.sin(cell.theta_rad), 0.0])
        around = np.array([-radial[1], radial[0], 0.0])
        sideways = np.sin(cell.lean_direction_rad) * around + np.array([0, 0, np.cos(cell.lean_direction_rad)])
        down[number] = np.cos(cell.lean_rad) * radial + np.sin(cell.lean_rad) * sideways
    return Contents(
        lining=np.array([1.0] + [cell.lining for cell in cells], np.float32),
        rim_gain=np.array([0.0] + [cell.rim_gain for cell in cells], np.float32),
        filling=("air", *(cell.filling for cell in cells)),
        down=down,
    )


def contents_of_field(sample: Sample, field: Field) -> Contents:
    """Return the contents of the cells of three-dimensional bone; those of one number look alike in every recording."""
    n = len(field.level_mm) - 1
    rng = generator(sample.bore_seed, Stage.WALL, CELLS_STREAM)
    lined, bright, albedo, gain = rng.random((4, n))
    lined = lined < sample.bore.lining
    lining = np.where(lined, 0.92 + 0.08 * albedo, 0.55 + 0.37 * albedo)
    rim = np.where((bright < 0.2) & ~lined, 0.2 + 0.6 * gain, 0)
    filling = np.where(np.isfinite(field.dust_mm), "dust", np.where(np.isfinite(field.level_mm), "fluid", "air"))
    down = np.tile(field.down, (n + 1, 1))
    down[0] = 0
    return Contents(
        lining=np.append(1.0, lining).astype(np.float32),
        rim_gain=np.append(0.0, rim).astype(np.float32),
        filling=tuple(str(word) for word in filling),
        down=down,
    )
