"""What a sidecar's scale along the bore rests on."""

from typing import Any

import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.stitching.panorama import AxialScale

OCT = {
    "modality": "oct", "bore_diameter_mm": 2.5, "axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2,
    "capillary_outer_diameter_mm": 1.7,
}  # fmt: skip
OPTICS = {"cone_half_angle_deg": 45.0, "focal_px": 500.0, "mirror_distance_mm": 5.0}


@pytest.mark.parametrize(
    ("keys", "stated", "checked"),
    [
        ({"feed_pitch_mm": 0.3}, {"feed_pitch_mm": 0.3}, False),
        ({"feed_speed_mm_s": 3.0, "frame_rate_hz": 10.0}, {"feed_speed_mm_s": 3.0}, False),
        ({"visible_length_mm": 1.0}, {"visible_length_mm": 1.0}, False),
        ({"visible_length_mm": 1.0, "feed_pitch_mm": 0.3}, {"visible_length_mm": 1.0}, True),
        (OPTICS, {}, False),
        ({**OPTICS, "visible_length_mm": 1.0, "feed_pitch_mm": 0.3}, {}, True),
        ({"positions_mm": (0.0, 0.3)}, {}, False),
        ({"positions_mm": (0.0, 0.3), "visible_length_mm": 1.0}, {"visible_length_mm": 1.0}, True),
    ],
)
def test_an_endoscope_by_its_optics_or_length_and_then_by_its_feed(
    keys: dict[str, Any], stated: dict[str, float], checked: bool
) -> None:
    scale = EndoscopeAcquisition.model_validate({"bore_diameter_mm": 2.5, **keys}).axial_scale
    assert (dict(scale.stated), scale.checked) == (stated, checked)


def test_a_pullback_by_its_pitch_unless_positions_beat_it() -> None:
    assert OctAcquisition.model_validate(OCT).axial_scale == AxialScale({"pullback_pitch_mm": 0.2})
    assert OctAcquisition.model_validate({**OCT, "positions_mm": (0.0, 0.2)}).axial_scale == AxialScale()


def test_a_calibrated_pitch_is_measured() -> None:
    stated = OctAcquisition.model_validate({**OCT, "standard_errors": {"pullback_pitch_mm": 0.001}})
    assert stated.axial_scale == AxialScale({"pullback_pitch_mm": 0.2}, checked=True)


@pytest.mark.parametrize("value", [0, -1.0, float("inf"), float("nan"), True, "0.2"])
def test_nothing_but_a_positive_number_scales(value: object) -> None:
    with pytest.raises(EndoctError, match="cannot scale"):
        AxialScale({"pitch_mm": value})  # type: ignore[dict-item]
