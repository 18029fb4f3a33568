"""Slices of raw spectra: which A-scans of which file are theirs, by the numbers that these hold."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.oct.spectra.keys import SpectraKeys
from endoct.modalities.oct.spectra.slices import Slices, find_slices, read_ascans

N = 96


def numbered(path: Path, n_ascans: int, first: int = 0) -> Path:
    """A file whose A-scan k has the samples k, from ``first`` on."""
    np.repeat(np.arange(first, first + n_ascans, dtype="<u2"), N).tofile(path)
    return path


def keys(**given: Any) -> SpectraKeys:
    return SpectraKeys.model_validate({"file": "a.bin", "samples": N, "ascans": 64, "chirp": "even", **given})


def starts(slices: Slices, of: SpectraKeys) -> list[list[int]]:
    """The first and last A-scan of each slice, by what is in it, and how many there are."""
    counts = [slices.counts(k, of)[:, 0].tolist() for k in range(len(slices))]
    return [[each[0], each[-1], len(each)] for each in counts]


def test_slices_follow_each_other_in_a_file(tmp_path: Path) -> None:
    numbered(tmp_path / "a.bin", 192)
    found = find_slices(tmp_path, keys(), None)  # type: ignore[arg-type]
    assert (found.ascans, found.files) == (64, (tmp_path / "a.bin",))
    assert starts(found, keys()) == [[0, 63, 64], [64, 127, 64], [128, 191, 64]]
    assert len(find_slices(tmp_path, keys(slices=2), None)) == 2  # type: ignore[arg-type]
    assert starts(find_slices(tmp_path / "a.bin", keys(), None), keys())[1] == [64, 127, 64]  # type: ignore[arg-type]


def test_of_a_file_a_stop_the_first_turn_is_a_slice(tmp_path: Path) -> None:
    for k in (1, 2, 10):
        numbered(tmp_path / f"stop_{k}.bin", 70, first=1000 * k)
    of = keys(file="stop_*.bin")
    found = find_slices(tmp_path, of, None)  # type: ignore[arg-type]
    assert starts(found, of) == [[1000, 1063, 64], [2000, 2063, 64], [10_000, 10_063, 64]]
    assert [file.name for file in find_slices(tmp_path, keys(file="stop_*.bin", slices=2), None).files] == [  # type: ignore[arg-type]
        "stop_1.bin", "stop_2.bin",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("n_ascans", "given", "said"),
    [
        (130, {}, "130 A-scans, 2 more than 2 slices of 64"),
        (63, {}, "63 A-scans, 63 more than 0 slices"),
        (192, {"slices": 4}, "found 3 of 64 A-scans; expected 4"),
        (0, {}, "found 0 bytes; expected a multiple of 192"),
        (192, {"file": "b_*.bin"}, "found 0 named like b_*.bin; expected one or more"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path: Path, n_ascans: int, given: dict[str, Any], said: str) -> None:
    numbered(tmp_path / "a.bin", n_ascans)
    with pytest.raises(EndoctError) as raised:
        find_slices(tmp_path, keys(**given), None)  # type: ignore[arg-type]
    assert said in str(raised.value)


def test_a_turn_of_another_length_gives_the_same_number_of_ascans_at_even_steps(tmp_path: Path) -> None:
    """Of 6.4 A-scans from 2.0 on, 4 are taken in the middle of their steps of 1.6; and 8 of 4, each twice."""
    file = numbered(tmp_path / "a.bin", 40)
    slices = Slices((file,), np.zeros(3, np.intp), np.array([2.0, 10.0, 20.0]), np.array([6.4, 4.0, 8.0]), 4)
    of = keys()
    assert slices.counts(0, of)[:, 0].tolist() == [2, 4, 6, 7]
    assert slices.counts(1, of)[:, 0].tolist() == [10, 11, 12, 13]
    assert slices.counts(2, of)[:, 5].tolist() == [21, 23, 25, 27]
    assert slices.counts(1, of).dtype == np.uint16
    twice = Slices((file,), np.zeros(1, np.intp), np.array([30.0]), np.array([4.0]), 8)
    assert twice.counts(0, of)[:, 0].tolist() == [30, 30, 31, 31, 32, 32, 33, 33]
    beyond = Slices((file,), np.zeros(1, np.intp), np.array([38.0]), np.array([4.0]), 4)
    with pytest.raises(EndoctError, match="is truncated; found slice 0 incomplete"):
        beyond.counts(0, of)


def test_parts_are_read_from_where_they_lie(tmp_path: Path) -> None:
    parts = [(3, np.empty((2, N), "<u2")), (0, np.empty((1, N), "<u2")), (39, np.empty((1, N), "<u2"))]
    read_ascans(numbered(tmp_path / "a.bin", 40), parts, "")
    assert [counts[:, 0].tolist() for _, counts in parts] == [[3, 4], [0], [39]]
