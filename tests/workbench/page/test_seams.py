"""No lines show between tiles. Only a graphics card, an emulated one too, draws rims of tiles that shine through."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_browser import launched, opened
from PIL import Image
from workbench_page import serving

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama

SHAPE = 120, 4096


@pytest.fixture
def with_card(chromium: Any) -> Iterator[Any]:
    """A browser whose card puts the page together too."""
    started = launched(chromium.browser_type)
    yield started
    started.close()


def test_a_wall_of_one_value_has_one_colour(with_card: Any, tmp_path: Path):
    grid = SurfaceGrid.full_circle(*SHAPE, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
    even, valid = np.full(SHAPE, 0.5, np.float32), np.ones(SHAPE, np.bool_)
    save_panorama(Panorama(grid, even, None, valid, even, "oct", True, True), tmp_path / "wall.zarr")
    with serving(tmp_path / "wall.zarr") as served, opened(with_card, served.url) as page:
        view = page.page.locator(".view")
        box = view.bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.page.mouse.move(middle[0] + 13, middle[1] + 7)  # so that seams lie between pixels
        for _ in range(4):
            page.page.mouse.wheel(0, -170)
            page.settle()
            page.page.wait_for_load_state("networkidle")
            page.settle()
            shown = np.asarray(Image.open(io.BytesIO(view.screenshot())).convert("RGB"))
            row = shown.shape[0] // 2
            columns = np.median(shown[row - 30 : row + 30, 40:-10], axis=0)  # without axes and cursor
            assert len(columns) > 700
            assert (columns == np.median(columns, axis=0)).all()
