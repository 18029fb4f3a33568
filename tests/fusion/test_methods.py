"""Methods of segmentation and alignment by name: ranked on the bench, chosen in a comparison, a stranger's as well."""

import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from bore_pairs import Pair

from endoct.base import entry_points
from endoct.base.errors import EndoctError
from endoct.fusion import comparison
from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.fusion.registration.align import RoughAlignment
from endoct.fusion.segmentation.side_cells import segment_sides
from endoct.stitching.panorama import Panorama

COARSE = CompareParameters(n_theta=512)
Register = Callable[[str, Callable[..., object]], CompareParameters]


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Register:
    """Register a function as somebody's method of a task; returns the parameters that choose it."""

    def of(task: str, function: Callable[..., object]) -> CompareParameters:
        module = ModuleType("somebodys_methods")
        module.function = function  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "somebodys_methods", module)
        entry = EntryPoint("theirs", "somebodys_methods:function", f"endoct.bench.{task}")
        monkeypatch.setattr(entry_points, "entry_points", lambda *, group: EntryPoints([entry]).select(group=group))
        return COARSE.model_copy(update={f"{task}_method": "theirs"})

    return of


def test_a_strangers_cells_are_scored_and_doubted(pair: Pair, register: Register) -> None:
    def front_rows(panorama: Panorama) -> np.ndarray:
        cells = np.zeros(panorama.grid.shape, np.bool_)
        cells[:, :5] = cells[:, -5:] = True  # over the seam
        return cells

    unseen = pair.a.valid.copy()
    unseen[:, :2] = False
    seen_in_part = replace(pair.a, valid=unseen)
    compared = compare_panoramas(seen_in_part, pair.b, register("segmentation", front_rows))
    for side in compared.sides:
        assert side.mask.any()
        assert not (side.mask & ~side.valid).any()
    assert compared.result.threshold["ranger"].value is None
    assert compared.result.threshold["ranger"].of == "cells by the method 'theirs'"
    assert [d.side for d in compared.result.doubts if d.code == "cells-by-method"] == ["camera", "ranger"]


def test_a_strangers_place_is_used_and_held_against_our_own(pair: Pair, register: Register) -> None:
    true = pair.truth
    there = Alignment(true.theta_shift_rad + 0.1, true.z_shift_mm, true.z_scale, true.mirrored, true.z_reversed)
    compared = compare_panoramas(pair.a, pair.b, register("alignment", lambda a, b: there))
    assert compared.alignment is not None
    assert compared.alignment.theta_shift_rad == there.theta_shift_rad
    assert 0 < abs(compared.alignment.correlation) < 1
    doubt = next(d for d in compared.result.doubts if d.code == "aligned-by-method")
    assert doubt.value == pytest.approx(0.1 * pair.a.grid.radius_mm, abs=0.03)


def test_a_stranger_may_decline(pair: Pair, register: Register) -> None:
    compared = compare_panoramas(pair.a, pair.b, register("alignment", lambda a, b: NotAligned("No idea.")))
    assert compared.alignment is None
    assert compared.result.reason == "No idea."


def _fails(*_: object) -> object:
    raise RuntimeError("out of\nideas")


@pytest.mark.parametrize(
    ("task", "answer", "message"),
    [
        ("segmentation", lambda p: np.zeros((2, 2), np.bool_), "answers no mask; found bool"),
        ("segmentation", lambda p: p.intensity, "answers no mask; found float32"),
        ("segmentation", _fails, "gives no answer; found RuntimeError"),
        ("alignment", lambda a, b: (0, 0), "answers no alignment; found tuple"),
        ("alignment", lambda a, b: Alignment(float("nan"), 0.0), "answers no alignment; found <Alignment"),
        ("alignment", _fails, "leave alignment_method out"),
    ],
)
def test_a_wrong_answer_is_one_line(
    pair: Pair, register: Register, task: str, answer: Callable[..., object], message: str
) -> None:
    with pytest.raises(EndoctError, match=message) as caught:
        compare_panoramas(pair.a, pair.b, register(task, answer))
    assert "\n" not in str(caught.value)


def test_a_misspelt_method_suggests_the_nearest(pair: Pair) -> None:
    with pytest.raises(EndoctError, match="unknown segmentation method: 'otsu-prepard'; expected 'otsu-prepared'"):
        compare_panoramas(pair.a, pair.b, COARSE.model_copy(update={"segmentation_method": "otsu-prepard"}))


def test_methods_of_the_bench_can_be_chosen(pair: Pair) -> None:
    by_otsu = compare_panoramas(pair.a, pair.b, COARSE.model_copy(update={"segmentation_method": "otsu-prepared"}))
    assert by_otsu.result.jaccard is not None
    assert by_otsu.result.jaccard > 0.7
    lost = compare_panoramas(pair.a, pair.b, COARSE.model_copy(update={"alignment_method": "phase-correlation"}))
    doubt = next(d for d in lost.result.doubts if d.code == "aligned-by-method")  # it knows no scale and no circle
    assert lost.alignment is None or "away" in doubt.what or "other way around" in doubt.what


def test_a_method_that_aligns_is_asked_once(pair: Pair, register: Register) -> None:
    asked = []

    def theirs(a: Panorama, b: Panorama) -> Alignment:
        asked.append((a, b))
        return pair.truth

    compared = compare_panoramas(pair.a, pair.b, register("alignment", theirs))
    assert compared.alignment is not None
    assert len(asked) == 1


def test_whether_cells_are_dark_is_told_by_the_place_that_counts(
    pair: Pair, register: Register, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = replace(pair.truth, z_shift_mm=pair.truth.z_shift_mm + 0.1, correlation=-0.5)
    told_by = []

    def segmented(a: Side, b: Side, alignment: Alignment | None, *rest: Any) -> Any:
        told_by.append(alignment)
        return segment_sides(a, b, alignment, *rest)

    monkeypatch.setattr(comparison, "segment_sides", segmented)
    monkeypatch.setattr(comparison, "find_sides", lambda *_, **__: RoughAlignment(None, best))
    theirs = register("alignment", lambda *_: pair.truth)
    for parameters in (COARSE, COARSE.model_copy(update={"force": True}), theirs):
        compare_panoramas(pair.a, pair.b, parameters)
    assert told_by[:2] == [None, best]
    assert told_by[2].z_shift_mm == pair.truth.z_shift_mm
