"""Panoramas aligned by learned matchers, whose weights the user names."""

from pathlib import Path

import numpy as np
import pytest
import torch
from kornia.feature import LoFTR

from endoct.base.errors import EndoctError
from endoct.workbench.bench.rivals import learned_alignment as learned
from endoct.workbench.bench.rivals.alignment import Flat
from endoct.workbench.bench.task import NotInstalled
from endoct.workbench.bench.tasks.alignment import AlignmentCase


def test_without_weights_a_matcher_is_left_out(easy: AlignmentCase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(learned.LOFTR_WEIGHTS, raising=False)
    with pytest.raises(NotInstalled, match=f"weights is not installed; set {learned.LOFTR_WEIGHTS}"):
        learned.loftr(*easy.given)


def test_a_file_that_holds_no_weights_is_told(
    easy: AlignmentCase, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "weights.pth").write_bytes(b"none")
    monkeypatch.setenv(learned.LOFTR_WEIGHTS, str(tmp_path / "weights.pth"))
    with pytest.raises(EndoctError, match="cannot be read"):
        learned.loftr(*easy.given)
    torch.save({"state_dict": {"layer": torch.zeros(1)}}, tmp_path / "weights.pth")
    with pytest.raises(EndoctError, match="weights of another network"):
        learned.loftr(*easy.given)


def test_weights_are_loaded_from_the_file_that_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    torch.manual_seed(0)
    torch.save({"state_dict": LoFTR(pretrained=None).state_dict()}, tmp_path / "weights.pth")
    monkeypatch.setenv(learned.LOFTR_WEIGHTS, str(tmp_path / "weights.pth"))
    assert learned._loaded(LoFTR(pretrained=None), learned._weights()).training is False


def test_matches_become_the_similarity_that_most_agree_on() -> None:
    random = np.random.default_rng(0)
    from_b = random.uniform(0, 100, (50, 2))
    to_a = 1.1 * from_b + [20, 5]
    to_a[:15] = random.uniform(0, 100, (15, 2))
    flat = Flat(np.zeros((8, 16), np.float32), np.ones((8, 8), np.float32), 0.01, (0.0, 0.0), 1.0, (False, False))
    matrices = list(learned.by_matches(lambda there: lambda here: (from_b, to_a))(flat))
    assert len(matrices) == 2  # one for each polarity
    np.testing.assert_allclose(matrices[0], [[1.1, 0, 20], [0, 1.1, 5]], atol=1e-3)
    assert len(list(learned.by_matches(lambda there: lambda here: (from_b[20:24], to_a[20:24]))(flat))) == 2
    assert not list(learned.by_matches(lambda there: lambda here: (from_b[:3], to_a[:3]))(flat))
