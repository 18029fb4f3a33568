"""Where a panorama lies in the bore's frame, and how one panorama lies in another."""

from dataclasses import dataclass

import numpy as np

from benchmarks.independent.bore import Floats
from benchmarks.independent.catheter import Pullback
from benchmarks.independent.mirror import Journey
from benchmarks.independent.recipe import CatheterRecipe, MirrorRecipe


@dataclass(frozen=True)
class Place:
    """Maps a panorama into the bore's frame: θ_bore = θ₀ ± θ, z_bore = z₀ + scale·(±z)."""

    theta_rad: float
    z_mm: float
    scale: float = 1.0
    mirrored: bool = False
    reversed: bool = False

    def to_bore(self, theta_rad: Floats, z_mm: Floats) -> tuple[Floats, Floats]:
        """Return (θ, z) in the bore's frame."""
        theta = self.theta_rad + (-1 if self.mirrored else 1) * np.asarray(theta_rad)
        return theta, np.asarray(self.z_mm + (-self.scale if self.reversed else self.scale) * np.asarray(z_mm))

    def from_bore(self, theta_rad: Floats, z_mm: Floats) -> tuple[Floats, Floats]:
        """Return (θ, z) in the panorama's frame."""
        theta = (-1 if self.mirrored else 1) * (np.asarray(theta_rad) - self.theta_rad)
        return theta, np.asarray((np.asarray(z_mm) - self.z_mm) / (-self.scale if self.reversed else self.scale))


def between(a: Place, b: Place) -> Place:
    """Return where panorama B lies in panorama A's frame, in the same terms."""
    sense = -1 if a.mirrored else 1
    direction = -1 if a.reversed else 1
    return Place(
        theta_rad=float(np.mod(sense * (b.theta_rad - a.theta_rad), 2 * np.pi)),
        z_mm=direction * (b.z_mm - a.z_mm) / a.scale,
        scale=b.scale / a.scale,
        mirrored=a.mirrored != b.mirrored,
        reversed=a.reversed != b.reversed,
    )


def oct_place(recipe: CatheterRecipe, pullback: Pullback) -> Place:
    """Return where the pullback's panorama lies: θ counts A-scans, z from the slice nearest the mouth.

    A sidecar that states the handedness turns θ round; one with a wrong pitch stretches z. Where the fault lies
    within the recording there is no one place, and this is that of its sound part nearest the mouth.
    """
    stated = recipe.fault_size if recipe.fault == "pitch" else 1.0
    return Place(
        theta_rad=recipe.start_rad,
        z_mm=float(pullback.z_mm.min()),
        scale=1 / stated,
        mirrored=recipe.mirrored and not recipe.states_handedness,
    )


def endoscope_place(recipe: MirrorRecipe, journey: Journey) -> Place:
    """Return where the endoscope's panorama lies: z from the middle of the band of the frame nearest the mouth."""
    low, high = journey.optics.band_mm
    middle = (low + high) / 2 * (1 if recipe.ahead else -1)
    return Place(theta_rad=recipe.start_rad, z_mm=float(journey.apex_mm.min() + middle))
