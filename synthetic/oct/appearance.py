"""How brightly the bore's wall returns the light of the OCT from place to place."""

from dataclasses import dataclass

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.randomness import Stage, generator, smooth_field


@dataclass(frozen=True, eq=False)
class Appearance:
    """Maps (z, θ) of the wall; row k is z = k·``dz_mm``, the columns span a turn.

    ``wall_db``: its scattering against the mean, dB. ``glint_db``: level of specular spots, dB, −60 elsewhere.
    """

    dz_mm: float
    wall_db: Image
    glint_db: Image

    def at(self, image: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
        """Return one of the maps at scattered places (1-D arrays of one length), bilinear, cyclic in θ."""
        rows = np.clip(z_mm / self.dz_mm, 0, image.shape[0] - 1).astype(np.float32)
        columns = (np.mod(theta_rad, 2 * np.pi) / (2 * np.pi) * image.shape[1]).astype(np.float32)
        values = cv2.remap(image, columns[None], rows[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(values[0], dtype=np.float64)


def build_appearance(sample: Sample, wall: Wall, coarser: int = 4) -> Appearance:
    """Return the wall's patches and its specular spots, on the wall's grid made ``coarser`` times coarser."""
    oct_, seed = sample.oct, sample.bore_seed
    n_z, n_theta = (-(-n // coarser) for n in wall.relief_mm.shape)
    dz_mm, dtheta_mm = wall.dz_mm * coarser, 2 * np.pi / n_theta * wall.radius_mm
    wall_db = oct_.patchiness_db * smooth_field(
        generator(seed, Stage.PATCHES, 0), (n_z, n_theta), 0.35 / dz_mm, 0.35 / dtheta_mm
    )
    wall_db += (
        0.5
        * oct_.patchiness_db
        * smooth_field(generator(seed, Stage.PATCHES, 1), (n_z, n_theta), 0.06 / dz_mm, 0.06 / dtheta_mm)
    )
    glint_db = np.full((n_z, n_theta), -60, np.float32)
    z, theta, brighter = generator(seed, Stage.GLINTS).random((oct_.n_glints, 3)).T
    glint_db[(z * n_z).astype(np.intp), (theta * n_theta).astype(np.intp)] = oct_.wall_db + 4 + 12 * brighter
    return Appearance(dz_mm, wall_db, np.asarray(cv2.dilate(glint_db, np.ones((2, 3))), np.float32))
