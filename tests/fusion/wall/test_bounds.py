"""How far off cells are: what is expected of them, bounds that hold as promised, and specimens of another kind."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair
from doubted import codes_of

from endoct.fusion.comparison import place_sides, score_placed
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import Bounded, Bounds, Features
from endoct.fusion.wall.bounds import (
    Calibration,
    Known,
    bounded,
    bounds_of,
    doubts_of_bounds,
    expected_of,
    likeness,
    packaged,
    share_needed,
    shares_above,
)
from endoct.fusion.wall.cells import join


def specimen(rng: np.random.Generator, light: float = 0.9, cell_mm2: float = 0.3) -> Bounds:
    """Return a specimen whose bounds have the unit 0.1, with features that vary a little."""
    varied = {name: float(np.exp(rng.normal(0, 0.1))) for name in Features.model_fields}
    features = Features(**varied | {"jaccard": 0.8, "alignment": 0.05, "cell_mm2": cell_mm2 * varied["cell_mm2"]})
    return Bounds(
        light=Bounded(of="endoscope", expected=light),
        depth=Bounded(of="oct", expected=0.85),
        wall=Bounded(of="wall", expected=0.95),
        area_mm2=Bounded(of="wall", expected=10.0),
        features=features,
    )


def known(rng: np.random.Generator, off: float, **truth: float) -> Known:
    return Known(specimen(rng), {"light": 0.9 - off, "depth": 0.85 + off, **truth})


def test_nine_known_specimens_bound_by_the_farthest_and_nineteen_by_the_second() -> None:
    rng = np.random.default_rng(0)
    nine = Calibration("nine", [known(rng, off) for off in np.linspace(0.01, 0.05, 9)])
    one = next(each for each in (bounded(specimen(rng), nine) for _ in range(9)) if each.light.low is not None)
    assert (one.light.low, one.light.high) == pytest.approx((0.85, 0.95))
    assert (one.depth.low, one.depth.high) == pytest.approx((0.80, 0.90))
    assert (one.wall.low, one.area_mm2.high) == (None, None)  # of which nobody knew the truth
    assert (one.level, one.specimens, one.calibrated_by) == (0.9, 9, "nine")
    nineteen = Calibration("", [known(rng, off, area_mm2=10 + 20 * off) for off in np.linspace(0.01, 0.19, 19)])
    most = next(each for each in (bounded(specimen(rng), nineteen) for _ in range(9)) if each.light.low is not None)
    assert (most.light.low, most.light.high) == pytest.approx((0.72, 1.0))  # the 18th of 19, and no index beyond 1
    assert (most.area_mm2.low, most.area_mm2.high) == pytest.approx((6.4, 13.6))
    area = {"area_mm2": Bounded(of="wall", expected=20.0)}
    twice = most.model_copy(update=area)
    assert bounded(twice, nineteen).area_mm2.high is None  # all others have half as much, and half as many cells
    first = Known(nineteen.known[0].expected.model_copy(update=area), {"area_mm2": 20.4})
    assert bounded(twice, replace(nineteen, known=[first, *nineteen.known[1:]])).area_mm2.high == pytest.approx(27.2)
    eight = Calibration("", nine.known[:8])
    assert bounded(specimen(rng), eight).light.low is None


def test_bounds_are_wider_where_the_wall_is_less_sure_or_the_alignment_costs_more() -> None:
    rng = np.random.default_rng(1)
    by = Calibration("", [known(rng, 0.02) for _ in range(40)])
    sure = by.known[0].expected
    unsure = sure.model_copy(update={"wall": Bounded(of="wall", expected=0.9)})
    loose = sure.model_copy(update={"features": sure.features.model_copy(update={"alignment": 0.15})})
    assert (sure.spread, unsure.spread, loose.spread) == pytest.approx((0.1, 0.15, 0.2))
    certain = sure.model_copy(update={"wall": Bounded(of="wall", expected=1.0)})
    of_certain = certain.features.model_copy(update={"alignment": 0.0})
    assert certain.model_copy(update={"features": of_certain}).spread == 0.01
    monotone = [
        bounded(each, replace(by, known=[Known(each, {"light": 0.9})] * 3 + by.known)) for each in (sure, unsure)
    ]
    widths = [each.light.high - each.light.low for each in monotone]  # type: ignore[operator]
    assert widths == pytest.approx([0.04, 0.06])


def test_bounds_hold_as_often_as_they_promise() -> None:
    rng = np.random.default_rng(2)
    held, alike = [], []
    for _ in range(150):
        drawn = [known(rng, float(rng.normal(0, 0.02))) for _ in range(30)]
        one = bounded(drawn[0].expected, Calibration("", drawn[1:]))
        alike.append(one.alike)
        if one.light.low is not None and one.light.high is not None:
            held.append(one.light.low <= drawn[0].truth["light"] <= one.light.high)
    assert np.mean(held) == pytest.approx(0.9, abs=0.06)
    assert np.mean(np.array(alike) <= 0.05) < 0.1  # falsely told to be unlike
    assert np.mean(np.array(alike) <= 0.5) == pytest.approx(0.5, abs=0.12)


def test_a_specimen_of_another_kind_has_no_bounds_but_a_doubt() -> None:
    rng = np.random.default_rng(3)
    by = Calibration("others", [known(rng, 0.02) for _ in range(30)])
    other = bounded(specimen(rng, cell_mm2=0.02), by)
    assert other.alike == pytest.approx(1 / 31)
    assert (other.light.low, other.light.high) == (None, None)
    assert list(doubts_of_bounds(other, asked=False)) == []  # nobody said that those should be of its kind
    (doubt,) = doubts_of_bounds(other, asked=True)
    assert codes_of([doubt]) == ["error-not-bounded"]
    assert "unlike the 30" in doubt.what
    assert other.sentence.endswith("nothing is promised, as it is unlike the 30 others (p = 0.03).")
    steady = [
        each.expected.model_copy(update={"light": Bounded(of="", expected=0.9 + k / 1e4)})
        for k, each in enumerate(by.known)
    ]
    shifted = steady[0].model_copy(update={"light": Bounded(of="", expected=0.92)})
    assert likeness(shifted, steady) == pytest.approx(1 / 31)  # far for how little the others vary in that
    assert likeness(steady[0], steady[1:]) > 0.05
    of_nine = likeness(specimen(rng, light=0.3), [each.expected for each in by.known[:9]])
    assert of_nine == pytest.approx(0.1)  # nine cannot say more
    assert bounded(specimen(rng, light=0.3), Calibration("", by.known[:9])).light.low is None
    assert list(doubts_of_bounds(None, asked=True)) == []


@pytest.mark.parametrize("alike_in", ["cells", "area"])
def test_a_specimen_with_fewer_cells_or_less_of_them_is_unlike(alike_in: str) -> None:
    rng = np.random.default_rng(5)

    def sized(one: Bounds, cell_mm2: float, share: float = 1.0, **features: float) -> Bounds:
        area_mm2 = share * (100 * cell_mm2 if alike_in == "cells" else 40.0)
        features = {"cell_mm2": cell_mm2} | features
        area = Bounded(of="wall", expected=area_mm2)
        return one.model_copy(update={"features": one.features.model_copy(update=features), "area_mm2": area})

    others = [sized(specimen(rng), cell_mm2) for cell_mm2 in np.geomspace(0.1, 1.6, 30).tolist()]
    mean = dict.fromkeys(("outline_per_mm", "depth_mm", "wall_spread_mm", "contrast"), 1.0)
    assert likeness(sized(specimen(rng), 0.4, **mean), others) > 0.5
    assert likeness(sized(specimen(rng), 0.4, 0.6, **mean), others) == pytest.approx(1 / 31)


def test_wide_bounds_are_a_doubt_of_their_side() -> None:
    rng = np.random.default_rng(4)
    by = Calibration("", [Known(specimen(rng), {"light": 0.75, "depth": 0.84}) for _ in range(30)])
    one = bounded(by.known[0].expected, by)
    assert [(doubt.code, doubt.side) for doubt in doubts_of_bounds(one, asked=True)] == [
        ("error-uncertain", "endoscope")
    ]
    assert codes_of(doubts_of_bounds(one, asked=False))
    assert "endoscope 0.90 (0.75–1.00), oct 0.85 (0.84–0.86), wall 0.95; 10.0 mm²" in one.sentence
    assert one.sentence.endswith("each holds in 90% of such specimens.")


def test_what_is_expected_of_a_pair_follows_from_its_wall(pair: Pair) -> None:
    parameters = CompareParameters()
    placed = place_sides(*two_sides(pair.a, pair.b), parameters)
    joined, result = join(placed), score_placed(placed, parameters).result
    assert joined is not None
    one = expected_of(placed, joined, result)
    assert one is not None
    both = placed.sides[0].valid & placed.sides[1].valid
    p, shown = joined.wall.probability.astype(np.float64), placed.sides[1].mask & both
    assert one.depth.of == placed.sides[1].name
    assert one.depth.expected == pytest.approx(p[shown].sum() / (shown.sum() + p[both & ~shown].sum()))
    assert one.light.expected == pytest.approx(one.depth.expected, abs=0.2)
    assert 1 > one.wall.expected > max(one.light.expected, one.depth.expected) > 0.5
    sample_mm2 = placed.grid.dz_mm * placed.grid.dtheta_mm
    assert one.area_mm2.expected == pytest.approx(p[both].sum() * sample_mm2)
    assert one.features.jaccard == result.jaccard
    assert 0.1 < one.features.depth_mm < 0.8
    cells_mm2 = (joined.wall.cells & both).sum() * sample_mm2
    assert joined.wall.cells.sum() * sample_mm2 > cells_mm2 + 0.1  # some lie where one side alone saw the wall
    assert one.features.cell_mm2 == pytest.approx(cells_mm2 / len(joined.cells))
    assert 3 < one.features.outline_per_mm < 40
    assert one.features.contrast > 2
    assert result.budget is not None
    assert one.features.alignment == result.budget.parts.alignment.share
    assert expected_of(placed, joined, result.model_copy(update={"budget": None})) is None
    swapped = place_sides(*two_sides(pair.b, pair.a), parameters)
    again = join(swapped)
    assert again is not None
    other = bounds_of(swapped, again, score_placed(swapped, parameters).result)
    assert other is not None
    assert (other.light.of, other.depth.of) == (one.light.of, one.depth.of)
    assert other.specimens == len(packaged().known)
    known = [Known(one, {"light": 0.7, "found": (0.9, 0.97)[k < 1], "sure": (0.98, 0.99)[k < 1]}) for k in range(19)]
    sharp = bounds_of(placed, joined, result, Calibration("", known))
    assert sharp is not None
    assert sharp.found_from is not None
    assert sharp.sure_from is not None
    of_both = p[both]
    found = [of_both[of_both >= at].sum() / of_both.sum() for at in (sharp.found_from, sharp.found_from + 0.01)]
    assert found[0] >= 0.9 > found[1]
    sure = [of_both[of_both >= at].mean() for at in (sharp.sure_from - 0.01, sharp.sure_from)]
    assert sure[0] < 0.98 <= sure[1]
    said = f"{sharp.found_from:.2f} or more, and 95% of what has {sharp.sure_from:.2f} or more is cell"
    assert f"; 95% of their area has a probability of {said}; each holds" in sharp.sentence
    few = bounds_of(placed, joined, result, Calibration("", known[:8]))
    assert few is not None
    assert (few.found_from, few.sure_from) == (None, None)


def test_a_threshold_is_known_by_the_share_that_had_to_be_expected_for_it() -> None:
    probability = np.array([0.25, 0.5, 0.5, 0.75], np.float32)
    true = shares_above(probability, np.array([False, True, False, True]))
    expected = shares_above(probability, probability)
    at = [0, 24, 25, 49, 50, 74, 75]  # from 0.01, 0.25, 0.26, 0.5, 0.51, 0.75 and 0.76 on
    assert true["found"][at] == pytest.approx([1, 1, 1, 1, 0.5, 0.5, 0])
    assert true["sure"][at] == pytest.approx([0.5, 0.5, 2 / 3, 2 / 3, 1, 1, 1])  # of nothing all is cell
    assert share_needed("found", expected["found"], true["found"]) == pytest.approx(1.75 / 2)
    assert share_needed("sure", expected["sure"], true["sure"]) == pytest.approx(0.75)
    assert share_needed("found", expected["found"], 0.9 * true["found"]) == 1.0
    dips = np.where(np.arange(99) == 10, 0.5, true["found"])  # from where on it is enough, not where else
    assert share_needed("found", expected["found"], dips) == 1.0


def test_what_endoct_brings_along_knows_every_figure() -> None:
    assert len(packaged().known) >= 40
    for each in packaged().known:
        assert set(each.truth) == {"light", "depth", "wall", "area_mm2", "found", "sure"}
        assert abs(each.truth["wall"] - each.expected.wall.expected) < 0.2
