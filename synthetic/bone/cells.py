"""Draws the cells of a bore: holes drilled into bone substitute, or a pneumatised mastoid."""

from numpy.random import Generator

from endoct.synthetic.bone.mastoid import draw_network
from endoct.synthetic.bone.phantom import draw_holes
from endoct.synthetic.sample.parameters import Bore, Cell


def draw_cells(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw cells until ``bore.cell_fraction`` of the wall is cut away, at most 0.02 more, and never more than 0.295.

    Raises :class:`EndoctError` where there is no room for so many.
    """
    return draw_network(rng, bore) if bore.bone == "mastoid" else draw_holes(rng, bore)
