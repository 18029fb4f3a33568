"""Rivals in speed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from endoct.workbench.bench.rivals import speed


def test_a_threshold_that_never_ends_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def alternating(values: np.ndarray, *, iter_callback: Callable[[float], Any]) -> float:
        while True:
            iter_callback(float(values.mean()))

    monkeypatch.setattr(speed, "threshold_li", alternating)
    with pytest.raises(RuntimeError, match="no end after 1000 rounds"):
        speed.li_by_skimage(np.arange(4, dtype=np.float32))
