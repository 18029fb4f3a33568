"""What looks like an unrolled image, without a sidecar."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from endoct.modalities.recognition import recognise
from endoct.modalities.unrolled.image_stream import read_plane, sniff_image, step_over_seam
from tests.modalities.unrolled.drawn import N_COLUMNS, N_ROWS, brightness, distances, pits, write

MASK = pits()


def test_an_image_that_closes_is_claimed_and_half_of_it_is_not(tmp_path: Path) -> None:
    image = brightness(MASK)
    tifffile.imwrite(tmp_path / "wall.tif", image)
    claimed = recognise(tmp_path / "wall.tif")
    assert claimed.manifest.name == "unrolled"
    assert claimed.certainty == "unsure"
    assert claimed.sniff.preview is not None
    assert np.array_equal(claimed.sniff.preview.pictures[0], image)
    assert set(claimed.missing) >= {"bore_diameter_mm", "travel", "handedness", "theta_origin_rad"}
    assert recognise(tmp_path).manifest.name == "unrolled"
    tifffile.imwrite(tmp_path / "half.tif", image[:, : N_COLUMNS // 2])
    assert "does not continue" in sniff_image(tmp_path / "half.tif").reason
    assert "no single image" in sniff_image(tmp_path).reason


def test_a_table_is_claimed_and_a_photograph_with_dark_margins_is_not(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "wall.csv", brightness(MASK), fmt="%d", delimiter=";")
    assert sniff_image(tmp_path / "wall.csv").claims
    photograph = np.zeros((N_ROWS, N_COLUMNS), np.uint8)
    photograph[:, 20:-20] = brightness(MASK)[:, 20:-20]
    cv2.imwrite(str(tmp_path / "dark.png"), photograph)
    assert not sniff_image(tmp_path / "dark.png").claims


def test_what_a_sidecar_names_is_claimed_whatever_it_looks_like(tmp_path: Path) -> None:
    folder = write(tmp_path, None, distances(MASK)[:, :40])
    claimed = sniff_image(folder)
    assert (claimed.claims, claimed.certainty) == (True, "likely")


def test_the_step_over_the_seam() -> None:
    """Columns 0, 1, 2, … 7 rise by 1; back to the first it is 7. Half a turn apart all differ by 4."""
    rising = np.tile(np.arange(8, dtype=np.float32), (3, 1))
    assert step_over_seam(rising) == (7.0, 7 / 4)
    rising[:, 3] = np.nan
    assert step_over_seam(rising) == (7.0, 7 / 4)
    assert np.isnan(step_over_seam(np.ones((3, 8), np.float32))).all()
    assert np.isnan(step_over_seam(np.full((3, 8), np.nan, np.float32))).all()


@pytest.mark.parametrize("channels", [2, 4])
def test_what_is_transparent_was_not_observed(tmp_path: Path, channels: int) -> None:
    image = np.stack([brightness(MASK)] * channels, axis=2)
    image[..., -1] = 255
    image[4, 5, -1] = 0
    kind = "rgb" if channels == 4 else "minisblack"
    tifffile.imwrite(
        tmp_path / "wall.tif", image, photometric=kind, extrasamples=("unassalpha",), planarconfig="contig"
    )
    values = read_plane(tmp_path / "wall.tif", "intensity").values
    assert np.argwhere(np.isnan(values)).tolist() == [[4, 5]]


def test_pages_follow_each_other_along_the_bore(tmp_path: Path) -> None:
    image = brightness(MASK)
    tifffile.imwrite(tmp_path / "wall.tif", image.reshape(4, -1, N_COLUMNS), photometric="minisblack")
    assert np.array_equal(read_plane(tmp_path / "wall.tif", "intensity").values, image.astype(np.float32))
    np.save(tmp_path / "wall.npy", image.astype(np.float64))
    assert np.array_equal(read_plane(tmp_path / "wall.npy", "intensity").values, image.astype(np.float32))
