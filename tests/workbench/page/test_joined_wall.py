"""The one wall of both sides on the page: its layers, its outlines, and rings around contradictions."""

import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from mock_comparison import GRID
from PIL import Image
from workbench_page import application, written

from endoct.fusion.files.store import WALL_STORE
from endoct.fusion.result import Contradiction, WallSummary
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import save_panorama
from endoct.workbench.page.layers import RING_MM, WALL_COLOUR
from endoct.workbench.page.opening import open_shown

AREA_MM2 = math.pi * 0.2**2
FIRST_CELL = {"theta_rad": 2.0, "z_mm": 1.5}
"""Where the made-up comparison has its largest cell."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison with a wall: 0.3 mm deep from 90° to 180°, unknown above z = 0.5 mm; one contradiction."""
    found = Contradiction(shown_by="endoscope", area_mm2=AREA_MM2, relief_mm=0.01, probability=0.97, **FIRST_CELL)
    summary = WallSummary(
        cells=1, area_mm2=1.0, area_error_mm2=0.1, volume_mm3=0.3, volume_error_mm3=0.1, contradictions=(found,)
    )
    made = written(tmp_path_factory.mktemp("walled") / "bore", wall=summary)
    theta_deg, z_mm = np.meshgrid(np.degrees(GRID.theta_rad), GRID.z_mm)
    cells = (theta_deg > 90) & (theta_deg < 180)
    known = z_mm > 0.5
    probability = np.where(known, np.where(cells, 0.9, 0.1), np.nan).astype(np.float32)
    wall = Panorama(
        GRID, np.ones(GRID.shape, np.float32), np.where(cells, 0.3, 0).astype(np.float32), known,
        known.astype(np.float32), "wall", handedness_known=True, travel_known=True, frame_dim="row",
        per_frame={"row_z_mm": PerFrame(GRID.z_mm, "mm", "place"), "cell_probability": PerFrame(probability, "1", "p")},
    )  # fmt: skip
    save_panorama(wall, made / WALL_STORE)
    return made


def test_the_wall_is_a_layer_of_both_sides_with_a_relief(folder: Path):
    shown = open_shown(folder)
    part = next(part for part in shown.description.layers if part.key == "wall-relief")
    assert (part.side, part.unit) == (None, "mm")
    assert "wall-relief" in shown.reliefs
    assert shown.values_at(math.radians(135), 1.5)["wall-relief"] == pytest.approx(0.3)
    assert shown.values_at(math.radians(135), 0.2)["wall-relief"] is None
    part = next(part for part in shown.description.layers if part.key == "wall-probability")
    assert (part.side, part.unit, part.title) == (None, "1", "wall: probability of a cell")
    assert [shown.values_at(math.radians(deg), 1.5)["wall-probability"] for deg in (135, 300)] == pytest.approx(
        [0.9, 0.1]
    )


def test_cells_of_the_wall_are_shown_and_outlined(folder: Path):
    with application(folder) as served:
        picture = Image.open(io.BytesIO(served.get("/tiles/v/wall-cells/0/0_0.png")[1])).convert("RGBA")
        at = {deg: (1 + round(256 * deg / 360), picture.height // 2) for deg in (135, 300)}
        assert picture.getpixel(at[135]) == (*WALL_COLOUR, 255)
        assert picture.getpixel(at[300])[:3] != WALL_COLOUR
        assert picture.getpixel((at[135][0], 1))[3] == 0  # nobody saw it
        (line,) = json.loads(served.get("/outlines.json")[1])["wall-cells"]
        theta_deg = np.degrees(line[::2])
        assert (theta_deg.min(), theta_deg.max()) == (pytest.approx(90, abs=2), pytest.approx(180, abs=2))


def test_a_contradiction_is_ringed_at_its_place(folder: Path):
    shown = open_shown(folder)
    (ring,) = shown.outlines()["wall-contradictions"]
    around_mm, along_mm = 1.25 * (np.array(ring[::2]) - 2.0), np.array(ring[1::2]) - 1.5
    np.testing.assert_allclose(np.hypot(around_mm, along_mm), 0.2 + RING_MM, atol=1e-4)
    assert ring[:2] == pytest.approx(ring[-2:], abs=1e-4)
    assert [one.title for one in shown.description.outlines][-2:] == ["wall", "1 contradiction"]


def test_the_cell_that_is_contradicted_says_so(folder: Path):
    said = {(cell.side, cell.id): "contradict" in cell.why for cell in open_shown(folder).description.cells}
    nearest = min(
        (cell for cell in open_shown(folder).description.cells if cell.side == "endoscope"),
        key=lambda cell: abs(cell.theta_rad - 2.0),
    )
    assert [key for key, contradicts in said.items() if contradicts] == [("endoscope", nearest.id)]


def test_without_a_wall_there_is_none_of_it(comparison: Path):
    shown = open_shown(comparison)
    assert not [part.key for part in shown.description.layers if part.key.startswith("wall")]
    assert "wall-contradictions" not in shown.outlines()
