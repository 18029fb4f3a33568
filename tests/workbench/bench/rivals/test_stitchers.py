"""Strips placed by whole programs for stitching."""

import sys
from collections.abc import Callable
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
OTHERS = {
    "m2stitch": stitchers.m2stitch_prepared,
    "multiview_stitcher": stitchers.multiview_stitcher_prepared,
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


def check(case: StitchingCase, method: Callable[..., stitching.StripPoses], right: float) -> None:
    first, again = (method(*case.given) for _ in range(2))
    np.testing.assert_array_equal(first.z_mm, again.z_mm)
    scores = stitching.judge(case, first)
    assert scores["right"] >= right
    assert scores["wrong"] <= 0.3


@pytest.mark.parametrize("library", OTHERS)
def test_a_program_places_strips_whichever_way_the_probe_moves(case: StitchingCase, library: str) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed", exc_type=ImportError)
    check(case, OTHERS[library], 0.7)
    check(moving_out(case), OTHERS[library], 0.7)


def test_opencv_places_pairs_of_strips(case: StitchingCase) -> None:
    check(case, stitchers.opencv_scans_prepared, 0.5)


@pytest.mark.parametrize("library", OTHERS)
def test_a_program_that_is_not_installed_is_left_out(
    case: StitchingCase, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(NotInstalled, match=f"{library.replace('_', '-')} is not installed"):
        OTHERS[library](*case.given)
