"""Which of two answers stays, the eye's or the threshold's, and why: each put in by hand."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation import side_cells
from endoct.fusion.segmentation.by_eye import NOT_SURE, TOO_GRAINY, UNSURE
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

SHAPE = (6, 16)
GRID = SurfaceGrid.full_circle(*SHAPE, z0_mm=0.0, dz_mm=0.02, radius_mm=0.05)
LIGHT = np.linspace(0.1, 1, 96, dtype=np.float32).reshape(SHAPE)
SIDE = Side("endoscope", Panorama(GRID, LIGHT, None, LIGHT > 0, np.ones(SHAPE), "endoscope", True, True))
UNSURE_DOUBT = Doubt(UNSURE, "The eye is not sure.")
SHARE_DOUBT = Doubt("cells-too-many", "Nearly all is cell.")


def answer(of: str, *doubts: Doubt) -> Segmentation:
    return Segmentation(LIGHT > 0.5, 0.5, "1", of, "dark", "given", None, doubts)


@pytest.mark.parametrize(
    ("of_eye", "of_rules", "stays"),
    [
        ((), (), "eye"),
        ((), (SHARE_DOUBT,), "eye"),
        ((SHARE_DOUBT,), (), "eye"),  # a doubt of another kind: the eye is sure
        ((UNSURE_DOUBT,), (), "rules" + NOT_SURE),
        ((UNSURE_DOUBT,), (SHARE_DOUBT,), "eye"),  # of two that are doubted
        ((SHARE_DOUBT, UNSURE_DOUBT), (), "rules" + NOT_SURE),
    ],
)
def test_which_of_two_answers_stays(
    of_eye: tuple[Doubt, ...], of_rules: tuple[Doubt, ...], stays: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_cells, "has_eye", lambda *_: True)
    monkeypatch.setattr(side_cells, "is_familiar", lambda _: True)
    monkeypatch.setattr(side_cells, "cells_by_eye", lambda *_: answer("eye", *of_eye))
    monkeypatch.setattr(side_cells, "find_cells", lambda *_: answer("rules", *of_rules))
    found = segment_side(SIDE, SegmentParameters(), "dark")
    assert found.of == stays
    assert found.doubts == (of_eye if stays == "eye" else of_rules)


@pytest.mark.parametrize(("has_eye", "familiar", "of"), [(False, True, "rules"), (True, False, "rules" + TOO_GRAINY)])
def test_an_eye_that_is_not_asked_says_nothing(
    has_eye: bool, familiar: bool, of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_cells, "has_eye", lambda *_: has_eye)
    monkeypatch.setattr(side_cells, "is_familiar", lambda _: familiar)
    monkeypatch.setattr(side_cells, "cells_by_eye", None)
    monkeypatch.setattr(side_cells, "find_cells", lambda *_: answer("rules", SHARE_DOUBT))
    found = segment_side(SIDE, SegmentParameters(), "dark")
    assert (found.of, found.doubts) == (of, (SHARE_DOUBT,))


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
