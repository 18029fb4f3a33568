"""What is a pullback, and what its sidecar must say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import validate
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.plugin import OCT

KEYS: dict[str, Any] = {
    "modality": "oct",
    "axial_pixel_mm": 0.005,
    "pullback_pitch_mm": 0.2,
    "bore_diameter_mm": 2.5,
    "capillary_outer_diameter_mm": 1.7,
}


def layered(n: int = 3) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (rng.integers(0, 60, (n, 100, 200)) + np.linspace(0, 150, 100)[:, None]).astype(np.uint8)


def test_a_stack_of_layers_is_claimed(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", layered(), photometric="minisblack")
    np.save(tmp_path / "a.npy", layered())
    assert OCT.sniff(tmp_path / "a.tif").claims
    assert OCT.sniff(tmp_path / "a.npy").claims


def test_other_things_are_declined_with_a_reason(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "one.tif", layered(1)[0])
    tifffile.imwrite(tmp_path / "colour.tif", np.zeros((3, 100, 200, 3), np.uint8), photometric="rgb")
    y, x = np.mgrid[-1:1:128j, -1:1:128j]
    ring = (200 * np.exp(-(((np.hypot(x, y) - 0.6) / 0.1) ** 2))).astype(np.uint8)
    tifffile.imwrite(tmp_path / "ring.tif", np.stack([ring] * 3), photometric="minisblack")
    (tmp_path / "text.tif").write_text("no image")
    reasons = {name: OCT.sniff(tmp_path / f"{name}.tif") for name in ("one", "colour", "ring", "text")}
    assert not any(sniff.claims for sniff in reasons.values())
    assert "single image" in reasons["one"].reason
    assert "colour" in reasons["colour"].reason
    assert "layered" in reasons["ring"].reason


def test_bscans_are_theta_by_depth_and_read_only(tmp_path: Path) -> None:
    pages = layered()
    tifffile.imwrite(tmp_path / "a.tif", pages, photometric="minisblack")
    stream = OCT.open(tmp_path / "a.tif", OctAcquisition(**KEYS))
    assert len(stream) == 3
    np.testing.assert_array_equal(stream[1].samples, pages[1].T)
    assert not stream[1].samples.flags.writeable


def test_colour_pages_and_tiny_pages_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "colour.npy", np.zeros((3, 100, 200, 3), np.uint8))
    np.save(tmp_path / "tiny.npy", np.zeros((3, 10, 20), np.uint8))
    for name in ("colour", "tiny"):
        with pytest.raises(EndoctError, match="holds no B-scans"):
            OCT.open(tmp_path / f"{name}.npy", OctAcquisition(**KEYS))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"capillary_outer_diameter_mm": 2.6}, "smaller than bore_diameter_mm"),
        ({"axial_pixel_mm": 0.0}, "0.0001 to 0.2 mm"),
        ({"pullback_pitch_mm": -0.2}, "0.0001 to 10 mm"),
        ({"intensity": "decibel"}, "'log' or 'linear'"),
        ({"axial_pixel": 0.005}, "axial_pixel_mm"),
    ],
)
def test_impossible_sidecars(change: dict[str, object], message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        validate(OctAcquisition, KEYS | change, "acquisition.toml")


def test_every_key_is_described() -> None:
    assert all(field.description for field in OctAcquisition.model_fields.values())


def test_positions_must_differ(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", layered())
    with pytest.raises(EndoctError, match="one place"):
        OCT.open(tmp_path / "a.npy", OctAcquisition(**KEYS, positions_mm=(0.0, 0.2, 0.2)))
