"""What files state against what is used: the same but for a hundredth."""

from pathlib import Path
from typing import Any

import pytest

from endoct.modalities import stated
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.reading.format import Stated
from endoct.modalities.stated import on_stated, stated_keys


def used(**keys: Any) -> EndoscopeAcquisition:
    return EndoscopeAcquisition.model_validate({"modality": "endoscope", "bore_diameter_mm": 2.5, **keys})


@pytest.mark.parametrize(
    ("keys", "states", "differs"),
    [
        ({"feed_pitch_mm": 0.2}, {"feed_pitch_mm": 0.2}, False),
        ({"feed_pitch_mm": 0.2}, {"feed_pitch_mm": 0.2019}, False),
        ({"feed_pitch_mm": 0.2}, {"feed_pitch_mm": 0.2021}, True),
        ({"feed_pitch_mm": 0.2}, {"feed_pitch_mm": 0.1979}, True),
        ({"travel": "in"}, {"travel": "out"}, True),
        ({"travel": "in"}, {"travel": "in"}, False),
        ({"feed_pitch_mm": 0.2}, {"axial_pixel_mm": 9.0}, False),  # of another modality
    ],
)
def test_a_key_that_the_files_state_otherwise_is_doubted(
    keys: dict[str, Any], states: dict[str, Any], differs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stated, "stated_by", lambda _: Stated(states, "the header"))
    doubts = on_stated(Path("x"), used(**keys)).doubts
    assert [doubt.code for doubt in doubts] == ["stated-otherwise"] * differs
    if differs:
        (key,) = states
        assert f"{key} is {keys[key]} in acquisition.toml or the settings, and" in doubts[0].what
        assert doubts[0].what.endswith("in the header.")
    assert set(stated_keys(Path("x"), EndoscopeAcquisition).keys) == set(states) - {"axial_pixel_mm"}
