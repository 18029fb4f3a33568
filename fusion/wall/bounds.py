"""How far off the cells of one specimen are: what truth would say of them, expected from the wall and bounded.

The probabilities of the one wall are calibrated. So they say what Jaccard index to expect of any cells on it: expected
intersection over expected union. How far known specimens departed from that bounds it for a new one. Split conformal
prediction promises that such bounds hold in a given share of specimens, of however few, if all are of one kind (Lei et
al. 2018, doi:10.1080/01621459.2017.1307116). Whether this one is of their kind is tested: were it, its distance to its
nearest neighbour would have any rank among theirs with equal probability.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.doubt import Doubt
from endoct.fusion.result import Bounded, Bounds, Features, Result
from endoct.fusion.result.bounds import SHARE
from endoct.fusion.segmentation.by_eye import expected_jaccard
from endoct.fusion.sides import Placed
from endoct.fusion.wall.cells import Joined

LEVEL = 0.9
FEWEST = 9
"""Fewer known specimens promise nothing at this level."""
LEAST_ALIKE = 0.05
"""A specimen so unlike the known ones by chance with a smaller probability is not of their kind."""
WIDEST = 0.2
"""Wider bounds of a Jaccard index say little."""
AREA = "area_mm2"
FIGURES = ("light", "depth", "wall", AREA)
PACKAGED = "bounds.json"
THRESHOLDS = np.linspace(0.01, 0.99, 99)
ORDER = {"found": slice(None), "sure": slice(None, None, -1)}
"""How thresholds follow each other for what is found above one, and for how sure it is, the highest share first."""


@dataclass(frozen=True)
class Known:
    """A specimen of which the truth is known: what was expected of it, and the ``truth`` of some ``FIGURES``.

    With the truth of the wall's samples it has "found" and "sure", too, see :func:`share_needed`.
    """

    expected: Bounds
    truth: Mapping[str, float]


@dataclass(frozen=True)
class Calibration:
    """Known specimens, and what they are in a few words."""

    by: str
    known: Sequence[Known]


@lru_cache
def packaged() -> Calibration:
    """Return the simulated specimens of two generators that endoct brings along."""
    stored = json.loads(files(__package__).joinpath(PACKAGED).read_text(encoding="utf-8"))
    known = [Known(Bounds.model_validate(each["expected"]), each["truth"]) for each in stored["specimens"]]
    return Calibration(stored["by"], known)


def expected_of(placed: Placed, joined: Joined, result: Result) -> Bounds | None:
    """Return what to expect of both sides' cells and of their wall, without bounds; None where that cannot be told.

    ``result`` is that of the comparison of the ``placed`` sides, ``joined`` their wall.
    """
    wall, sides = joined.wall, placed.sides
    light = 0 if placed.both[0].relief is None else 1
    both: Mask = sides[0].valid & sides[1].valid & np.isfinite(wall.probability)
    cells = wall.cells & both
    told = cells & np.isfinite(wall.relief_mm)
    plain = both & ~wall.cells & np.isfinite(wall.relief_mm)
    contrast = sides[light].contrast
    if result.budget is None or contrast is None:
        return None
    seen = np.isfinite(contrast)
    of_cells, of_plain = contrast[told & seen], contrast[plain & seen]
    if not of_cells.size or not of_plain.size or not of_plain.std():
        return None
    sample_mm2 = wall.grid.dz_mm * wall.grid.dtheta_mm
    cell_mm2 = np.count_nonzero(cells) * sample_mm2
    features = Features(
        jaccard=result.jaccard or 0.0,
        alignment=result.budget.parts.alignment.share,
        cell_mm2=cell_mm2 / len(joined.cells),
        outline_per_mm=_outline_mm(cells, wall.grid.dz_mm, wall.grid.dtheta_mm) / cell_mm2,
        depth_mm=float(np.median(wall.relief_mm[told])),
        wall_spread_mm=float(np.median(np.abs(wall.relief_mm[plain]))),
        contrast=float((np.median(of_cells) - np.median(of_plain)) / of_plain.std()),
    )

    def index_of(name: str, mask: Mask) -> Bounded:
        shown = mask & both
        index = expected_jaccard(wall.probability, shown, both) if shown.any() else 0.0
        return Bounded(of=name, expected=index)

    area_mm2 = float(wall.probability[both].sum(dtype=np.float64)) * sample_mm2
    return Bounds(
        light=index_of(sides[light].name, sides[light].mask),
        depth=index_of(sides[1 - light].name, sides[1 - light].mask),
        wall=index_of("wall", wall.cells),
        area_mm2=Bounded(of="wall", expected=area_mm2),
        features=features,
    )


def bounds_of(placed: Placed, joined: Joined, result: Result, by: Calibration | None = None) -> Bounds | None:
    """Return what to expect of cells as :func:`expected_of` does, bounded ``by`` known specimens or those packaged."""
    expected, by = expected_of(placed, joined, result), by or packaged()
    if expected is None:
        return None
    found = bounded(expected, by)
    if not is_alike(found):
        return found
    both = placed.sides[0].valid & placed.sides[1].valid & np.isfinite(joined.wall.probability)
    probability = joined.wall.probability[both]
    shares = shares_above(probability, probability)
    return found.model_copy(update={f"{name}_from": threshold_at(name, shares[name], by) for name in ORDER})


def shares_above(probability: Image, cell: Image | Mask) -> dict[str, Coordinates]:
    """Return by threshold what share of all cells has no lower ``probability`` ("found"), and is cell of that ("sure").

    ``cell`` says which samples are one; or how probable that is, for shares to expect. All are (n,).
    """
    passed = np.searchsorted(THRESHOLDS, probability, side="right")
    cells, above = (np.bincount(passed, of, THRESHOLDS.size + 1)[:0:-1].cumsum()[::-1] for of in (cell, None))
    return {"found": cells / cell.sum(dtype=np.float64), "sure": np.where(above > 0, cells / np.maximum(above, 1), 1.0)}


def share_needed(name: str, expected: Coordinates, true: Coordinates) -> float:
    """Return the lowest share to expect from which on the true one is :data:`SHARE` or more; 1 where none is.

    Both are by threshold what :func:`shares_above` calls ``name``.
    """
    enough = int(np.logical_and.accumulate(true[ORDER[name]] >= SHARE).sum())
    return float(expected[ORDER[name]][enough - 1]) if enough else 1.0


def threshold_at(name: str, expected: Coordinates, by: Calibration) -> float | None:
    """Return the last threshold at which the share to expect is as high as ``LEVEL`` of known specimens needed it."""
    needed = _reach([known.truth[name] for known in by.known if name in known.truth])
    reached = THRESHOLDS[ORDER[name]][expected[ORDER[name]] >= needed]
    return float(reached[-1]) if reached.size else None


def _outline_mm(cells: Mask, dz_mm: float, column_mm: float) -> float:
    """Return the length of all outlines along rows and columns."""
    across = np.count_nonzero(cells ^ np.roll(cells, 1, axis=1))
    return float(across * dz_mm + np.count_nonzero(cells[1:] ^ cells[:-1]) * column_mm)


def bounded(expected: Bounds, by: Calibration) -> Bounds:
    """Return what is ``expected`` of a specimen with the bounds that known specimens give it.

    A figure has none where fewer than ``FEWEST`` know its truth, or where this specimen is not alike.
    """
    alike = likeness(expected, [known.expected for known in by.known])
    said = {"level": LEVEL, "calibrated_by": by.by, "specimens": len(by.known), "alike": alike}
    found = expected.model_copy(update=said)
    return (
        found.model_copy(update={name: _bounded(name, expected, by) for name in FIGURES}) if is_alike(found) else found
    )


def is_alike(bounds: Bounds) -> bool:
    """Return whether a specimen is not told to be unlike those that bound it."""
    return bounds.alike is not None and bounds.alike > least_alike(bounds.specimens or 0)


def least_alike(n: int) -> float:
    """Return how alike a specimen is at least to ``n`` of its kind: of few, it must not be the most unlike of all."""
    return max(LEAST_ALIKE, 1 / (n + 1))


def _bounded(name: str, expected: Bounds, by: Calibration) -> Bounded:
    of: Bounded = getattr(expected, name)
    known = [each for each in by.known if name in each.truth]
    reach = _reach([_score(name, each) for each in known]) * _unit(name, expected)
    if np.isinf(reach):
        return of
    highest = np.inf if name == AREA else 1.0
    return of.model_copy(update={"low": max(of.expected - reach, 0.0), "high": min(of.expected + reach, highest)})


def _reach(scores: Sequence[float]) -> float:
    """Return what a further score exceeds in no more than 1 − ``LEVEL`` of all cases; ∞ where these are too few."""
    rank = int(np.ceil((len(scores) + 1) * LEVEL - 1e-9))
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else np.inf


def _score(name: str, known: Known) -> float:
    off = abs(known.truth[name] - getattr(known.expected, name).expected)
    return float(off / _unit(name, known.expected))


def _unit(name: str, expected: Bounds) -> float:
    """Return how much a figure of a specimen may be off, relative to the same figure of others."""
    return expected.spread * (expected.area_mm2.expected if name == AREA else 1.0)


def likeness(specimen: Bounds, others: Sequence[Bounds]) -> float:
    """Return how probable it is that one of the kind of ``others`` is so unlike them as ``specimen`` is, over 0 to 1.

    Each is as unlike as its nearest neighbour among all is far. With n others, that is no less than 1/(n + 1).
    """
    places = np.array([_place(each) for each in (*others, specimen)])
    spread = places.std(axis=0)
    places = places / np.where(spread > 0, spread, 1)
    far = np.sqrt(((places[:, np.newaxis] - places) ** 2).sum(axis=-1))
    np.fill_diagonal(far, np.inf)
    unlike = far.min(axis=1)
    return float((unlike >= unlike[-1]).mean())


def _place(of: Bounds) -> Coordinates:
    """Return the place of a specimen among others: the odds of its indices, logarithms of its features and of cells."""
    area_mm2 = of.area_mm2.expected
    indices = np.clip([of.light.expected, of.depth.expected, of.wall.expected], 0, 1)
    features = [getattr(of.features, name) for name in Features.model_fields]
    features += [area_mm2, area_mm2 / max(of.features.cell_mm2, 1e-3)]
    return np.concatenate([np.log((indices + 0.005) / (1.005 - indices)), np.log(np.maximum(features, 1e-3))])


def doubts_of_bounds(bounds: Bounds | None, *, asked: bool) -> Iterator[Doubt]:
    """Yield the doubts about an error within wide bounds only, and if that was ``asked`` for, about one without any.

    No simulated specimen is quite like bone: that those packaged promise nothing for it speaks not against it.
    """
    if bounds is None:
        return
    if asked and bounds.alike is not None and not is_alike(bounds):
        what = (
            f"How far off its cells are is not promised: this specimen is unlike the {bounds.specimens} by which that "
            f"was calibrated ({bounds.calibrated_by}; p = {bounds.alike:.2f})."
        )
        yield Doubt(
            "error-not-bounded", what, value=bounds.alike, unit="1", expected=(least_alike(bounds.specimens or 0), 1.0)
        )
    for of in (bounds.light, bounds.depth):
        if of.low is not None and of.high is not None and of.high - of.low > WIDEST:
            what = f"The truth would give its cells a Jaccard index anywhere between {of.low:.2f} and {of.high:.2f}."
            yield Doubt("error-uncertain", what, side=of.of, value=of.high - of.low, unit="1", expected=(0.0, WIDEST))
