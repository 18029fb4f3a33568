"""A small pullback drawn by hand, unlike the simulator's: no tracing, square pits, plain speckle."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.manifest import OctAcquisition

CAPILLARY_MM = 0.8
BORE_MM = 1.2
PIXEL_MM = 0.006
GLASS_MM = 0.2
GLASS_INDEX = 1.46
GLASS_DELAY_MM = (GLASS_INDEX - 1) * GLASS_MM


@dataclass(frozen=True)
class Phantom:
    """Angles are the catheter's own: A-scan k of n looks to 2πk/n. Pits: (centre rad, width rad, depth mm)."""

    n_slices: int = 6
    n_ascans: int = 720
    n_depth: int = 340
    offset_mm: float = 0.15
    direction_rad: float = 1.0
    turning_rad: float = 0.1  # of the direction, a slice
    pits: tuple[tuple[float, float, float], ...] = ((2.0, 0.5, 0.25), (6.2, 0.4, 0.25))
    wall_db: float = 19.0
    step_rad: float = 0.0  # by which every turn jumps ahead, halfway
    seed: int = 0
    sidecar: Mapping[str, Any] = field(default_factory=dict)

    def direction_of(self, index: int) -> float:
        """Direction of the catheter's offset in one slice."""
        return self.direction_rad + self.turning_rad * index

    def power(self) -> NDArray[np.float32]:
        """Linear power (slice, depth, A-scan); the noise has a mean of 1."""
        return np.stack([self._slice(i) for i in range(self.n_slices)])

    def log_counts(self) -> NDArray[np.uint8]:
        """The same in u8, 0.3 dB a count."""
        return np.clip(60 + 10 * np.log10(self.power()) / 0.3, 0, 255).astype(np.uint8)

    def acquisition(self) -> OctAcquisition:
        """The sidecar."""
        keys: dict[str, Any] = {
            "modality": "oct",
            "axial_pixel_mm": PIXEL_MM,
            "pullback_pitch_mm": 0.2,
            "bore_diameter_mm": 2 * BORE_MM,
            "capillary_outer_diameter_mm": 2 * CAPILLARY_MM,
            "travel": "in",
            "handedness": "same",
        }
        return OctAcquisition(**(keys | dict(self.sidecar)))

    def _bend(self, from_offset: NDArray[np.float64]) -> NDArray[np.float64]:
        """Snell's law at the inner and at the outer face: by how much a beam leaves turned towards the offset."""
        into = np.arcsin(self.offset_mm * np.sin(from_offset) / (CAPILLARY_MM - GLASS_MM))
        within = np.arcsin(np.sin(into) / GLASS_INDEX)
        onto = np.arcsin((CAPILLARY_MM - GLASS_MM) * np.sin(within) / CAPILLARY_MM)
        out = np.arcsin(GLASS_INDEX * np.sin(onto))
        return np.asarray((into - within) - (out - onto))

    def _slice(self, index: int) -> NDArray[np.float32]:
        rng = np.random.default_rng((self.seed, index))
        angle = 2 * np.pi * np.arange(self.n_ascans) / self.n_ascans
        angle += self.step_rad * (angle >= np.pi)
        beta = self.direction_of(index)
        x, y = self.offset_mm * np.cos(beta), self.offset_mm * np.sin(beta)
        depth = PIXEL_MM * np.arange(self.n_depth)[:, None]

        def reach(radius: float) -> NDArray[np.float64]:
            across = self.offset_mm * np.sin(angle - beta)
            return np.sqrt(radius**2 - across**2) - self.offset_mm * np.cos(angle - beta)

        def line(path: NDArray[np.float64], power_db: float) -> NDArray[np.float64]:
            return 10 ** (power_db / 10) * np.exp(-(((depth - path) / 0.007) ** 2))

        rho = depth - GLASS_DELAY_MM  # beyond the glass
        place_x, place_y = x + rho * np.cos(angle), y + rho * np.sin(angle)
        radius, theta = np.hypot(place_x, place_y), np.arctan2(place_y, place_x) - self._bend(angle - beta)
        surface = np.full(radius.shape, BORE_MM)
        for centre, width, deep in self.pits:
            near = np.abs(np.angle(np.exp(1j * (theta - centre)))) < width / 2
            surface[near] = BORE_MM + deep
        bone = np.maximum.accumulate((radius > surface) & (rho > reach(CAPILLARY_MM)), axis=0)
        below = np.cumsum(bone, axis=0) * PIXEL_MM
        mean = 1 + np.where(bone, 10 ** (self.wall_db / 10) * np.exp(-below / 0.15), 0)
        speckled = mean * rng.exponential(1, mean.shape)
        lines = (
            line(np.full(self.n_ascans, 0.3) + 0.02 * np.sin(angle), 30)
            + line(reach(CAPILLARY_MM - GLASS_MM), 30)
            + line(reach(CAPILLARY_MM) + GLASS_DELAY_MM, 32)
            + line(np.full(self.n_ascans, 1.0), 12)
        )
        return (speckled + lines).astype(np.float32)
