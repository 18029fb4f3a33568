"""Recipes: the settings of a whole chain of processing, by one word. What is set besides a recipe wins over it."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama

if TYPE_CHECKING:
    from endoct.workbench.requests import RecipeName

RECIPES: "Mapping[RecipeName, Mapping[str, Mapping[str, object]]]" = MappingProxyType(
    {
        # Laves et al. 2019: a B-scan shifted by its sine, the index of its maximum for depth, no correction of uneven
        # rotation, and Li's threshold; frames are unrolled and stitched as they are here anyway
        "paper": {
            "oct": {
                "undistort": "sine",
                "wall": "maximum",
                "correct_rotation": False,
                "correct_turn_length": False,
                "correct_start_angle": False,
                "correct_lost_ascans": False,
            },
            "endoscope": {},
            "compare": {
                "eye": "off",
                "outlines": False,
                "by_depth": False,
                "contrast_floor_sigmas": 0.0,
                "contrast_cap": 50.0,
            },
        }
    }
)
"""Settings by recipe, then by modality; those of the comparison itself under "compare"."""


def with_recipe(recipe: "RecipeName | None", part: str, settings: Mapping[str, object]) -> dict[str, object]:
    """Return the settings of a ``recipe`` for a modality, or for "compare", with ``settings`` in place of its own.

    Raises :class:`EndoctError` where there is no such recipe, or it says nothing of that modality.
    """
    return {**_of(recipe, part), **settings}


def check_made_by(recipe: "RecipeName | None", panorama: Panorama) -> None:
    """Raise :class:`EndoctError` unless ``panorama`` was unrolled by the ``recipe`` that is asked for, if one is."""
    made_with = panorama.provenance.get("parameters")
    known = made_with if isinstance(made_with, Mapping) else {}
    other = [key for key, value in _of(recipe, panorama.modality).items() if known.get(key) != value]
    if other:
        raise EndoctError(
            f"a panorama of the {panorama.modality} was not made by the recipe '{recipe}'",
            found=", ".join(f"{key}={known.get(key, 'not known')}" for key in other),
            remedy="compare the recording itself, or unroll it by that recipe",
        )


def _of(recipe: "RecipeName | None", part: str) -> Mapping[str, object]:
    if recipe is None:
        return {}
    if recipe not in RECIPES:
        raise EndoctError(f"there is no recipe '{recipe}'", expected=f"one of {', '.join(RECIPES)}")
    if part not in RECIPES[recipe]:
        raise EndoctError(f"the recipe '{recipe}' says nothing of {part} recordings", remedy="leave it out")
    return RECIPES[recipe][part]
