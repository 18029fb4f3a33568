"""Recordings made by means that share nothing with endoct, and a judge that shares nothing with it either.

:func:`make_pair` makes one bore with air cells, an OCT pullback and an endoscope recording of it, sidecars and the
truth, from a :class:`Recipe` and a seed. ``python -m benchmarks.independent --help`` runs whole sets.
"""

from benchmarks.independent.pair import Pair, make_pair, write_pair
from benchmarks.independent.recipe import BoreRecipe, CatheterRecipe, MirrorRecipe, Recipe

__all__ = ["BoreRecipe", "CatheterRecipe", "MirrorRecipe", "Pair", "Recipe", "make_pair", "write_pair"]
