"""Sizes in units of files as keys of a sidecar."""

import math

import pytest

from endoct.modalities.reading.physical_sizes import MM, SECONDS, Steps, in_units


@pytest.mark.parametrize(
    ("value", "unit", "mm"),
    [
        (2, "m", 2000), (2, "cm", 20), ("2", "mm", 2), (2, "µm", 0.002), (2, "μm", 0.002), (2, "um", 0.002),
        (2, "nm", 2e-6), (2, "Å", 2e-7), (2, "in", 50.8), (2, "meter", 2000), (2, "centimeter", 20),
        (2, "millimeter", 2), (2, "micrometer", 0.002), (2, "nanometer", 2e-6), (2, "angstrom", 2e-7),
        (2, "inch", 50.8), (0, "mm", None), (-1, "mm", None), (math.nan, "mm", None), (1e12, "mm", None),
        (9e11, "mm", 9e11), ("x", "mm", None), (None, "mm", None), (2, "pixel", None), (2, None, None),
        (2, ["mm"], None),
    ],
)  # fmt: skip
def test_lengths_are_in_mm(value: object, unit: object, mm: float | None) -> None:
    assert in_units(value, unit, MM) == (None if mm is None else pytest.approx(mm))


def test_times_are_in_seconds() -> None:
    names = "s", "second", "ms", "millisecond", "µs", "μs", "microsecond", "min", "minute"
    assert [in_units(3, name, SECONDS) for name in names] == pytest.approx([3, 3, *[3e-3] * 2, *[3e-6] * 3, 180, 180])


def test_steps_are_keys_of_a_pullback_and_of_an_endoscope() -> None:
    stated = Steps(0.005, 0.2, 0.04).stated("a file")
    assert stated.by == "a file"
    assert stated.keys == {
        "axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2, "feed_pitch_mm": 0.2, "frame_rate_hz": pytest.approx(25),
    }  # fmt: skip
    assert Steps().stated("").keys == {}
    assert "0.005 mm between rows" in Steps(row_mm=0.005).remarks.notes[0]
    assert Steps(frame_mm=0.2).remarks.notes == ()
