"""A long list of items, on disk where it is large."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.compute import memory
from endoct.base.compute.memory import Computed, Kept
from endoct.base.errors import EndoctError


@pytest.mark.parametrize("most_in_memory", [1, 2**20])
def test_what_is_kept_comes_back(most_in_memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", most_in_memory)
    with Kept[Any]() as items:
        for k in range(5):
            items.append((k, np.full(100 * k, k, np.float32)))
            assert items[0][0] == 0  # reading between does not harm what follows
        assert len(items) == 5
        assert [(k, values.size, set(values)) for k, values in items] == [
            (k, 100 * k, {k} if k else set()) for k in range(5)
        ]
        assert [items[k][0] for k in (3, 1, -1)] == [3, 1, 4]


def test_nothing_stays_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Kept[bytes]() as items:
        items.append(bytes(10_000))
        assert not list(tmp_path.iterdir())  # so that nothing can, whatever ends the process


def test_a_disk_that_cannot_be_written_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(EndoctError, match=r"temporary file .* TMPDIR"), Kept[bytes]() as items:
        items.append(bytes(10_000))


def test_computed_items_are_a_sequence() -> None:
    squares = Computed(5, lambda k: k * k)
    assert list(squares) == [0, 1, 4, 9, 16]
    assert squares[-1] == 16
    assert list(squares[1:4:2]) == [1, 9]
    with pytest.raises(IndexError):
        squares[5]
