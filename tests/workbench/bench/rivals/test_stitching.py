"""Strips placed with other people's libraries."""

from dataclasses import replace

import numpy as np

from endoct.workbench.bench.rivals.stitching import opencv_ecc_prepared, phase_correlation, prepared
from endoct.workbench.bench.tasks import stitching

EASY = {
    "recipe": ("made",),
    "jitter": (0.1, 0.1),
    "roll_deg": (1.0, 1.0),
    "dropped": (0.0, 0.0),
    "pattern": (0.0, 0.0),
    "texture": (0.2, 0.2),
    "pits": (0.0, 0.0),
}


def test_a_rivals_rows_and_columns_become_feed_and_roll_of_the_right_sign() -> None:
    case = stitching.cases(4, 0, EASY)
    for method in (opencv_ecc_prepared, phase_correlation):
        assert stitching.judge(case, method(*case.given))["right"] > 0.6


def test_what_is_not_valid_is_prepared_as_nothing() -> None:
    strips, _ = stitching.cases(4, 0, EASY).given
    shown = np.ones(strips[0].valid.shape, np.bool_)
    shown[:5] = shown[:, 100:130] = False
    spoilt = [np.where(shown, strip.intensity, np.float32(strip.intensity.max())) for strip in strips]
    dark = [replace(strip, valid=shown, intensity=intensity) for strip, intensity in zip(strips, spoilt, strict=True)]
    prepared_dark = prepared(dark)
    assert not prepared_dark[:, ~shown].any()
    assert np.abs(prepared_dark - prepared(strips))[:, shown].max() < 0.2
