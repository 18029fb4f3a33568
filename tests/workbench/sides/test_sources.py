"""One source or two: how their stages are called, and which cannot be sides of a pose."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.running.scheduler import ALONE
from endoct.workbench.sides import sources
from endoct.workbench.sides.recordings import Recording
from endoct.workbench.sides.sources import Source, open_recorded, read_sides, source_of, unroll_sources

RECORDING: Any = Recording(Path("oct"), {}, *[None] * 3)  # type: ignore[arg-type]
MASK = Path("anna_1.png")


@pytest.mark.parametrize(
    ("opened", "made"),
    [((RECORDING,), ("",)), ((RECORDING, MASK), ("A", MASK)), ((MASK, RECORDING), (MASK, "B"))],
)
def test_stages_say_which_side_they_are_of(opened: Any, made: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "unroll_recording", lambda _recording, _stages, label: label)
    assert unroll_sources(opened, SilentStages(), ALONE) == made


def test_a_panorama_at_hand_is_no_path() -> None:
    at_hand = object.__new__(Panorama)
    assert source_of(at_hand, None, {}).given is at_hand
    assert source_of("bore/oct", "oct", {}) == Source(Path("bore/oct"), "oct", {}, None)


def test_a_pose_has_one_side_or_two_and_no_mask(tmp_path: Path) -> None:
    mask = Source(tmp_path / "anna_1.png", None, {})
    cv2.imwrite(str(mask.path), np.eye(8, dtype=np.uint8) * 255)
    for n in (0, 3):
        with pytest.raises(EndoctError, match=f"found {n} sides"):
            open_recorded([mask] * n)
    with pytest.raises(EndoctError, match=r"anna_1.png is a mask drawn by hand"):
        open_recorded([mask])
    with pytest.raises(EndoctError, match="would be compared with itself"):
        open_recorded([mask, mask])
    with pytest.raises(EndoctError, match="a mask by itself"):
        read_sides([MASK])
