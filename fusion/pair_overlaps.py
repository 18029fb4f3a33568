"""How far two sides overlap on B's own samples, and how far by Li's threshold alone, whatever found their cells."""

from functools import partial

from endoct.base.arrays import Mask
from endoct.base.compute.parallel import at_once
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import Placement
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import ByLi, Overlap, OwnRows
from endoct.fusion.scoring.overlap import Surface, find_sites, overlap
from endoct.fusion.segmentation.li_alone import above_li
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.sides import Placed
from endoct.stitching.grid import SurfaceGrid


def on_own_rows(both: tuple[Side, Side], masks: tuple[Mask, Mask], alignment: Alignment) -> OwnRows:
    """Return the overlap on B's own samples: A is brought to them, and B is not interpolated at all.

    ``masks`` are the cells of each side on its own samples, bool (n_z, n_theta).
    """
    a, b = both
    placement = Placement.averaging(a.grid, alignment.inverse(), b.grid)
    one = Surface("", *placement.mask(masks[0], a.panorama.valid))
    return OwnRows(rows_of=b.name, **dict(_overlap(one, Surface("", masks[1], b.panorama.valid), b.grid)))


def by_li(placed: Placed, parameters: CompareParameters) -> ByLi | None:
    """Return how far two aligned sides overlap if the cells of both are what Li's threshold alone makes of them.

    None where a side is a mask, or all of its evidence is alike: there is nothing to threshold.
    """
    both = placed.both
    a, b = at_once(*(partial(_above_li, *each, parameters) for each in zip(both, placed.cells, strict=True)))
    if a is None or b is None:
        return None

    def again(k: int, mask: Mask) -> Surface:
        """Return a side on the common grid with ``mask``, on its own samples, for its cells."""
        shown = placed.sides[k]
        if mask is placed.cells[k].mask:
            return shown
        onto_grid = placed.samplings[k].onto(placed.grid)
        return Surface(shown.name, onto_grid.mask(mask, both[k].panorama.valid)[0], shown.valid)

    return ByLi(
        grid=_overlap(again(0, a[0]), again(1, b[0]), placed.grid),
        own_rows=on_own_rows(both, (a[0], b[0]), placed.samplings[1].where),
        threshold={both[0].name: a[1], both[1].name: b[1]},
    )


def _overlap(a: Surface, b: Surface, grid: SurfaceGrid) -> Overlap:
    return overlap(a, b, find_sites(a.mask, b.mask, a.valid & b.valid, grid.dz_mm * grid.dtheta_mm))


def _above_li(side: Side, cells: Segmentation, parameters: CompareParameters) -> tuple[Mask, float] | None:
    """Return what lies above Li's threshold on a side's own samples, and the threshold; None where there is none."""
    given = "dark" if parameters.polarity == "auto" else parameters.polarity
    evidence = side.in_reference.cell_evidence(parameters.segment, cells.polarity or given)
    if evidence.kind == "mask":
        return None
    if evidence.kind == "relief" and cells.by == "rules" and cells.threshold is not None:
        return cells.mask, cells.threshold  # found by nothing else
    try:
        found = above_li(evidence, parameters)
    except EndoctError:
        return None
    return found.mask, found.threshold * (side.scale if evidence.kind == "relief" else 1.0)
