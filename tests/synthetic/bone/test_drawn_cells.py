"""What is drawn: holes of a phantom, and the network of a mastoid."""

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.synthetic.bone.drawn_cells import _Packed, draw_cells
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Bore

KINDS = ["phantom", "mastoid"]


def drawn(kind: str, seed: int, **ranges: float) -> Bore:
    wanted = {f"bore.{name}": (value, value) for name, value in ranges.items()}
    return draw("learning", seed, ranges={"bore.bone": (kind,), **wanted}).bore


@pytest.mark.parametrize("kind", KINDS)
def test_cells_keep_to_the_sizes_of_real_ones(kind: str) -> None:
    cells = [cell for seed in range(3) for cell in drawn(kind, seed).cells]
    depth, bulge = (np.array([getattr(cell, name) for cell in cells]) for name in ("depth_mm", "bulge_mm"))
    across = np.array([cell.diameter_mm for cell in cells])
    power = np.array([cell.squareness for cell in cells])
    opening = across * (1 - (bulge / (depth - bulge)) ** power) ** (1 / power)
    assert opening.min() > 0.19
    assert opening.max() < 1.51
    assert depth.min() >= 0.05
    assert depth.max() <= 1.5
    if kind == "mastoid":
        assert (bulge > 0.05).mean() > 0.3
        assert power.max() <= 3
    else:
        assert not bulge.any()
        assert power.min() >= 5


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fraction", [0.1, 0.27, 0.4])
def test_the_wanted_part_of_the_wall_is_cut_away(kind: str, fraction: float) -> None:
    ranges = {"bore.bone": (kind,), "bore.cell_fraction": (fraction, fraction)}
    missing = float(build_wall(draw("learning", 7, ranges=ranges)).cell.mean())
    assert fraction - 0.01 < missing < max(0.30, fraction + 0.025)


def test_a_network_leaves_thin_septa_but_where_cells_communicate() -> None:
    for communicating, least in ((0.0, 0.04), (1.0, -0.09)):
        bore = drawn("mastoid", 5, septum_mm=0.05, communicating=communicating, cell_fraction=0.2)
        packed = _Packed(bore.diameter_mm / 2)
        nearest = []
        for cell in bore.cells:
            if packed.cells:
                nearest.append(float(packed._gaps(cell, range(len(packed.cells))).min()))
            packed.add(cell)
        gaps = np.array(nearest)
        assert gaps.min() >= least - 1e-9
        beside = np.mean(np.abs(gaps - 0.05) < 0.02) if communicating == 0 else np.mean(gaps < 0)
        assert beside > 0.6


@pytest.mark.parametrize("kind", KINDS)
def test_fillings_and_linings_come_in_their_shares(kind: str) -> None:
    cells = [
        cell
        for seed in range(4)
        for cell in drawn(kind, seed, dust=0.4, fluid=0.3, lining=0.5, cell_fraction=0.25).cells
    ]
    n = len(cells)
    for share, of in (
        (0.4, [cell.filling == "dust" for cell in cells]),
        (0.3, [cell.filling == "fluid" for cell in cells]),
        (0.5, [cell.edge_mm >= 0.06 and cell.lining > 0.9 for cell in cells]),
    ):
        assert np.mean(of) == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / n))
    assert all(cell.fill_mm <= cell.depth_mm for cell in cells)


def test_too_much_to_ask_is_an_error_that_ends() -> None:
    bore = drawn("mastoid", 0, cell_fraction=0.1)
    crowded = bore.model_copy(update={"cell_fraction": 0.4, "septum_mm": 0.5, "length_mm": 3.0})
    with pytest.raises(EndoctError, match="no room"):
        draw_cells(np.random.default_rng(0), crowded)
