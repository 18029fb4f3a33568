"""The travel time of a real drilled hole: the paper's sine leaves no more than beams differ from their neighbours."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile

from endoct.workbench import unroll
from tests.modalities.unrolled.drawn import write

RECORDINGS = os.environ.get("ENDOCT_RECORDINGS")


@pytest.mark.skipif(RECORDINGS is None, reason="ENDOCT_RECORDINGS names no folder of real recordings")
def test_the_sine_of_a_real_travel_time_leaves_what_neighbours_differ_by(tmp_path: Path) -> None:
    path = Path(str(RECORDINGS)) / "televiewer" / "acoustic-travel-time.tif"
    if not path.exists():
        pytest.skip("the travel time of a real hole is not there")
    keys = {"bore_diameter_mm": 96.0, "row_pitch_mm": 6.0, "deeper": "larger", "centred": False}
    folder = write(tmp_path, None, None, depth_file=path.name, depth_mm_per_count=0.05, **keys)
    shutil.copy(path, folder)
    residual_mm = unroll(folder).per_frame["residual_mm"].values
    counts = tifffile.imread(path).astype(np.float64)
    steps = np.diff(counts, axis=1, append=counts[:, :1])
    step_mm = 0.05 * 1.4826 * np.median(np.abs(steps - np.median(steps, axis=1, keepdims=True)), axis=1) / np.sqrt(2)
    assert 0 < np.nanmedian(residual_mm) <= 1.1 * np.median(step_mm)
