"""What is taken for a pullback and how sure that is, which way its depth runs, and what its sidecar must say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, NotSeen
from endoct.modalities.acquisition import validate
from endoct.modalities.contract import Sniff
from endoct.modalities.oct.bscan import UPSIDE_DOWN, share_brightening
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.recognition import recognise
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom

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


def drawn_pages(turns: float = 1.0) -> NDArray[np.uint8]:
    """Pages (slice, depth, A-scan): two thin lines, then tissue that fades behind a surface of ``turns`` waves."""
    depth, angle = np.mgrid[0:200, 0:300].astype(float)
    rng = np.random.default_rng(0)
    wave = np.sin(2 * np.pi * turns * angle / 300)
    behind = depth - 100 - 30 * wave
    page = 40 + np.where(behind > 0, 120 * np.exp(-behind / 40), 0)
    page += 150 * (np.abs(depth - 20) < 1) + 150 * (np.abs(depth - 60 - 15 * wave) < 1)
    return np.clip(page + rng.normal(0, 12, (3, *page.shape)), 0, 255).astype(np.uint8)


def sniffed(pages: NDArray[np.uint8], folder: Path) -> Sniff:
    tifffile.imwrite(folder / "pages.tif", pages, photometric="minisblack")
    return OCT.sniff(folder / "pages.tif")


def test_full_turns_are_likely_a_pullback(tmp_path: Path) -> None:
    verdict = sniffed(drawn_pages(), tmp_path)
    assert (verdict.claims, verdict.certainty) == (True, "likely")
    assert "upside" not in verdict.reason
    assert verdict.preview is not None
    assert verdict.preview.size == "300 A-scans × 200 depth samples"
    assert (verdict.preview.n_frames, verdict.preview.dtype) == (3, "uint8")
    assert [picture.shape for picture in verdict.preview.pictures] == [(200, 300)] * 3


def test_without_a_full_turn_it_is_unsure(tmp_path: Path) -> None:
    verdict = sniffed(drawn_pages(0.25), tmp_path)
    assert (verdict.claims, verdict.certainty) == (True, "unsure")
    assert "does not continue" in verdict.reason


def test_pages_on_their_side_are_declined_and_say_so(tmp_path: Path) -> None:
    verdict = sniffed(np.ascontiguousarray(drawn_pages().swapaxes(1, 2)), tmp_path)
    assert not verdict.claims
    assert "from left to right" in verdict.reason


def test_pages_that_are_upside_down_are_claimed_and_say_so(tmp_path: Path) -> None:
    verdict = sniffed(drawn_pages()[:, ::-1], tmp_path)
    assert verdict.claims
    assert "upside down" in verdict.reason


def test_photographs_are_declined(tmp_path: Path) -> None:
    y, x = np.mgrid[-1:1:200j, -1.5:1.5:300j]
    disc = np.where(np.hypot(x, y) < 0.9, 150 + 40 * np.sin(9 * x) * np.cos(7 * y), 15)
    pages = np.clip(disc + np.random.default_rng(0).normal(0, 5, (3, *disc.shape)), 0, 255).astype(np.uint8)
    assert not sniffed(pages, tmp_path).claims


def test_noise_has_no_direction() -> None:
    noise = np.random.default_rng(0).normal(100, 10, (2000, 512)).astype(np.float32)
    assert share_brightening(noise) > UPSIDE_DOWN
    assert share_brightening(noise[:, ::-1]) > UPSIDE_DOWN


def test_what_shows_nothing_is_not_upside_down(quick_specimen: Path) -> None:
    flat = np.full((300, 200), 40, np.float32)
    assert share_brightening(flat) == 0.5
    page = tifffile.imread(quick_specimen / "oct" / "pullback.tif")[4].T.astype(np.float32)
    for black in (page.copy(), page.copy()[:, ::-1]):
        black[: len(page) // 2] = 0
        assert (share_brightening(black) < UPSIDE_DOWN) == (black[-1, 0] != page[-1, 0])


def test_a_pullback_exported_upside_down_is_refused_in_one_line(unrolled: UnrollPhantom) -> None:
    phantom = Phantom(n_slices=4)
    with pytest.raises(NotSeen, match=r"upside down.*darkens with depth.*turn the pages over") as caught:
        unrolled(phantom, np.ascontiguousarray(phantom.log_counts()[:, ::-1]))
    assert "\n" not in str(caught.value)


def test_the_simulated_pullback_upside_down_is_refused_too(quick_specimen: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(quick_specimen / "oct" / "pullback.tif")[::4]
    upright = np.mean([share_brightening(page.T) for page in pages])
    reversed_ = np.mean([share_brightening(page[::-1].T) for page in pages])
    assert reversed_ < UPSIDE_DOWN < 0.5 < upright
    tifffile.imwrite(tmp_path / "pullback.tif", pages[:, ::-1], photometric="minisblack")
    assert "upside down" in OCT.sniff(tmp_path).reason


def test_the_real_pullback_is_known_without_its_sidecar(recordings: Path, tmp_path: Path) -> None:
    (tmp_path / "pullback.tif").symlink_to(recordings / "coronary-oct" / "pullback.tif")
    assert recognise(tmp_path).manifest.name == "oct"
    verdict = OCT.sniff(tmp_path)
    assert verdict.certainty == "likely"
    assert "upside" not in verdict.reason
    pages = tifffile.imread(tmp_path / "pullback.tif")[::10]
    assert np.mean([share_brightening(page[::-1].T) for page in pages]) < UPSIDE_DOWN


def test_no_other_real_image_is_taken_for_a_pullback(recordings: Path) -> None:
    photographs = list(recordings.glob("*/*.jpg"))
    assert photographs
    assert not any(OCT.sniff(file).claims for file in photographs)
