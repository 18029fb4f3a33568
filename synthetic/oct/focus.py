"""The beam of the OCT as Gaussian optics has it: narrowest at its focus, wider and weaker away from it.

The spot, which light passes twice, has the full width at half maximum ``lateral_resolution_mm`` at the focus; so the
beam's own waist is w₀ = that/√ln 2, and its Rayleigh length π·w₀²/λ. All depends on the optical path.
"""

import math

from endoct.base.arrays import Coordinates
from endoct.synthetic.sample.parameters import Oct

FWHM = 2 * math.sqrt(2 * math.log(2))  # of a Gaussian, in sigmas


def rayleigh_mm(oct_: Oct) -> float:
    """Return the way from the focus on which the beam widens by √2."""
    return math.pi * oct_.lateral_resolution_mm**2 / math.log(2) / oct_.wavelength_mm


def widening(oct_: Oct, path_mm: Coordinates) -> Coordinates:
    """Return how much wider the beam is at ``path_mm`` than at its focus."""
    wider: Coordinates = 1 + ((path_mm - oct_.focus_mm) / rayleigh_mm(oct_)) ** 2
    return wider**0.5


def spot_sigma_mm(oct_: Oct, path_mm: Coordinates) -> Coordinates:
    """Return the standard deviation of the field that scatterers are weighted with: √2 of that of its square."""
    sigma: Coordinates = math.sqrt(2) * oct_.lateral_resolution_mm / FWHM * widening(oct_, path_mm)
    return sigma


def coupling(oct_: Oct, path_mm: Coordinates) -> Coordinates:
    """Return the share of the intensity that finds its way back from a diffuse wall at ``path_mm``, 1 from the focus.

    All of the light falls on the wall wherever that is. What comes back into the fibre falls off as the beam's own
    intensity on its axis, but with an apparent Rayleigh length: twice the beam's by van Leeuwen et al. (2003).
    """
    apart = (path_mm - oct_.focus_mm) / (oct_.diffuse_rayleigh * rayleigh_mm(oct_))
    share: Coordinates = 1 / (1 + apart**2)
    return share
