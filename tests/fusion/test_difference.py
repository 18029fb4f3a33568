"""Where two masks agree and differ."""

import numpy as np

from endoct.fusion.difference import BOTH, COLOURS, NEITHER, ONLY_A, ONLY_B, classes_of


def test_every_sample_is_of_one_class() -> None:
    a, b = np.array([[True, True, False, False]]), np.array([[True, False, True, False]])
    assert classes_of(a, b).tolist() == [[BOTH, ONLY_A, ONLY_B, NEITHER]]
    assert len(set(COLOURS)) == len(COLOURS) == 4
