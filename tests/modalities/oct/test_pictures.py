"""Pictures of one B-scan."""

import numpy as np
import pytest

from endoct.modalities.oct.plugin import OCT
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


def test_pictures(unrolled: UnrollPhantom) -> None:
    stream, calibration, _ = unrolled(Phantom(n_slices=3))
    recorded, undistorted = OCT.illustrate(stream[1], calibration)
    assert set(recorded.curves) == {"outer face of the capillary", "sine first fitted to it", "wall"}
    assert max(recorded.image.shape) <= 1000
    wall = undistorted.curves["wall"][:, 1]
    assert np.nanmedian(wall) == pytest.approx(1.2, abs=0.02)
    assert undistorted.y_extent[0] == pytest.approx(0.75)
    assert stream[1].samples.dtype.kind == "u"
    assert recorded.image.dtype == undistorted.image.dtype == np.uint16
