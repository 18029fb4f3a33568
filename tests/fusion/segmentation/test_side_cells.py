"""Which of two answers stays, the eye's or the threshold's, and why: each put in by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Literal

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation import side_cells
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

SHAPE = (6, 16)
GRID = SurfaceGrid.full_circle(*SHAPE, z0_mm=0.0, dz_mm=0.02, radius_mm=0.05)
LIGHT = np.linspace(0.1, 1, 96, dtype=np.float32).reshape(SHAPE)
SIDE = Side("endoscope", Panorama(GRID, LIGHT, None, LIGHT > 0, np.ones(SHAPE), "endoscope", True, True))
UNSURE_DOUBT = Doubt("cells-unsure", "The eye is not sure.")
SHARE_DOUBT = Doubt("cells-too-many", "Nearly all is cell.")


def answer(of: str, *doubts: Doubt, least: float = 0.5) -> Segmentation:
    """Return cells where the light is more than ``least``: 96 samples lie evenly between 0.1 and 1."""
    return Segmentation(least < LIGHT, 0.5, "1", of, "dark", "rules", "given", None, doubts)


@pytest.mark.parametrize(
    ("expected", "of_eye", "of_rules", "stays"),
    [
        (0.95, answer("eye", least=0.9), answer("rules", least=0.2), "eye"),  # nobody is asked
        (0.95, answer("eye", SHARE_DOUBT), answer("rules"), "eye"),
        (0.91, answer("eye", least=0.9), answer("rules", least=0.2), "eye"),
        (0.90, answer("eye", least=0.9), answer("rules", least=0.2), "rules, not sure"),
        (0.95, answer("eye", least=1.0), answer("rules"), "rules, not sure"),  # an eye that finds none may be blind
        (0.60, answer("eye", UNSURE_DOUBT), answer("rules"), "eye"),
        (0.90, answer("eye", least=0.6), answer("rules"), "eye"),  # 80 % of those by rules
        (0.90, answer("eye", least=0.67), answer("rules"), "rules, not sure"),  # 66 %
        (0.90, answer("eye", least=0.9), answer("rules", least=1.0), "eye"),  # there are none to find
        (0.90, answer("eye", least=0.6), answer("rules", SHARE_DOUBT, least=0.5), "eye"),
        (0.90, answer("eye", least=0.9), answer("rules", SHARE_DOUBT, least=0.2), "eye"),
        (0.60, answer("eye", UNSURE_DOUBT, least=0.9), answer("rules", SHARE_DOUBT, least=0.2), "eye"),
    ],
)
def test_which_of_two_answers_stays(
    expected: float, of_eye: Segmentation, of_rules: Segmentation, stays: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_cells, "view_of", lambda *_: SimpleNamespace(is_familiar=True))
    monkeypatch.setattr(side_cells, "cells_by_eye", lambda *_: (of_eye, expected))
    monkeypatch.setattr(side_cells, "find_cells", lambda *_: of_rules)
    cells = segment_side(SIDE, SegmentParameters(), "dark")
    declined = "the learned eye is not sure of this wall" if stays == "rules, not sure" else None
    assert (cells.of, cells.eye_declined) == (stays.removesuffix(", not sure"), declined)
    stated = of_eye if stays == "eye" else of_rules
    assert cells.mask is stated.mask
    codes = [doubt.code for doubt in cells.doubts]
    if "cells-by-eye-alone" in codes:
        both = (of_eye.mask & of_rules.mask).sum() / (of_eye.mask | of_rules.mask).sum()
        assert both < 0.5
        assert cells.doubts[-1].value == pytest.approx(both)
        codes.remove("cells-by-eye-alone")
    else:
        assert of_rules.mask.sum() < 2 * of_eye.mask.sum() or expected > 0.9 or not of_rules.doubts
    assert codes == [doubt.code for doubt in stated.doubts]


@pytest.mark.parametrize(
    ("view", "declined"),
    [(None, None), (SimpleNamespace(is_familiar=False), "the wall is too grainy for the learned eye")],
)
def test_an_eye_that_is_not_asked_says_nothing(
    view: SimpleNamespace | None, declined: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_cells, "view_of", lambda *_: view)
    monkeypatch.setattr(side_cells, "cells_by_eye", None)
    monkeypatch.setattr(side_cells, "find_cells", lambda *_: answer("rules", SHARE_DOUBT))
    found = segment_side(SIDE, SegmentParameters(), "dark")
    assert (found.of, found.eye_declined, found.doubts) == ("rules", declined, (SHARE_DOUBT,))


def test_only_what_does_not_know_its_cells_says_how_their_brightness_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []

    def found(*given: object) -> Segmentation:
        asked.append(given)
        return answer("rules")

    monkeypatch.setattr(side_cells, "find_cells", found)
    off = SegmentParameters(eye="off")
    segment_side(SIDE, off, "bright", "a correlation")
    segment_side(SHALLOW, off, "bright", "a correlation")
    (_, _, by_light, _), (_, _, by_depth, _) = asked
    assert (by_light, by_depth) == ("a correlation", None)


DEEP = Side("oct", replace(SIDE.panorama, depth_mm=(1 - LIGHT).astype(np.float32), modality="oct"))
SHALLOW = Side("oct", replace(SIDE.panorama, depth_mm=LIGHT, modality="oct"))


@pytest.mark.parametrize(
    ("side", "given", "agreement", "expected"),
    [
        (SIDE, "bright", 0.5, ("bright", "given")),
        (DEEP, "bright", -0.5, ("bright", "given")),
        (SIDE, "auto", 0.5, ("dark", "correlation with the other side's darkness")),
        (SIDE, "auto", -0.5, ("bright", "correlation with the other side's darkness")),
        (SIDE, "auto", None, ("dark", "assumed")),
        (DEEP, "auto", -0.5, ("dark", "correlation with its own relief")),
        (SHALLOW, "auto", 0.5, ("bright", "correlation with its own relief")),
    ],
)
def test_whether_cells_are_dark(
    side: Side, given: Literal["auto", "bright"], agreement: float | None, expected: tuple[str, str]
) -> None:
    assert side_cells._polarity(side, given, SIDE.evidence, agreement) == expected
