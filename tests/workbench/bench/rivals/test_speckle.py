"""Turns measured by the speckle of bone."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from endoct.modalities.recognition import open_recording
from endoct.workbench.bench.rivals import ascans, speckle
from endoct.workbench.bench.rivals.turned import stated_errors_rad, unrolled_as_turned
from endoct.workbench.bench.task import Case, Declined
from endoct.workbench.bench.tasks import oct as oct_task
from endoct.workbench.pipeline.truth import Truth

UNEVEN = {
    "off_axis": (0.3, 0.3),
    "start": ("triggered",),
    "rotation_error_deg": (8.0, 8.0),
    "turn_jitter": (0.01, 0.01),
}


@pytest.fixture(scope="module")
def case() -> Iterator[Case[Path, Truth]]:
    """A pullback whose turns are most uneven, in bright bone."""
    made = oct_task.cases(1, 0, {**oct_task.RANGES, **UNEVEN})
    yield made
    assert made.scratch is not None
    made.scratch.cleanup()


def shape_error_deg(errors_rad: np.ndarray, truth: Truth) -> float:
    n = errors_rad.shape[1]
    turn = 2 * np.pi * np.arange(n) / n
    true = np.array([oct_task._true_error_rad(truth.recording["oct"], i, turn) for i in range(len(errors_rad))])
    left = true - errors_rad
    return float(np.rad2deg(np.sqrt(np.mean((left - left.mean(axis=1, keepdims=True)) ** 2))))


def test_speckle_says_how_the_catheter_turned(case: Case[Path, Truth]) -> None:
    base, (_, stream) = oct_task.even(case.given), open_recording(case.given)
    errors = speckle.speckle_errors_rad(stream, base)
    assert shape_error_deg(errors, case.truth) < 0.65 * shape_error_deg(np.zeros_like(errors), case.truth)
    np.testing.assert_array_equal(errors, speckle.speckle_errors_rad(stream, base))
    panorama = unrolled_as_turned(case.given, lambda _: errors)
    stated = oct_task.beam_errors_rad(panorama, case.truth)
    stated -= stated.mean(axis=1, keepdims=True)
    assert np.rad2deg(np.sqrt(np.mean(stated**2))) == pytest.approx(shape_error_deg(errors, case.truth), rel=0.05)


def test_face_and_speckle_together_are_near_what_the_face_says_where_it_shows(case: Case[Path, Truth]) -> None:
    answers = oct_task.ours(case.given), speckle.face_and_speckle(case.given)
    by_face, by_both = (shape_error_deg(stated_errors_rad(each, 512)[0], case.truth) for each in answers)
    assert by_both < by_face + 0.4


def test_slices_warped_onto_each_other_hold_what_differs_between_them(case: Case[Path, Truth]) -> None:
    _, stream = open_recording(case.given)
    errors = ascans.warped_errors_rad(stream)
    assert errors.shape == (len(stream), 512)
    assert not errors[0].any()
    assert shape_error_deg(errors, case.truth) < 1.05 * shape_error_deg(np.zeros_like(errors), case.truth)
    np.testing.assert_array_equal(errors, ascans.warped_errors_rad(stream))


def test_without_speckle_it_declines(case: Case[Path, Truth], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speckle, "LEVELS_DB", (200.0,))  # no bone is so bright
    with pytest.raises(Declined, match="no bone shows speckle"):
        speckle.speckle_errors_rad(open_recording(case.given)[1], oct_task.even(case.given))
    by_both = stated_errors_rad(speckle.face_and_speckle(case.given), 512)[0]
    by_face = stated_errors_rad(oct_task.ours(case.given), 512)[0]
    np.testing.assert_allclose(by_both, by_face, atol=0.01)
