"""What is taken for a pullback, how sure that is, and which way its depth runs."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from endoct.base.errors import NotSeen
from endoct.modalities.contract import Sniff
from endoct.modalities.oct.depth_order import UPSIDE_DOWN, share_brightening
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.registry import manifest_for
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


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
    assert manifest_for(tmp_path).name == "oct"
    verdict = OCT.sniff(tmp_path)
    assert verdict.certainty == "likely"
    assert "upside" not in verdict.reason
    pages = tifffile.imread(tmp_path / "pullback.tif")[::10]
    assert np.mean([share_brightening(page[::-1].T) for page in pages]) < UPSIDE_DOWN


def test_no_other_real_image_is_taken_for_a_pullback(recordings: Path) -> None:
    photographs = list(recordings.glob("*/*.jpg"))
    assert photographs
    assert not any(OCT.sniff(file).claims for file in photographs)
