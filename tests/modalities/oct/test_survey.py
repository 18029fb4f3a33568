"""What a survey refuses, and how little it keeps of a slice: on disk where slices are many."""

import gc
import os
import pickle
import tracemalloc
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from endoct.base.compute import memory
from endoct.base.errors import EndoctError
from endoct.modalities.contract import Frame
from endoct.modalities.oct import survey
from endoct.modalities.oct.face.faces import Faces, locate_faces
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface import levels
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom

PHANTOM = Phantom(n_slices=4, n_ascans=128)
PARAMETERS = OctParameters(ransac_trials=100)


class Again:
    """A pullback that shows the slices of one phantom over and over, forth and back."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.acquisition = PHANTOM.acquisition()
        self.pages = PHANTOM.log_counts()
        self.pages.flags.writeable = False

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, index: int) -> Frame:
        period = 2 * (len(self.pages) - 1)
        page = self.pages[min(index % period, period - index % period)]
        return Frame(index, page.T, 0.2 * index)


class Enough(Exception):
    """Ends a survey once all slices have been looked at."""


def kept_and_peak(n: int, monkeypatch: pytest.MonkeyPatch, *, whole: bool = True) -> tuple[int, int]:
    """Bytes that a survey of ``n`` slices holds once all have been looked at, and the most it needs from then on."""
    held = []

    def located(*arguments: Any) -> Faces:
        gc.collect()  # what earlier tests left for the collector is not this survey's
        held.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.reset_peak()
        if not whole:
            raise Enough
        return locate_faces(*arguments)

    stream = Again(n)
    with monkeypatch.context() as patch:
        patch.setattr(survey, "locate_faces", located)
        tracemalloc.start()
        try:
            with suppress(Enough):
                survey.survey_pullback(stream, PARAMETERS)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    return held[0], peak


def test_memory_hardly_grows_with_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slice more costs less than a few thousand bytes; its 96 A-scans alone are 130 kB.

    One thread looks at the slices: how many are under way must not depend on the processors of the machine. What
    libraries and the interpreter keep at times differs by some 5 kB from survey to survey, however long it is. So what
    is held, 600 bytes a slice, is measured over 48 slices: then that is 100 bytes a slice.
    """
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(levels, "POOLED_SLICES", 4)  # beyond so many, the A-scans judged together do not grow
    kept_and_peak(4, monkeypatch)  # what libraries cache at the first call is no slice's
    few, many = (kept_and_peak(n, monkeypatch, whole=False)[0] for n in (12, 60))
    assert many - few < 48 * 1000
    less, more = (kept_and_peak(n, monkeypatch)[1] for n in (12, 36))
    assert more - less < 24 * 25_000  # the two threads that go on may hold a slice more when the peak comes: 24 · 5 000


def test_a_survey_by_way_of_the_disk_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last byte."""
    in_memory = survey.survey_pullback(Again(12), PARAMETERS)
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    assert pickle.dumps(survey.survey_pullback(Again(12), PARAMETERS)) == pickle.dumps(in_memory)


@pytest.mark.parametrize(
    ("pages", "message"),
    [
        (np.zeros((3, 340, 720), np.uint8), "shows nothing"),
        (np.full((3, 340, 720), 255, np.uint8), "shows nothing"),
        (np.where(np.random.default_rng(0).random((3, 340, 720)) < 0.8, 255, 90).astype(np.uint8), "saturated"),
        (np.random.default_rng(0).integers(0, 255, (3, 340, 720)).astype(np.uint8), "outer face cannot be found"),
    ],
)
def test_recordings_of_nothing(unrolled: UnrollPhantom, pages: NDArray[Any], message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        unrolled(Phantom(), pages)
