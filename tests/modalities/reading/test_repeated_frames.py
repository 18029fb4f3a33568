"""Frames and files that are there twice: which, how many, and of which one; what only looks alike is none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.modalities.reading import repeated_frames
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.repeated_frames import (
    MOST_CONFIRMED,
    PLAIN,
    fingerprint,
    on_repeated,
    same_picture,
    sets_of_equal,
    without_colour,
)

RNG = np.random.default_rng(7)
FRAMES = RNG.integers(0, 256, (40, 24, 32), dtype=np.uint8)


def remarks_on(*numbers: int, frames: NDArray[Any] = FRAMES) -> Remarks:
    """Remarks on a recording of these frames."""
    return on_repeated({k: fingerprint(frames[n]) for k, n in enumerate(numbers)}, lambda k: frames[numbers[k]])


def test_copies_are_counted_and_named_after_the_first() -> None:
    (doubt,) = remarks_on(3, 1, 3, 2, 1, 3).doubts
    assert (doubt.code, doubt.value, doubt.expected) == ("frames-repeated", 3.0, 0.0)
    assert "3 frames hold the very samples of another (counted from 0: 2 as 0, 5 as 0, 4 as 1)" in doubt.what
    (one,) = remarks_on(0, 1, 1).doubts
    assert one.what.startswith("1 frame holds the very samples of another (counted from 0: 2 as 1)")
    assert remarks_on(0, 1, 2).doubts == ()


def test_the_first_is_first_in_the_recording_whatever_was_read_first() -> None:
    prints = {k: fingerprint(FRAMES[0]) for k in (5, 2, 9)}
    (doubt,) = on_repeated(prints, lambda _: FRAMES[0]).doubts
    assert "5 as 2, 9 as 2" in doubt.what


@pytest.mark.parametrize(
    ("copies", "counted"), [(MOST_CONFIRMED, MOST_CONFIRMED), (MOST_CONFIRMED + 5, MOST_CONFIRMED + 5)]
)
def test_of_many_copies_some_are_compared_and_all_are_counted(copies: int, counted: int) -> None:
    read: list[int] = []
    prints = dict.fromkeys(range(copies + 1), fingerprint(FRAMES[0]))

    def reading(index: int) -> NDArray[Any]:
        read.append(index)
        return FRAMES[0]

    (doubt,) = on_repeated(prints, reading).doubts
    assert doubt.value == counted
    assert len(read) == 2 * MOST_CONFIRMED
    assert doubt.what.count(" as ") == 4


def test_where_one_of_those_compared_differs_only_what_is_sure_counts() -> None:
    prints = dict.fromkeys(range(MOST_CONFIRMED + 6), b"alike")
    (doubt,) = on_repeated(prints, lambda k: FRAMES[1 if k == 4 else 0]).doubts
    assert doubt.value == MOST_CONFIRMED - 1
    assert on_repeated(prints, lambda k: FRAMES[k]).doubts == ()


def test_what_cannot_be_read_again_and_frames_of_one_value_repeat_nothing() -> None:
    def broken(_: int) -> NDArray[Any]:
        raise EndoctError("it is gone")

    assert on_repeated(dict.fromkeys(range(3), b"alike"), broken).doubts == ()
    black = np.zeros_like(FRAMES)
    assert fingerprint(black[0]) == PLAIN != fingerprint(FRAMES[0])
    assert remarks_on(0, 1, 2, frames=black).doubts == ()


def test_frames_are_kept_while_they_are_compared() -> None:
    """A reader may fill one array again and again."""
    room = np.empty_like(FRAMES[0])

    def read(index: int) -> NDArray[Any]:
        room[:] = FRAMES[index]
        return room

    assert on_repeated(dict.fromkeys(range(2), b"alike"), read).doubts == ()


def test_a_print_looks_at_rows_all_over() -> None:
    for row in (1, 13, 23):  # of 24 rows every second is looked at, from the second on
        other = FRAMES[0].copy()
        other[row, 5] ^= 1
        assert fingerprint(other) != fingerprint(FRAMES[0])
    for row, column in ((0, 5), (22, 5)):  # and no others, so that it takes little time
        other = FRAMES[0].copy()
        other[row, column] ^= 1
        assert fingerprint(other) == fingerprint(FRAMES[0])
    wide = RNG.integers(0, 256, (4, 3000), dtype=np.uint8)
    changed = wide.copy()
    changed[:, 2997] ^= 1  # the last of every third column
    assert fingerprint(changed) != fingerprint(wide)


def test_files_that_hold_the_same(tmp_path: Path) -> None:
    content = RNG.bytes(20_000)
    middle = bytearray(content)
    middle[10_000] ^= 1  # between the parts that are looked at first
    files = {"a": content, "b": bytes(middle), "c": content, "d": b"", "e": b"", "f": b"x", "g": b"x", "h": content[1:]}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    paths = [tmp_path / name for name in files]
    found = sets_of_equal([*paths, tmp_path / "absent", tmp_path])
    assert [[path.name for path in group] for group in found] == [["a", "c"], ["f", "g"]]


def test_of_files_of_other_sizes_nothing_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for size in (3, 4, 5):
        (tmp_path / f"{size}").write_bytes(b"a" * size)
    monkeypatch.setattr(repeated_frames, "open_regular", None)
    assert sets_of_equal([tmp_path / f"{size}" for size in (3, 4, 5)]) == []


GREY = FRAMES[0]
COLOUR = RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("image", "other", "same"),
    [
        (GREY, GREY.copy(), True),
        (GREY, GREY + 1, False),
        (GREY, GREY[1:], False),
        (GREY, np.repeat(GREY[..., None], 3, axis=2), True),
        (np.dstack([COLOUR, np.full_like(GREY, 255)]), COLOUR, True),
        (np.dstack([GREY, np.full_like(GREY, 255)]), GREY, True),
        (COLOUR, GREY, False),
        (COLOUR, COLOUR[..., ::-1], False),
        (GREY.astype(np.uint16), GREY, True),
        (GREY, GREY.astype(np.uint16) * 257, True),
        (GREY, GREY.astype(np.uint16) * 256, False),
        (GREY.astype(np.float32), GREY, True),
    ],
)
def test_pictures_are_the_same_whatever_they_are_stored_as(
    image: NDArray[Any], other: NDArray[Any], same: bool
) -> None:
    assert same_picture(image, other) is same
    assert same_picture(other, image) is same


@pytest.mark.parametrize("differs", [0, 1, 2, None])
def test_colour_is_what_three_planes_do_not_share(differs: int | None) -> None:
    image = np.repeat(GREY[..., None], 3, axis=2)
    if differs is not None:
        image[3, 4, differs] ^= 1
    grey = without_colour(image)
    assert (grey is None) is (differs is not None)
    if grey is not None:
        np.testing.assert_array_equal(grey, GREY)
