"""Strips placed with other people's libraries."""

from endoct.workbench.bench.rivals.stitching import opencv_ecc_prepared, phase_correlation
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
