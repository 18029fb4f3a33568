"""The demonstration of a pose: a patient is simulated, and the bore found; what fails leaves nothing."""

import json
from pathlib import Path

import numpy as np
import pytest
from tolerances import TARGET_OFF_MM

from endoct.base.errors import EndoctError
from endoct.workbench.posing.pose import demo_pose


def test_without_a_patient_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="CT of bone in three dimensions only"):
        demo_pose(tmp_path / "demo", preset="quick", progress=False)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_bore_is_found_where_it_is(tmp_path: Path) -> None:
    demo_pose(tmp_path / "demo", progress=False)
    found = json.loads((tmp_path / "demo" / "pose" / "pose.json").read_text("utf-8"))["pose"]["bore_to_world"]
    true = json.loads((tmp_path / "demo" / "specimen" / "truth" / "recording.json").read_text("utf-8"))["world"]
    target_mm = np.array(true["target_mm"]) * (-1, -1, 1)  # RAS there, LPS as the plan here
    off_mm = np.linalg.inv(found) @ [*target_mm, 1]
    assert np.hypot(off_mm[0], off_mm[1]) < TARGET_OFF_MM
