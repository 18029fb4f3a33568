"""A small CT drawn at random: air, bone and one bright voxel, whose place follows from the geometry by hand."""

from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

MARK_HU = 3000


@dataclass(frozen=True, eq=False)
class Drawn:
    """Voxels (k, j, i) int16; ``row`` and ``column``: where i and j count up, LPS; slices are ``between`` mm apart.

    ``spacing``: between rows, between columns; ``mark``: the index (k, j, i) of the bright voxel. ``aside``: by how
    much a slice lies farther along ``column`` than the one before, as a tilted gantry has it.
    """

    voxels: NDArray[np.int16]
    origin: NDArray[np.float64]
    row: NDArray[np.float64]
    column: NDArray[np.float64]
    between: float
    spacing: tuple[float, float]
    mark: tuple[int, int, int]
    aside: float = 0.0

    @property
    def normal(self) -> NDArray[np.float64]:
        return np.asarray(np.cross(self.row, self.column))

    def position(self, k: float) -> NDArray[np.float64]:
        """Return the middle of the first voxel of a slice."""
        return np.asarray(self.origin + k * (self.between * self.normal + self.aside * self.column))

    def place(self, k: float, j: float, i: float) -> NDArray[np.float64]:
        """Return the middle of a voxel, LPS."""
        return np.asarray(self.position(k) + j * self.spacing[0] * self.column + i * self.spacing[1] * self.row)

    @property
    def marked(self) -> NDArray[np.float64]:
        """The place of the bright voxel, LPS."""
        return self.place(*self.mark)

    @property
    def to_lps(self) -> NDArray[np.float64]:
        """The matrix (4, 4) of (i, j, k) to LPS."""
        matrix = np.eye(4)
        matrix[:3, 0] = self.row * self.spacing[1]
        matrix[:3, 1] = self.column * self.spacing[0]
        matrix[:3, 2] = self.normal * self.between
        matrix[:3, 3] = self.origin
        return matrix


def drawn(rng: Random) -> Drawn:
    """Return a volume: in the axes of the patient or turned, of 5 to 12 slices."""
    shape = rng.randint(5, 12), rng.randint(9, 16), rng.randint(9, 16)
    noise = np.random.default_rng(rng.randrange(2**32))
    bone = noise.random(shape) < 0.5
    values = np.where(bone, noise.gamma(4, 250, shape) + 300, noise.normal(-1000, 20, shape))
    mark = tuple(rng.randint(1, n - 2) for n in shape)
    voxels = np.clip(np.rint(values), -1024, 2800).astype(np.int16)
    voxels[mark] = MARK_HU
    kind = rng.random()
    if kind < 0.5:
        turn = np.eye(3)
    elif kind < 0.75:
        turn = Rotation.from_euler("xyz", [rng.choice((0, 90, 180, 270)) for _ in range(3)], degrees=True).as_matrix()
    else:
        turn = Rotation.from_euler("xyz", [rng.uniform(-40, 40) for _ in range(3)], degrees=True).as_matrix()
    turn = np.round(turn, 12)
    row_mm, column_mm = rng.choice(((0.3, 0.3), (0.488281, 0.488281), (0.4, 0.35)))
    return Drawn(
        voxels=voxels,
        origin=np.round([rng.uniform(-120, 120) for _ in range(3)], 3),
        row=turn[:, 0],
        column=turn[:, 1],
        between=rng.choice((0.3, 0.5, 0.625, 1.25)),
        spacing=(row_mm, column_mm),
        mark=(mark[0], mark[1], mark[2]),
    )


def named_slices(volume: Drawn) -> list[dict[str, Any]]:
    """Return the slices of a volume as elements of DICOM by keyword, with their stored ``values``."""
    return [
        {
            "name": f"IM{k:04d}.dcm",
            "values": volume.voxels[k],
            "ImagePositionPatient": [float(f"{x:.8g}") for x in volume.position(k)],
            "ImageOrientationPatient": [float(f"{x:.8f}") for x in (*volume.row, *volume.column)],
            "PixelSpacing": list(volume.spacing),
            "InstanceNumber": k + 1,
            "SliceThickness": volume.between,
            "RescaleSlope": 1,
            "RescaleIntercept": 0,
        }
        for k in range(len(volume.voxels))
    ]
