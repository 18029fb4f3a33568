"""Which of two answers stays, the eye's or the threshold's, and why: each put in by hand."""

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
    return Segmentation(np.zeros(SHAPE, np.bool_), 0.5, "1", of, "dark", "given", None, doubts)


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
