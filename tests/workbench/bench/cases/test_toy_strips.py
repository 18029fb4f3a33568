"""Strips of a toy wall."""

import numpy as np

from endoct.workbench.bench.cases import toy_strips


def test_strips_show_the_wall_where_they_are() -> None:
    """A strip that moved by whole rows and columns shows the same, but for the probe and the pits."""
    still = dict.fromkeys(toy_strips.RANGES, 0.0) | {"texture": 0.3}
    strips, z_mm, _ = toy_strips.toy_strips(1, 0, still)
    rows = toy_strips.PITCH_MM / (toy_strips.VISIBLE_MM / toy_strips.N_ROWS)
    np.testing.assert_allclose(np.diff(z_mm), toy_strips.PITCH_MM)
    below, above = np.log(strips[0].intensity[round(rows) :]), np.log(strips[1].intensity[: -round(rows)])
    flat = [one - np.median(one, axis=1, keepdims=True) for one in (below, above)]
    at_place = np.corrcoef(flat[0].ravel(), flat[1].ravel())[0, 1]
    elsewhere = np.corrcoef(np.roll(flat[0], 40, axis=1).ravel(), flat[1].ravel())[0, 1]
    assert at_place > elsewhere + 0.3
