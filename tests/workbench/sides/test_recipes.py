"""One word for the settings of a whole chain."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.workbench import compare, unroll
from endoct.workbench.sides.recipes import check_made_by, with_recipe

OF_OCT = {
    "undistort": "sine",
    "wall": "maximum",
    "correct_rotation": False,
    "correct_turn_length": False,
    "correct_start_angle": False,
    "correct_lost_ascans": False,
}
OF_COMPARISON = {"eye": "off", "outlines": False, "by_depth": False, "contrast_floor_sigmas": 0, "contrast_cap": 50}
QUICKLY = {"n_theta": 512, "force": True}


def test_the_papers_recipe_is_the_settings_it_stands_for(short: Path) -> None:
    sides: Any = (short / "endoscope", short / "oct")
    flat = {"parallax": False}
    by_word = compare(*sides, recipe="paper", settings=QUICKLY, settings_a=flat, progress=False)
    by_settings = compare(*sides, settings=OF_COMPARISON | QUICKLY, settings_a=flat, settings_b=OF_OCT, progress=False)
    one, other = (each.result.to_json() for each in (by_word, by_settings))
    assert {**one, "seconds": {}, "asked": {}} == {**other, "seconds": {}, "asked": {}}
    for side, same in zip(by_word.sides, by_settings.sides, strict=True):
        for name in ("mask", "valid", "intensity", "depth_mm"):
            assert np.array_equal(getattr(side, name), getattr(same, name), equal_nan=True)
    used = by_word.result.parameters
    assert OF_OCT.items() <= used["oct"].items()
    assert (OF_COMPARISON | QUICKLY).items() <= used["compare"].items()
    # Li's threshold is all there is, so both indices are one
    assert by_word.result.by_li.grid == by_word.result.scores.grid
    assert by_word.result.by_li.own_rows == by_word.result.scores.own_rows


def test_what_is_set_wins_over_a_recipe(short: Path) -> None:
    assert with_recipe(None, "oct", {"wall": "edge"}) == {"wall": "edge"}
    assert with_recipe("paper", "oct", {"wall": "edge", "seed": 3}) == {**OF_OCT, "wall": "edge", "seed": 3}
    assert with_recipe("paper", "endoscope", {}) == {}
    wall = unroll(short / "oct", recipe="paper", settings={"wall": "edge", "n_theta": 512}, progress=False)
    assert wall.provenance["parameters"] | OF_OCT | {"wall": "edge"} == wall.provenance["parameters"]
    # such a panorama is no longer by the recipe
    with pytest.raises(EndoctError, match=r"not made by the recipe 'paper'; found wall=edge;") as told:
        compare(short / "endoscope", wall, recipe="paper", progress=False)
    assert "\n" not in str(told.value)
    made = replace(wall, provenance={**wall.provenance, "parameters": OF_OCT})
    check_made_by("paper", made)
    check_made_by(None, wall)
    for unknown in ({}, {"parameters": None}, {"parameters": ["wall"]}):
        with pytest.raises(EndoctError, match="undistort=not known, wall=not known"):
            check_made_by("paper", replace(wall, provenance=unknown))


def test_what_no_recipe_says_is_refused(short: Path) -> None:
    with pytest.raises(EndoctError, match="says nothing of profilometer recordings"):
        with_recipe("paper", "profilometer", {})
    unknown: Any = "papre"
    with pytest.raises(EndoctError, match="no recipe 'papre'; expected one of paper"):
        compare(short / "endoscope", short / "oct", recipe=unknown, progress=False)
