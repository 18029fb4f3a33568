"""The travel time of a real drilled hole: the paper's sine leaves no more than the noise of single beams."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from endoct.workbench import unroll
from tests.modalities.unrolled.drawn import write

RECORDINGS = os.environ.get("ENDOCT_RECORDINGS")


@pytest.mark.skipif(RECORDINGS is None, reason="ENDOCT_RECORDINGS names no folder of real recordings")
def test_the_sine_of_a_real_travel_time_leaves_the_noise_of_beams(tmp_path: Path) -> None:
    path = Path(str(RECORDINGS)) / "televiewer" / "acoustic-travel-time.tif"
    if not path.exists():
        pytest.skip("the travel time of a real hole is not there")
    keys = {"bore_diameter_mm": 96.0, "row_pitch_mm": 6.0, "deeper": "larger", "centred": False}
    folder = write(tmp_path, None, None, depth_file=path.name, depth_mm_per_count=0.05, **keys)
    shutil.copy(path, folder)
    values = {name: one.values for name, one in unroll(folder).per_frame.items()}
    noise_mm, residual_mm = (np.nanmedian(values[name]) for name in ("beam_noise_mm", "residual_mm"))
    assert 0 < residual_mm <= 1.1 * noise_mm
