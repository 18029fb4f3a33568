"""The gate's figures, by hand."""

import json
import math

import pytest

from benchmarks.gate.__main__ import RECORD
from benchmarks.gate.figures import compared, figures_of, lost, may_lose
from benchmarks.gate.worlds import WORLDS

CASES = [
    {"jaccard_oct": 0.9, "wrong_oct": 0.01, "aligned": 1.0, "doubted": 0.0, "silent": 0.0, "error_z_sigmas": -3.0},
    {"jaccard_oct": 0.8, "wrong_oct": 0.02, "aligned": 1.0, "doubted": 1.0, "silent": 0.0, "error_z_sigmas": 1.0},
    {"jaccard_oct": math.nan, "aligned": 0.0, "doubted": 0.0, "silent": 0.0},
]


def test_cases_become_medians_worst_cases_counts_and_coverage():
    figures = figures_of("few", CASES)
    assert figures == pytest.approx(
        {
            "jaccard_oct median": 0.85,
            "jaccard_oct worst": 0.8,
            "wrong_oct median": 0.015,
            "wrong_oct worst": 0.02,
            "aligned": 2,
            "doubted": 1,
            "silent": 0,
            "error_z_sigmas within 2": 0.5,
            "error_z_sigmas rms": math.sqrt(5),
        }
    )


def test_of_faulty_recordings_only_counts_what_was_believed():
    cases = [{"jaccard_oct": 0.2, "believed": 1.0, "doubted": 0.0}, {"believed": 0.0, "doubted": 1.0, "crashed": 0.0}]
    assert figures_of("broken", cases) == {"believed": 1, "crashed": 0}


@pytest.mark.parametrize(
    ("figure", "recorded", "now", "worse"),
    [
        ("jaccard_oct median", 0.9, 0.891, False),
        ("jaccard_oct median", 0.9, 0.889, True),
        ("jaccard_oct worst", 0.8, 0.9, False),
        ("wrong_oct worst", 0.01, 0.03, True),
        ("silent", 0, 1, True),
        ("doubted", 1, 2, False),
        ("doubted", 1, 3, True),
        ("error_z_sigmas within 2", 1.0, 0.85, True),
        ("error_z_sigmas rms", 1.0, 2.0, False),
        ("told", 4, 3, True),
    ],
)
def test_what_got_worse_by_more_than_it_may_fails(figure: str, recorded: float, now: float, worse: bool):
    ((line, found),) = compared("few", {figure: now}, {figure: recorded})
    assert found == worse
    assert ("WORSE" in line) == worse


def test_a_figure_that_nothing_came_of_is_worse_and_one_that_did_not_move_is_silent():
    assert [worse for _, worse in compared("few", {}, {"jaccard_oct worst": 0.8})] == [True]
    assert list(compared("few", {"jaccard_oct worst": 0.801}, {"jaccard_oct worst": 0.8})) == []


def test_the_record_has_all_worlds_and_nothing_else():
    record = json.loads(RECORD.read_text("utf-8"))
    assert set(record) == {world.name for world in WORLDS}
    for figures in record.values():
        for figure, value in figures.items():
            allowed = may_lose(figure)
            assert allowed is None or lost(figure, value, value) == 0
