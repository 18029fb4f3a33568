"""Strips placed by whole programs for stitching."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from endoct.workbench.bench.rivals import stitchers
from endoct.workbench.bench.task import NotInstalled
from endoct.workbench.bench.tasks import stitching
from endoct.workbench.bench.tasks.stitching import StitchingCase

EASY = {
    "recipe": ("made",),
    "jitter": (0.1, 0.1),
    "roll_deg": (1.0, 1.0),
    "dropped": (0.0, 0.0),
    "pattern": (0.0, 0.0),
    "texture": (0.2, 0.2),
    "pits": (0.0, 0.0),
}


@pytest.fixture(scope="module")
def case() -> StitchingCase:
    """Eight strips of a wall that is easily recognised."""
    whole = stitching.cases(4, 0, EASY)
    strips, pitch_mm = whole.given
    places = stitching.Places(whole.truth.z_mm[:8], whole.truth.roll_rad[:8])
    return replace(whole, given=(strips[:8], pitch_mm), truth=places)


def moving_out(case: StitchingCase) -> StitchingCase:
    """The same strips, recorded from the last to the first."""
    strips, pitch_mm = case.given
    places = stitching.Places(case.truth.z_mm[::-1], case.truth.roll_rad[::-1])
    return replace(case, given=(strips[::-1], -pitch_mm), truth=places)


def test_a_program_places_strips_whichever_way_the_probe_moves(case: StitchingCase) -> None:
    pytest.importorskip("m2stitch", reason="m2stitch is not installed", exc_type=ImportError)
    for moving in (case, moving_out(case)):
        first, again = (stitchers.m2stitch_prepared(*moving.given) for _ in range(2))
        np.testing.assert_array_equal(first.z_mm, again.z_mm)
        scores = stitching.judge(moving, first)
        assert scores["right"] >= 0.7
        assert scores["wrong"] <= 0.3


def test_a_program_that_is_not_installed_is_left_out(case: StitchingCase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "m2stitch", None)
    with pytest.raises(NotInstalled, match="m2stitch is not installed"):
        stitchers.m2stitch_prepared(*case.given)
