"""The relief and the ink of a printed tube to calibrate by."""

import math

import numpy as np

from endoct.base.arrays import Image
from endoct.synthetic.sample.parameters import Tube

BRIM_MM = 0.01
"""Of depth, over which the ink begins."""


def tube_relief(tube: Tube, radius_mm: float, z_mm: Image, theta_rad: Image) -> tuple[Image, Image]:
    """Return how much farther from the axis than its bore the tube is, and the share of ink, at z (n, 1) and θ (m,).

    Both are float32 (n, m). Rings and grooves add up, grooves do not; edges are rounded.
    """
    z = z_mm / np.float32(tube.stretch)
    rings = sum(
        _within(np.abs(z - np.float32(middle)) - np.float32(width / 2), tube.edge_mm)
        for middle, width in ((tube.narrow_z_mm, tube.narrow_width_mm), (tube.wide_z_mm, tube.wide_width_mm))
    )
    helix = np.float32(2 * math.pi / tube.helix_lead_mm) * z + np.float32(tube.helix_theta_rad)
    grooves = np.maximum(
        _within(np.abs(_across(theta_rad, radius_mm)) - np.float32(tube.groove_width_mm / 2), tube.edge_mm),
        _within(np.abs(_across(theta_rad - helix, radius_mm)) - np.float32(tube.helix_width_mm / 2), tube.edge_mm),
    )
    depth_error_mm = tube.depth_error * tube.sigma_depth_mm
    relief = (tube.ring_depth_mm + depth_error_mm) * rings + (tube.groove_depth_mm + depth_error_mm) * grooves
    relief += tube.bore_error * tube.sigma_bore_mm / 2
    below_brim = tube.groove_depth_mm * grooves - np.float32(tube.brim_mm)
    return np.asarray(relief, np.float32), np.asarray(np.clip(below_brim / BRIM_MM, 0, 1), np.float32)


def _across(theta_rad: Image, radius_mm: float) -> Image:
    """Return the way along the circumference from θ = 0, mm."""
    turned = np.mod(theta_rad + np.float32(math.pi), np.float32(2 * math.pi)) - np.float32(math.pi)
    return np.asarray(np.float32(radius_mm) * turned, np.float32)


def _within(beyond_mm: Image, edge_mm: float) -> Image:
    """Return 1 well inside an outline, 0 well outside."""
    return np.asarray(0.5 - 0.5 * np.tanh(beyond_mm * np.float32(2 / edge_mm)), np.float32)
