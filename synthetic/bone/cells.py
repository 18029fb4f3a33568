"""Draws the cells of a bore: holes drilled into bone substitute, or a pneumatised mastoid."""

from numpy.random import Generator

from endoct.synthetic.bone.mastoid import draw_network
from endoct.synthetic.bone.phantom import draw_holes
from endoct.synthetic.sample.parameters import Bore, Cell


def draw_cells(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw planted cells until ``bore.cell_fraction`` of the wall is cut away, or at most 0.02 more, never over 0.295.

    Bone in three dimensions and tubes have none. Raises :class:`EndoctError` where there is no room for so many.
    """
    if bore.bone == "phantom":
        return draw_holes(rng, bore)
    return draw_network(rng, bore) if bore.bone == "mastoid" else ()
