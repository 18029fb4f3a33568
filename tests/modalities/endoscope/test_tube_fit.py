"""A mirror's optics from marks that closed forms place on a tube, in noise, for cones of several makes."""

import numpy as np
import pytest
from printed_tube import TUBE
from tolerances import TUBE_LENGTH_REL, TUBE_SLANT_DEG

from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone
from endoct.modalities.endoscope.tube_fit import TubeModel, optics_of
from endoct.modalities.endoscope.tube_marks import AXIAL, HELICAL, Marks

RIMS = 55.0, 175.0
NOISE_MM = 0.003
FRAMES = np.linspace(1.5, 9.0, 24)
FLUSH = TUBE.model_copy(update={"ink_depth_mm": 0.0})


def marks(optics: ConeOptics, rng: np.random.Generator) -> Marks:
    """Where both grooves cross circles in frames that roll a little, by z(r) of a probe on the axis.

    In a ring the same ray goes on to its floor, by the slant of the view.
    """
    r_px = np.linspace(RIMS[0] + 2, RIMS[1] - 2, 40)
    parts = []
    for k, z_frame in enumerate(FRAMES):
        roll = 6.1 + 0.05 * np.sin(k)
        at_bore = z_frame + optics.z_mm(r_px)
        at_floor = at_bore + TUBE.ring_depth_mm * optics.slant(r_px)
        in_ring = TUBE.ring_inside_mm(at_floor) > 0.1
        usable = in_ring | (TUBE.ring_inside_mm(at_bore) < -0.1)
        z_mm = np.where(in_ring, at_floor, at_bore)
        for line, theta in ((AXIAL, np.zeros_like(z_mm)), (HELICAL, TUBE.helix_rad(z_mm))):
            angle = theta - roll + NOISE_MM / TUBE.radius_mm * rng.standard_normal(z_mm.size)
            parts.append(
                [
                    values[usable]
                    for values in (np.full(z_mm.size, k), r_px, angle, np.full(z_mm.size, line), in_ring, z_mm)
                ]
            )
    frame, r, angle, line, in_ring, z = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Marks(frame.astype(np.intp), r, angle, line.astype(np.intp), in_ring.astype(bool), z)


@pytest.mark.parametrize(("half_angle_deg", "distance_mm"), [(45.0, 1.6), (40.0, 1.2), (50.0, 3.0)])
def test_length_and_slant_come_back(half_angle_deg: float, distance_mm: float) -> None:
    true = ConeOptics(*RIMS, np.deg2rad(half_angle_deg), 640.0, distance_mm, TUBE.radius_mm)
    model = TubeModel(marks(true, np.random.default_rng(11)), FLUSH, 1, 1, RIMS)
    fit = model.fit(model.start(assumed_cone(*RIMS, 1.1 * true.visible_length_mm, TUBE.radius_mm), 1.0))
    found = optics_of(model, fit.values)
    assert found.visible_length_mm == pytest.approx(true.visible_length_mm, rel=TUBE_LENGTH_REL)
    r_px = np.linspace(*RIMS, 5)
    slants = [np.rad2deg(np.arctan(of.slant(r_px))) for of in (found, true)]
    np.testing.assert_allclose(*slants, atol=TUBE_SLANT_DEG)
    frames, apex_mm, roll = model.frames(fit.values)
    assert frames.size == FRAMES.size
    apart = np.diff(np.unwrap(apex_mm, period=TUBE.helix_lead_mm))
    np.testing.assert_allclose(apart, np.diff(FRAMES), rtol=0.02)
    np.testing.assert_allclose(np.diff(roll), np.diff(0.05 * np.sin(np.arange(FRAMES.size))), atol=0.003)


def test_what_cannot_be_told_apart_is_said_to_be_uncertain() -> None:
    true = ConeOptics(*RIMS, np.deg2rad(45.0), 640.0, 1.6, TUBE.radius_mm)
    model = TubeModel(marks(true, np.random.default_rng(12)), TUBE, 1, 1, RIMS)
    fit = model.fit(model.start(true, 1.0))

    def derived(values: np.ndarray) -> np.ndarray:
        of = optics_of(model, values)
        return np.log([of.visible_length_mm, of.focal_px])

    length, focal = fit.sigma_of(derived)
    assert focal > 3 * length
