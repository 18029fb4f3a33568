"""A tube for tests, of round numbers."""

from endoct.modalities.tube.target import Target

TUBE = Target(
    bore_diameter_mm=2.5,
    outer_diameter_mm=6.0,
    length_mm=12.0,
    groove_width_mm=0.35,
    helix_width_mm=0.5,
    groove_depth_mm=0.3,
    helix_theta_rad=1.5,
    helix_lead_mm=7.0,
    ring_z_mm=(3.5, 7.0),
    ring_width_mm=(0.6, 1.8),
    ring_depth_mm=0.4,
)
