"""The tutorials do what they say: their commands run, and print what stands below them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from tutorial import agrees, run_page

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"


def test_a_first_comparison(tmp_path: Path) -> None:
    assert run_page(TUTORIALS / "first-comparison.md", tmp_path) > 10


@pytest.mark.slow
def test_a_bore_in_a_ct(tmp_path: Path) -> None:
    assert run_page(TUTORIALS / "pose-in-ct.md", tmp_path) > 10


def test_a_real_pullback(tmp_path: Path, recordings: Path) -> None:
    _write_round_frames(tifffile.imread(recordings / "coronary-oct" / "pullback.tif"), tmp_path / "frames")
    assert run_page(TUTORIALS / "real-pullback.md", tmp_path) > 10


def _write_round_frames(slices: np.ndarray, folder: Path) -> None:
    """Write slices (slice, depth, A-scan), u8, as the round pictures that the data set has."""
    folder.mkdir()
    n_depth, n_theta = slices.shape[1:]
    across = np.arange(2 * n_depth, dtype=np.float32) - (n_depth - 0.5)
    x, y = np.meshgrid(across, across)
    turn = (np.arctan2(y, x) / (2 * np.pi) % 1 * n_theta).astype(np.float32)
    radius = np.hypot(x, y) - np.float32(0.5)
    for index, polar in enumerate(slices):
        closed = np.concatenate([polar, polar[:, :1]], axis=1)
        picture = cv2.remap(closed, turn, radius, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        cv2.imwrite(str(folder / f"{index:04d}.png"), cv2.merge([picture] * 3))


def test_a_page_may_leave_text_out_and_numbers_may_be_a_little_off() -> None:
    assert agrees("Jaccard index 0.87, Dice ...\nreport: x", "Jaccard index 0.875, Dice 0.93 (a)\nreport:  x\n")
    assert agrees("z 0.00 to 3.0 mm", "z 0.01 to 3.1 mm")


def test_a_page_may_not_say_something_else() -> None:
    assert not agrees("aligned: True", "aligned: False")
    assert not agrees("Jaccard index 0.87", "Jaccard index 0.85")
    assert not agrees("92.0% valid", "91.7% valid")
    assert not agrees("16 rows", "17 rows")
    assert not agrees("16 rows", "16 rows and more")
