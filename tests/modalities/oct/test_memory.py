"""What a survey keeps of a slice is little, and on disk where slices are many."""

import pickle
import tempfile
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tolerances import COORDINATE_ATOL

from endoct.modalities.contract import Frame
from endoct.modalities.oct import survey
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning import start_chain
from endoct.stitching import kept
from endoct.stitching.errors import EndoctError
from endoct.stitching.kept import Computed, Kept
from tests.modalities.oct.conftest import Phantom

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


def kept_and_peak(n: int, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """Bytes that a survey of ``n`` slices holds once all have been looked at, and the most it needs from then on."""
    held = []

    def located(*arguments: Any) -> Any:
        held.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.reset_peak()  # what is judged before, some 4000 A-scans of all, does not grow with their number
        return locate_faces(*arguments)

    locate_faces = survey.locate_faces
    stream = Again(n)
    with monkeypatch.context() as patch:
        patch.setattr(survey, "locate_faces", located)
        tracemalloc.start()
        try:
            survey.survey_pullback(stream, PARAMETERS)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    return held[0], peak


def test_memory_hardly_grows_with_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slice more costs less than a few thousand bytes; its 96 A-scans alone are 130 kB."""
    monkeypatch.setattr(kept, "MOST_IN_MEMORY", 1)
    few, many = (kept_and_peak(n, monkeypatch) for n in (12, 36))
    held, most = ((more - less) / 24 for less, more in zip(few, many, strict=True))
    assert held < 1000
    assert most < 25_000  # a slice more or less in the hands of a thread when the peak comes is a good 5 000


def test_a_survey_by_way_of_the_disk_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last byte."""
    in_memory = survey.survey_pullback(Again(12), PARAMETERS)
    monkeypatch.setattr(kept, "MOST_IN_MEMORY", 1)
    assert pickle.dumps(survey.survey_pullback(Again(12), PARAMETERS)) == pickle.dumps(in_memory)


@pytest.mark.parametrize("most_in_memory", [1, 2**20])
def test_what_is_kept_comes_back(most_in_memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST_IN_MEMORY", most_in_memory)
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
    monkeypatch.setattr(kept, "MOST_IN_MEMORY", 1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Kept[bytes]() as items:
        items.append(bytes(10_000))
        assert not list(tmp_path.iterdir())  # so that nothing can, whatever ends the process


def test_a_disk_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST_IN_MEMORY", 1)
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


def by_matrix(moved: np.ndarray, sigma: np.ndarray, usual: float, creep: float) -> tuple[np.ndarray, np.ndarray]:
    """The least squares for starts as they are written down: all unknowns, the mark's directions too, by all rows."""
    n, seen = moved.size, np.flatnonzero(np.isfinite(sigma))
    creeping = (np.eye(n, k=1) - np.eye(n)) / creep
    creeping[-1] = start_chain.MEAN_WEIGHT / n
    sights = (np.eye(n)[seen], -np.eye(n)[seen])  # a mark is seen at its direction less the start
    matrix = np.block([[np.zeros((n, n)), creeping], [np.eye(n) / usual, np.zeros((n, n))]])
    matrix = np.vstack([matrix, np.hstack(sights[::-1]) / sigma[seen, None]])
    values = np.concatenate([np.zeros(2 * n), moved[seen] / sigma[seen]])
    weight = np.ones(values.size)
    for _ in range(start_chain.ROBUST_STEPS):
        weighted = matrix * weight[:, None]
        covariance = np.linalg.inv(weighted.T @ weighted)
        solution = covariance @ (weighted.T @ (weight * values))
        weight[n:] = 1 / np.sqrt(1 + ((matrix @ solution - values)[n:] / 2) ** 2)
    return solution[:n], np.sqrt(np.diag(covariance)[:n])


@pytest.mark.parametrize("n", [2, 3, 120])
def test_starts_are_those_of_least_squares_over_everything(n: int) -> None:
    rng = np.random.default_rng(3)
    seen = (rng.random(n) < 0.9) | (np.arange(n) < 2)
    moved = np.where(seen, 0.005 * rng.normal(size=n) + np.cumsum(0.0017 * rng.normal(size=n)), 0.0)
    moved[np.flatnonzero(seen)[n // 6]] += 0.2
    sigma = np.where(seen, rng.uniform(0.001, 0.004, n), np.inf)
    for found, expected in zip(
        start_chain.separated(moved, sigma, 0.005, 0.0017), by_matrix(moved, sigma, 0.005, 0.0017), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=COORDINATE_ATOL)
