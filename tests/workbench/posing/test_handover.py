"""Where a bore was found, handed over to other programs."""

import numpy as np
import pytest

from endoct.workbench.posing.handover import tube_of


def test_the_tube_is_closed_faces_outward_and_lies_in_the_ct() -> None:
    to_lps = np.array([[0, 0, 1, 10], [1, 0, 0, 20], [0, 1, 0, 30], [0, 0, 0, 1]], dtype=np.float64)
    tube = tube_of(to_lps, 1.25, 12.0)
    corners = tube.points_mm[tube.faces].astype(np.float64)
    volume_mm3 = np.linalg.det(corners - [10, 20, 30]).sum() / 6  # negative where faces look inward
    assert volume_mm3 == pytest.approx(np.pi * 1.25**2 * 12, rel=0.01)
    edges = np.sort(np.concatenate([tube.faces[:, pair] for pair in ((0, 1), (1, 2), (2, 0))]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.ptp(tube.points_mm, axis=0) == pytest.approx([12, 2.5, 2.5], abs=1e-3)
