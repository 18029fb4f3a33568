"""Frames that are kept: each is read once, whoever asks first, and comes back as what is needed of it."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from endoct.base.compute.parallel import thread_map
from endoct.modalities.frame_cache import kept_frames


class Stream:
    """Frames that note when they are read."""

    acquisition = SimpleNamespace(modality="oct")

    def __init__(self) -> None:
        self.read: list[int] = []

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int) -> Any:
        self.read.append(index)
        return np.full((2, 2), index)


def test_each_frame_is_read_once_and_is_its_own() -> None:
    stream = Stream()
    with kept_frames(stream, lambda frame: 10 * frame) as kept:  # type: ignore[arg-type, operator, return-value]
        assert len(kept) == 6
        assert kept.acquisition is stream.acquisition
        for order in ((4, 0, 5), (0, 4, 1), range(6)):
            assert [int(kept[k][0, 0]) for k in order] == [10 * k for k in order]  # type: ignore[index]
        assert sorted(stream.read) == list(range(6))
        assert [int(frame[0, 0]) for frame in thread_map(lambda k: kept[k], range(6))] == [0, 10, 20, 30, 40, 50]  # type: ignore[index]
        assert len(stream.read) == 6
