"""What a survey keeps of a frame is little, and on disk where frames are many."""

import gc
import os
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import cv2
import pytest

from endoct.base.compute import memory
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope import flatfield, motion
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.survey import survey_frames
from endoct.modalities.recognition import open_recording
from endoct.stitching.motion import matching
from endoct.stitching.motion.feed import Feed, estimate_feed


class Again:
    """A recording that shows the first frames of another, made small, forth and back."""

    def __init__(self, recording: Path, n: int) -> None:
        _, stream = open_recording(recording, modality="endoscope")
        self.acquisition, self.n = stream.acquisition, n
        self.frames = [
            cv2.resize(stream[k].samples, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for k in range(6)
        ]

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, index: int) -> Frame:
        period = 2 * (len(self.frames) - 1)
        return Frame(index, self.frames[min(index % period, period - index % period)], 0.2 * index)


def kept_and_peak(stream: Again, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """Bytes that a survey holds once all frames have been looked at, and the most that measuring the feed needs."""
    traced: list[int] = []

    def measured(*arguments: Any, **options: Any) -> Feed:
        gc.collect()  # what nobody holds any more is no part of it
        traced.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.reset_peak()  # what the flat field needs before and after does not grow with frames
        feed = estimate_feed(*arguments, **options)
        traced.append(tracemalloc.get_traced_memory()[1])
        return feed

    with monkeypatch.context() as patch:
        patch.setattr(motion, "estimate_feed", measured)
        tracemalloc.start()
        try:
            survey_frames(stream, EndoscopeParameters())
        finally:
            tracemalloc.stop()
    held, peak = traced
    return held, peak


def test_memory_hardly_grows_with_frames(quick_specimen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame more costs less than a few thousand bytes; its strip alone is more than 60 kB, twice that as floats."""
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(matching, "AT_A_TIME", 1)
    monkeypatch.setattr(flatfield, "MOST_FRAMES", 6)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # how many frames are worked on at once is no matter here
    few, many = (kept_and_peak(Again(quick_specimen / "endoscope", n), monkeypatch) for n in (12, 36))
    held, most = ((more - less) / 24 for less, more in zip(few, many, strict=True))
    assert held < 2500
    assert most < 20_000  # a frame more or less in the hands of a thread when the peak comes counts as well


def test_a_survey_by_way_of_the_disk_is_the_same(quick_specimen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last byte."""
    stream = Again(quick_specimen / "endoscope", 11)
    in_memory = survey_frames(stream, EndoscopeParameters())
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(matching, "AT_A_TIME", 1)
    assert pickle.dumps(survey_frames(stream, EndoscopeParameters())) == pickle.dumps(in_memory)
