"""What speaks against a ring: each piece of evidence by hand, and whole recordings that are broken in one way."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from doubted import codes_of

from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.doubts import RingEvidence, doubts_of_ring
from endoct.modalities.endoscope.frames import brightness_of_rows
from endoct.modalities.endoscope.mirror.ring_search import ROUND, Roundness
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.plugin import ENDOSCOPE
from endoct.modalities.recognition import open_recording

SOUND = RingEvidence(
    apart=0.01,
    spread=(0.001, 0.001),
    darkest=0.8,
    saturated=0.02,
    matched=1.0,
    moving=(20.0, 30.0, 25.0),
    moving_within=1.1,
    roundness=ROUND,
    corrected=False,
)
BROKEN: list[tuple[dict[str, Any], str]] = [
    ({"apart": 0.12}, "rims-eccentric"),
    ({"spread": (0.03, 0.0)}, "rim-moves"),
    ({"spread": (0.0, 0.03)}, "rim-moves"),
    ({"darkest": 0.1}, "bore-end-in-view"),
    ({"saturated": 0.33}, "ring-saturated"),
    ({"matched": 0.2}, "frames-not-matched"),
    ({"moving": (1.0, 1.2, 0.9)}, "no-wall-moves"),
    ({"moving": None, "moving_within": None, "matched": None, "spread": None}, "no-wall-moves"),
    ({"moving": (20.0, 30.0, 1.0)}, "ring-partly-still"),
    ({"moving_within": 18.0}, "wall-within-inner-rim"),
    ({"roundness": Roundness(1.1, 1.0), "corrected": True}, "pixels-not-square"),
    ({"roundness": Roundness(1.0, 1.04)}, "ring-not-round"),
]


def test_a_sound_ring_raises_no_doubt() -> None:
    assert list(doubts_of_ring(SOUND)) == []


@pytest.mark.parametrize(("change", "code"), BROKEN, ids=[f"{code}-{k}" for k, (_, code) in enumerate(BROKEN)])
def test_each_piece_of_evidence_raises_its_own_doubt(change: dict[str, Any], code: str) -> None:
    (doubt,) = doubts_of_ring(replace(SOUND, **change))
    assert doubt.code == code
    if isinstance(doubt.expected, tuple) and doubt.value is not None:
        low, high = doubt.expected
        assert not low <= doubt.value <= high


def test_a_row_is_as_bright_as_its_upper_quartile() -> None:
    logs = np.full((3, 8), np.nan, np.float16)
    logs[0] = range(8)
    logs[1, 2:6] = [4, 1, 3, 2]
    np.testing.assert_array_equal(brightness_of_rows(logs), [5, 3, np.nan])


Copies = Callable[..., Path]


@pytest.fixture
def copied(quick_specimen: Path, tmp_path: Path) -> Copies:
    """Copy frames of the specimen's recording, each through a function of the image."""

    def copy(indices: range | list[int], change: Callable[[Any], Any] = lambda image: image) -> Path:
        frames = sorted((quick_specimen / "endoscope").glob("frame_*"))
        for k, index in enumerate(indices):
            image = cv2.imread(str(frames[index]), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(tmp_path / f"frame_{k:04d}.png"), change(image))
        lines = (quick_specimen / "endoscope" / "acquisition.toml").read_text(encoding="utf-8").splitlines()
        kept = [line for line in lines if not line.startswith("annulus")]
        (tmp_path / "acquisition.toml").write_text("\n".join(kept), encoding="utf-8")
        return tmp_path

    return copy


def survey(path: Path) -> EndoscopeCalibration:
    _, stream = open_recording(path, modality="endoscope")
    return ENDOSCOPE.survey(stream, EndoscopeParameters())


def test_a_sound_recording_is_not_doubted_and_its_pixels_are_square(copied: Copies) -> None:
    calibration = survey(copied(range(12)))
    assert calibration.doubts == ()
    assert calibration.annuli[0].pixels == 1


def test_pixels_that_are_not_square_are_named_and_put_right(copied: Copies, tmp_path_factory: Any) -> None:
    """Every column but one in eleven: the ring is found where it is in the sound recording."""
    recording = copied(range(12))
    sound = survey(recording)
    narrow = tmp_path_factory.mktemp("narrow")
    shutil.copy(recording / "acquisition.toml", narrow)
    for file in sorted(recording.glob("frame_*")):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        size = round(image.shape[1] / 1.1), image.shape[0]
        cv2.imwrite(str(narrow / file.name), cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    calibration = survey(narrow)
    assert codes_of(calibration.doubts) == ["pixels-not-square"]
    assert calibration.annuli[0].pixels == pytest.approx(1 / 1.1, abs=0.003)
    assert calibration.annuli[0].outer_px == pytest.approx(sound.annuli[0].outer_px, rel=0.005)
    assert calibration.annuli[0].inner_px == pytest.approx(sound.annuli[0].inner_px, rel=0.02)
    assert calibration.per_frame["annulus_x_px"] == pytest.approx(sound.per_frame["annulus_x_px"] / 1.1, abs=0.5)
    np.testing.assert_allclose(calibration.z_mm, sound.z_mm, atol=0.01)


def test_a_single_picture_is_doubted(copied: Copies) -> None:
    assert "no-wall-moves" in codes_of(survey(copied([5])).doubts)


def test_a_picture_repeated_is_doubted(copied: Copies) -> None:
    rng = np.random.default_rng(0)

    def noisy(image: Any) -> Any:
        return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)

    assert "no-wall-moves" in codes_of(survey(copied([5] * 6, noisy)).doubts)


def test_a_ring_saturated_by_a_third_is_doubted(copied: Copies) -> None:
    def brighter(image: Any) -> Any:
        return np.clip(image.astype(float) * 2.2, 0, 255).astype(np.uint8)

    calibration = survey(copied(range(8), brighter))
    assert np.median(calibration.per_frame["saturated_fraction"]) > 0.3
    assert "ring-saturated" in codes_of(calibration.doubts)


def test_the_picture_of_a_pipes_end_is_doubted(recordings: Path, tmp_path: Path) -> None:
    shutil.copy(next((recordings / "pipe-end").glob("*.jpg")), tmp_path)
    keys = 'modality = "endoscope"\nbore_diameter_mm = 2.5\nvisible_length_mm = 1.0\nfeed_pitch_mm = 0.2\n'
    (tmp_path / "acquisition.toml").write_text(keys, encoding="utf-8")
    codes = codes_of(survey(tmp_path).doubts)
    assert "no-wall-moves" in codes
