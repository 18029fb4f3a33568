"""The paper's sine for the depth of the capillary's outer face in a slice.

A catheter off the axis by e in the direction β sees the face as a circle
(:mod:`endoct.modalities.oct.face.face_circle`). With ω = 1, A = e and φ = −β − π/2, the sine is its first order.
"""

import numpy as np

from endoct.base.numeric.sine import Sine, ransac_sine
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.parameters import OctParameters


def slice_sine(points: Points, circle: Circle, index: int, parameters: OctParameters) -> Sine:
    """Return the sine of one slice through its ``points`` near ``circle``; fewer than four leave the start value.

    That is what ``parameters`` give, and the first order of the circle for the rest.
    """
    # by how much the circle's mean depth falls short of that of a catheter on the axis
    second_order_mm = circle.offset_mm**2 / (4 * circle.radius_mm)
    amplitude_mm, phase_rad = parameters.start_amplitude_mm, parameters.start_phase_rad
    phase_rad = -circle.direction_rad - np.pi / 2 if phase_rad is None else phase_rad
    start = Sine(
        amplitude_mm=circle.offset_mm if amplitude_mm is None else amplitude_mm,
        omega=1.0,
        phase_rad=float(np.mod(phase_rad, 2 * np.pi)),
        offset_mm=circle.axis_depth_mm + circle.radius_mm - second_order_mm,
    )
    near = points.where(np.abs(points.beyond_mm(circle)) < 2 * parameters.face_tolerance_mm)
    if len(near) < 4:
        return start
    sine, _ = ransac_sine(
        near.angle_rad,
        near.depth_mm,
        tolerance_mm=parameters.face_tolerance_mm + second_order_mm,
        trials=parameters.ransac_trials,
        rng=np.random.default_rng((parameters.seed, index)),
        start=start,
    )
    return sine
