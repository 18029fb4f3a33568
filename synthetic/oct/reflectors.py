"""Everything thin that the beam meets: the capillary's faces, the sheath, glints, the surface of a fluid.

Each lies at its exact path, and returns light of a level in dB.
"""

import numpy as np
from numpy.random import Generator

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.oct.sweep import Sweep
from endoct.synthetic.oct.turn import around

FLARE_RAD = 0.01  # incidence within which a face flares
FLUID_DB = -2.4  # Fresnel: 2 % of a fluid's surface against 3.5 % of glass
NO_GLINT_DB = -20.0


def reflectors(sweep: Sweep, rng: Generator) -> tuple[list[Coordinates], list[Coordinates]]:
    """Return optical path, mm, and level in dB, before roll-off, of everything thin; each a value a column."""
    oct_, echoes, turn = sweep.oct_, sweep.echoes, sweep.turn
    light_db = -echoes.shadow_db

    def glossy(incidence_rad: Coordinates) -> Coordinates:
        return np.maximum(-8.7 * (incidence_rad / oct_.glint_rad) ** 2, oct_.matt_db)

    flares = rng.random() < oct_.flare_share
    flaring, side = int(rng.integers(2)), rng.choice([-1, 1])
    paths, levels = [], []
    for face, (path, incidence, level) in enumerate(
        (
            (echoes.inner_path_mm, echoes.inner_incidence_rad, oct_.inner_face_db),
            (echoes.outer_path_mm, echoes.outer_incidence_rad, oct_.outer_face_db),
        )
    ):
        level_db = level + glossy(incidence) + 2.0 * around(rng, turn, 0.05)
        if flares and face == flaring:
            # square on the near or on the far side of an off-axis catheter
            there = side * (path - np.median(path)) > 0
            level_db = level_db + there * oct_.flare_db * np.exp(-((incidence / FLARE_RAD) ** 2))
        paths.append(path)
        levels.append(level_db)
    for sheath in oct_.sheath:
        paths.append(sheath.radius_mm + sheath.wobble_mm * np.sin(echoes.alpha_rad + sheath.phase_rad))
        levels.append(sheath.level_db + 1.5 * around(rng, turn, 0.08))
    paths.append(np.zeros(turn.n))
    levels.append(oct_.catheter_face_db + 1.0 * around(rng, turn, 0.08))

    paths.append(echoes.wall_path_mm)
    levels.append(np.where(sweep.glint_db > NO_GLINT_DB, sweep.glint_db + light_db, -np.inf))
    if np.any(np.isfinite(echoes.fluid_path_mm)):
        paths.append(echoes.fluid_path_mm)
        levels.append(oct_.outer_face_db + FLUID_DB + glossy(np.arccos(echoes.fluid_cosine)) + light_db)
    return paths, levels
