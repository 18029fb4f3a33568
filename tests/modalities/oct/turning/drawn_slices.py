"""Slices drawn by formula: lines as a catheter sees them whose turns are uneven and start anywhere."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition

RADIUS_MM = 0.85
AXIS_MM = 0.3
SHEATHS_MM = ((-0.4, 0.02, 0.7), (-0.3, 0.022, 2.9), (-0.2, 0.018, 5.0))  # depth of the axis, wobble, its direction
N_COLUMNS = 256
NOMINAL = 2 * np.pi * (np.arange(N_COLUMNS) + 0.5) / N_COLUMNS
N_NOISE, PIXEL_MM, BORE_MM = 96, 0.005, 1.25
ACQUISITION = OctAcquisition(
    modality="oct",
    axial_pixel_mm=PIXEL_MM,
    pullback_pitch_mm=0.2,
    bore_diameter_mm=2 * BORE_MM,
    capillary_outer_diameter_mm=2 * RADIUS_MM,
)
Array = NDArray[np.float64]


def depth_of_circle(alpha: Array, x: float, y: float) -> Array:
    """Where beams from (x, y) meet a circle about 0, by the quadratic's formula."""
    along = x * np.cos(alpha) + y * np.sin(alpha)
    return np.asarray(-along + np.sqrt(along**2 - (x * x + y * y - RADIUS_MM**2)))


def drawn_slice(error: Array, start: float, offset: complex, seed: int, *, sheaths: int = 3) -> SliceFeatures:
    """A slice whose beams look to NOMINAL + error in its frame, which begins at ``start``; a µm of noise."""
    rng = np.random.default_rng(seed)
    alpha, seen = NOMINAL + error, offset * np.exp(-1j * start)
    depths = [AXIS_MM + depth_of_circle(alpha, seen.real, seen.imag)]
    lines = [Circle(seen.real, seen.imag, AXIS_MM, RADIUS_MM)]
    for depth, wobble, direction in SHEATHS_MM[:sheaths]:
        mark = wobble * np.exp(1j * (direction - start))
        depths.append(depth + depth_of_circle(alpha, mark.real, mark.imag))
        lines.append(Circle(mark.real, mark.imag, depth, RADIUS_MM))
    every = np.concatenate(depths) + 0.001 * rng.normal(size=N_COLUMNS * len(depths))
    return SliceFeatures(
        points=Points(np.tile(NOMINAL, len(depths)), every, np.ones(every.size)),
        n_columns=N_COLUMNS,
        lines=Lines(**vars(Capillary.of(lines, RADIUS_MM)), support=np.ones(len(lines))),
        ascans=np.zeros((4, 600), np.float32),
        ascan_angle_rad=NOMINAL[::64],
    )


def noisy_slice(power: Array, offset: complex, seed: int) -> SliceFeatures:
    """A slice of even turns whose A-scans, :data:`N_NOISE` of them, are of this ``power`` (A-scan, depth)."""
    return replace(
        drawn_slice(np.zeros(N_COLUMNS), 0.0, offset, seed),
        ascans=(10 * np.log10(power)).astype(np.float32),
        ascan_angle_rad=NOMINAL[:: N_COLUMNS // N_NOISE][:N_NOISE],
    )


def faces_of(slices: Sequence[SliceFeatures]) -> Faces:
    """The faces as a first fit, with even turns, would have them: near enough."""
    n = len(slices)
    return Faces(
        capillary=Capillary.of([each.lines.circle(0) for each in slices], RADIUS_MM),
        bridged=np.zeros(n, bool),
        inlier_fraction=np.ones(n),
        residual_mm=np.zeros(n),
        ripple_mm=np.zeros((n, 10)),
    )
