"""What a comparison of a side with the CT keeps of the doubts about either."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from bore_pairs import make_pair

from endoct.base.doubt import Doubt
from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.parameters import CompareParameters
from endoct.workbench.posing import prediction
from endoct.workbench.posing.prediction import MODALITY, compare_with


def test_what_lies_out_of_place_against_the_ct_is_said_and_its_lost_frames_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = make_pair()
    compared = compare_panoramas(pair.a, pair.b, CompareParameters(n_theta=128))
    kept = [Doubt(code, "w", side=MODALITY) for code in ("parts-out-of-place", "step-along-the-bore")]
    kept.append(Doubt("frames-lost", "w", side="camera"))
    given = (*kept, Doubt("frames-lost", "w", side=MODALITY))
    compared = replace(compared, result=compared.result.model_copy(update={"doubts": given}))
    monkeypatch.setattr(prediction, "segment_side", lambda *_: None)
    monkeypatch.setattr(prediction, "compare_placed", lambda *_: compared)
    pose = SimpleNamespace(names=("camera",), fit=SimpleNamespace(agreement=(0.5,)))
    side = SimpleNamespace(side=SimpleNamespace(name="camera"), cells=None)
    said = compare_with(pair.b, pose, side)  # type: ignore[arg-type]
    assert said is not None
    assert list(said.result.doubts) == kept
