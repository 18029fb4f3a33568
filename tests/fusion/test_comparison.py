"""Two panoramas in, one comparison out."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from bore_pairs import Pair, make_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib import pyplot as plt

from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian, wrap_rad
from endoct.fusion import comparison
from endoct.fusion.comparison import (
    CompareParameters,
    Comparison,
    compare_panoramas,
    compare_placed,
    load_comparison,
    place_sides,
    save_comparison,
    score_placed,
)
from endoct.fusion.evidence.side import Side, two_sides
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration.rigidity import LoosePart
from endoct.fusion.registration.steps import Step
from endoct.fusion.result import ByHand
from endoct.fusion.scoring.overlap import BOTH
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import evidence_of, segment_side
from endoct.stitching.panorama import Panorama

COARSE = CompareParameters(n_theta=512)


@pytest.fixture(scope="module")
def compared(pair: Pair) -> Comparison:
    return compare_panoramas(pair.a, pair.b)


@pytest.fixture(scope="module")
def coarsely(pair: Pair) -> Comparison:
    return compare_panoramas(pair.a, pair.b, COARSE)


def test_the_result(compared: Comparison, pair: Pair) -> None:
    result = json.loads(json.dumps(compared.result.to_json()))
    assert result["sides"] == ["camera", "ranger"]
    assert result["aligned"] is True
    assert result["reason"] is None
    assert abs(wrap_rad(result["alignment"]["theta_shift_rad"] - pair.truth.theta_shift_rad)) < 0.01
    assert result["jaccard"] > 0.75
    assert result["scores"]["own_rows"]["jaccard"] > 0.75
    assert result["dice"] == pytest.approx(2 * result["jaccard"] / (1 + result["jaccard"]))
    assert result["polarity"] == {"camera": "dark", "ranger": None}
    assert result["threshold"]["ranger"]["unit"] == "mm"
    assert 0 < result["threshold"]["ranger"]["value"] < 0.2
    assert result["valid_fraction"] == pytest.approx(1.0)
    # A spans 6 mm, B 5.8 mm from 1.2 mm on
    assert result["overlap_mm"] == pytest.approx(4.8, abs=0.15)


def test_the_grid_covers_both_sides(compared: Comparison) -> None:
    assert compared.grid.dz_mm == pytest.approx(0.05)
    assert compared.grid.n_theta == 2048
    assert compared.grid.z_mm[0] == pytest.approx(0.0, abs=1e-6)
    assert compared.grid.z_mm[-1] == pytest.approx(7.0, abs=0.1)
    assert compared.sides[0].valid[compared.grid.z_mm < 5.9].all()
    assert not compared.sides[0].valid[compared.grid.z_mm > 6.1].any()
    assert not compared.sides[1].valid[compared.grid.z_mm < 1.0].any()
    assert np.isnan(compared.sides[0].depth_mm).all()
    assert np.array_equal(np.isfinite(compared.sides[1].depth_mm), compared.sides[1].valid)
    assert not any((side.mask & ~side.valid).any() for side in compared.sides)


def test_one_line_and_a_few_pictures_show_it(compared: Comparison) -> None:
    assert re.fullmatch(
        r"<Comparison of camera and ranger: Jaccard index 0\.\d{3} \(0\.\d{3} to 0\.\d{3}\)>", repr(compared)
    )
    assert repr(compared.alignment).startswith("<Alignment: θ shift ")
    assert max(len(repr(part)) for part in (compared, compared.alignment, *compared.sides)) < 150
    shown = compared._repr_html_()
    assert shown.count("data:image/png") == 3
    assert len(shown) < 60_000
    unaligned = replace(compared, alignment=None, reason="Nothing <b>stood</b> out.")
    assert repr(unaligned) == "<Comparison of camera and ranger: not aligned: Nothing <b>stood</b> out.>"
    shown = unaligned._repr_html_()
    assert shown.count("data:image/png") == 2
    assert "not aligned: Nothing &lt;b&gt;stood&lt;/b&gt; out." in shown


def test_it_plots_both_sides_and_where_their_cells_differ(compared: Comparison) -> None:
    plt.switch_backend("agg")
    try:
        axes = compared.plot()
        assert [one.get_title(loc="left") for one in axes] == ["camera", "ranger", "cells"]
        drawn = axes[2].images[0].get_array()
        assert drawn is not None
        a, b = compared.sides
        both = a.valid & b.valid
        both_cells = (np.ma.filled(drawn, -1) == BOTH).sum() / (a.mask & b.mask & both).sum()
        assert both_cells == pytest.approx(drawn.size / both.size, rel=0.01)
        assert len(replace(compared, alignment=None, reason="why not").plot()) == 2
    finally:
        plt.close("all")


def test_both_sides_are_placed_as_they_will_be_scored(pair: Pair) -> None:
    shown = place_sides(*two_sides(pair.a, pair.b), COARSE)
    found = score_placed(shown, COARSE)
    assert (shown.grid, shown.sides, shown.outcome.alignment) == (found.grid, found.sides, found.alignment)


@pytest.mark.parametrize(("corrected", "doubted"), [(None, True), (False, True), (True, False)])
def test_pairs_that_only_check_leave_the_doubts_of_the_search(
    compared: Comparison, pair: Pair, corrected: bool | None, doubted: bool
) -> None:
    by_hand = None if corrected is None else ByHand(corrected=corrected, automatic=None, pairs=())
    placed: Any = SimpleNamespace(both=two_sides(pair.a, pair.b), by_hand=by_hand)
    forced = COARSE.model_copy(update={"force": True})
    codes = [doubt.code for doubt in comparison._doubts_of_alignment(placed, compared.alignment, (), forced)]
    assert ("forced" in codes) == doubted


def test_on_disk_and_back(compared: Comparison, tmp_path: Path) -> None:
    save_comparison(compared, tmp_path / "c.zarr")
    (tmp_path / "result.json").write_text(json.dumps(compared.result.to_json()))
    with xr.open_zarr(tmp_path / "c.zarr") as dataset:
        assert dataset["mask"].dims == ("side", "z", "theta")
        assert list(dataset["side"].values) == ["camera", "ranger"]
        assert dataset["z"].attrs["units"] == "mm"
        assert dataset["theta"].attrs["units"] == "rad"
        assert {"intensity", "depth_mm", "mask", "valid"} <= set(dataset.data_vars)
    loaded = load_comparison(tmp_path / "c.zarr")
    assert loaded.grid == compared.grid
    assert loaded.alignment == compared.alignment
    assert loaded.names == compared.names
    assert loaded.result == compared.result
    for one, two in zip(loaded.sides, compared.sides, strict=True):
        for name in ("intensity", "depth_mm", "mask", "valid"):
            assert np.array_equal(getattr(one, name), getattr(two, name), equal_nan=name == "depth_mm")


def test_something_else_on_disk(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="is no comparison"):
        load_comparison(tmp_path / "nothing.zarr")


def rolled(panorama: Panorama, columns: int) -> Panorama:
    depth_mm = panorama.depth_mm
    return replace(
        panorama,
        intensity=np.roll(panorama.intensity, columns, axis=1),
        depth_mm=None if depth_mm is None else np.roll(depth_mm, columns, axis=1),
        valid=np.roll(panorama.valid, columns, axis=1),
        weight=np.roll(panorama.weight, columns, axis=1),
    )


@settings(max_examples=6)
@given(columns=st.integers(1, 511))
def test_rolling_both_rolls_the_answer_and_nothing_else(pair: Pair, coarsely: Comparison, columns: int) -> None:
    before = coarsely
    after = compare_panoramas(rolled(pair.a, columns), rolled(pair.b, columns), COARSE)
    assert before.alignment is not None
    assert after.alignment is not None
    assert after.grid.shape == before.grid.shape
    turn = wrap_rad(after.alignment.theta_shift_rad - before.alignment.theta_shift_rad)
    assert abs(turn) < 1e-3
    assert abs(after.alignment.z_shift_mm - before.alignment.z_shift_mm) < 1e-3
    assert after.result.jaccard == pytest.approx(before.result.jaccard, abs=2e-3)
    # the last bit of rounding may move a sample over the threshold
    for one, two in zip(before.sides, after.sides, strict=True):
        assert np.mean(np.roll(one.mask, columns, axis=1) != two.mask) < 1e-3
        assert np.array_equal(np.roll(one.valid, columns, axis=1), two.valid)


def test_bright_cells_are_recognised_by_their_correlation_with_depth(pair_of: Callable) -> None:
    pair = pair_of(2, bright_cells=True)
    found = compare_panoramas(pair.a, pair.b, COARSE)
    assert found.result.polarity["camera"] == "bright"
    assert found.result.own_rows_jaccard > 0.7
    overridden = compare_panoramas(pair.a, pair.b, COARSE.model_copy(update={"polarity": "dark"}))
    assert overridden.result.polarity["camera"] == "dark"
    assert overridden.result.jaccard < 0.3


def test_depth_may_be_left_aside_for_intensity(pair: Pair) -> None:
    found = compare_panoramas(pair.a, pair.b, COARSE.model_copy(update={"segment": "intensity"}))
    assert found.result.aligned
    assert "intensity" in found.result.threshold["ranger"].of
    assert found.result.polarity["ranger"] == "dark"


def test_two_sides_of_one_modality(pair_of: Callable) -> None:
    pair = pair_of(5)
    found = compare_panoramas(pair.a, pair.a, COARSE)
    assert found.names == ("camera-1", "camera-2")
    assert found.result.jaccard > 0.98
    assert found.result.polarity == {"camera-1": "dark", "camera-2": "dark"}
    assert found.result.polarity_from["camera-1"] == "assumed"


@pytest.mark.parametrize("z_reversed", [False, True])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_false_handedness_is_said_whichever_side_comes_first(
    pair_of: Callable, z_reversed: bool, swapped: bool
) -> None:
    """With the travel unknown it is put right, and doubted; with all stated it is the reason not to align."""
    pair = pair_of(1, mirrored=True, z_reversed=z_reversed)
    for travel_known in (False, True):
        sides = [replace(side, handedness_known=True, travel_known=travel_known) for side in (pair.a, pair.b)]
        result = compare_panoramas(*(sides[::-1] if swapped else sides)).result
        if travel_known:
            assert result.reason is not None
            assert re.search("Mirrored .*they would align: check handedness", result.reason)
        else:
            assert result.alignment is not None
            assert (result.alignment.mirrored, result.alignment.z_reversed) == (True, z_reversed)
            assert "handedness-contradicted" in [doubt.code for doubt in result.doubts]


def test_other_bores_are_written_but_not_scored(pair_of: Callable, tmp_path: Path) -> None:
    pair = pair_of(0, other_bore=True)
    found = compare_panoramas(pair.a, pair.b, COARSE)
    assert found.alignment is None
    assert found.reason
    assert found.result.aligned is False
    assert found.result.alignment is found.result.jaccard is found.result.dice is None
    assert found.sides[0].mask.any()
    assert found.sides[1].mask.any()
    # B lies by its nominal orientation: both start at z = 0
    assert found.sides[1].valid[0].all()
    save_comparison(found, tmp_path / "c.zarr")
    (tmp_path / "result.json").write_text(json.dumps(found.result.to_json()))
    assert load_comparison(tmp_path / "c.zarr").alignment is None


def test_bridged_rows_do_not_count(pair: Pair) -> None:
    valid = np.ones(pair.b.grid.shape, np.bool_)
    valid[10:13] = False
    found = compare_panoramas(pair.a, replace(pair.b, valid=valid), COARSE)
    assert found.alignment is not None
    lost = np.abs(found.grid.z_mm - found.alignment.z_to_a(pair.b.z_mm[11])) < 0.2
    assert not found.sides[1].valid[lost].any()
    assert found.result.valid_fraction < 1


def test_on_own_rows_counts_only_what_both_observed(panorama_of: Callable) -> None:
    """By hand: B is turned by 100 columns and lies 4 rows on; what each did not observe goes over its seam."""
    rng, turn, rows, n = np.random.default_rng(3), 100, 4, 512
    cells = gaussian(rng.standard_normal((30, n)).astype(np.float32), 1.0, 6.0) > 0.06
    one, two = (cells ^ (rng.random(cells.shape) < 0.02) for _ in range(2))
    seen = np.ones((2, 30, n), np.bool_)
    seen[0, 8:24, np.arange(-90, 60)] = False
    seen[1, 15:28, (turn + np.arange(-50, 40)) % n] = False
    depth = np.where(cells, 0.4, 0) + rng.normal(0, 0.01, cells.shape)
    on_b = np.roll(np.stack([one, two, *seen]), -turn, axis=2)[:, rows:]
    a = panorama_of(rng.gamma(2, 1, cells.shape), dz_mm=0.2, valid=seen[0])
    relief = np.roll(depth, -turn, axis=1)[rows:]
    b = panorama_of(np.ones(relief.shape), dz_mm=0.2, depth_mm=relief, valid=on_b[3], modality="ranger")
    sides = two_sides(a, b)
    drawn = tuple(
        replace(segment_side(side, COARSE, "dark"), mask=mask & side.panorama.valid)
        for side, mask in zip(sides, (one, on_b[1]), strict=True)
    )
    found = compare_placed(sides, drawn, Alignment(2 * np.pi * turn / n, 0.2 * rows), COARSE).result.scores.own_rows
    both = on_b[2] & on_b[3]
    expected = [(part & both).sum() for part in (on_b[0] & on_b[1], on_b[0] | on_b[1])]
    assert found.jaccard == pytest.approx(expected[0] / expected[1], abs=1e-3)
    assert found.neither_mm2 == pytest.approx((both.sum() - expected[1]) * 0.2 * b.grid.dtheta_mm, rel=1e-3)


def test_another_diameter_is_refused(pair: Pair, panorama_of: Callable) -> None:
    other = panorama_of(pair.a.intensity, dz_mm=0.05, radius_mm=1.3)
    with pytest.raises(EndoctError, match=r"2\.6 mm for side A and 2\.5 mm for side B.*recordings of two bores"):
        compare_panoramas(other, pair.b)


def test_a_slightly_different_diameter_is_noted(pair: Pair) -> None:
    assert not compare_panoramas(pair.a, pair.b, COARSE).result.notes
    grid = replace(pair.b.grid, radius_mm=1.02 * pair.b.grid.radius_mm)
    found = compare_panoramas(pair.a, replace(pair.b, grid=grid), COARSE)
    assert found.alignment is not None
    (note,) = found.result.notes[found.names[1]]
    assert "bore_diameter_mm is 2.55 mm for this side and 2.5 mm for the other" in note
    notes, nothing = dict.fromkeys(found.names, ("x",)), {}
    completed = found.result.completed(
        truth=nothing, raters=None, notes=notes, versions=nothing, inputs=nothing, parameters=nothing, seconds=nothing
    )
    assert completed.notes == {found.names[0]: ("x",), found.names[1]: ("x", note)}


def test_the_inputs_stay_as_they_are(pair: Pair) -> None:
    before = [pair.a.intensity.copy(), pair.b.depth_mm.copy()]
    compare_panoramas(pair.a, pair.b, COARSE)
    assert np.array_equal(before[0], pair.a.intensity)
    assert np.array_equal(before[1], pair.b.depth_mm)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_very_short_recordings_are_refused_not_broken(pair: Pair, panorama_of: Callable, rows: int) -> None:
    short = panorama_of(pair.b.intensity[:rows], dz_mm=0.2, depth_mm=pair.b.depth_mm[:rows])
    found = compare_panoramas(pair.a, short, COARSE)
    assert found.alignment is None or found.alignment.confidence > 0.2
    assert found.grid.n_theta == 512
    both = compare_panoramas(short, short, COARSE)
    assert both.grid.n_z >= rows


def test_noise_is_refused(panorama_of: Callable) -> None:
    rng = np.random.default_rng(0)
    noise = [panorama_of(rng.gamma(2, 1, (60, 512)), dz_mm=0.1) for _ in range(2)]
    found = compare_panoramas(*noise, COARSE)
    assert found.alignment is None
    assert found.result.aligned is False


def test_a_side_nothing_of_which_is_valid(pair: Pair, panorama_of: Callable) -> None:
    blind = panorama_of(np.ones((20, 64)), dz_mm=0.1, valid=np.zeros((20, 64), np.bool_))
    with pytest.raises(EndoctError, match="nothing of the wall is valid"):
        compare_panoramas(pair.a, blind)


@pytest.mark.parametrize("loose", [True, False])
def test_a_step_is_looked_for_where_no_part_is_out_of_place(
    pair: Pair, monkeypatch: pytest.MonkeyPatch, loose: bool
) -> None:
    """What is out of place follows two lines by chance."""
    part = LoosePart("band", 1.0, 2.5, 0.5, 0.0, (0.8, 0.1))
    monkeypatch.setattr(comparison, "parts_out_of_place", lambda *_: (part,) * loose)
    monkeypatch.setattr(comparison, "step_along", lambda *_: Step(3.0, 0.2))
    codes = [doubt.code for doubt in compare_panoramas(pair.a, pair.b, COARSE).result.doubts]
    assert ("parts-out-of-place" in codes) == loose
    assert ("step-along-the-bore" in codes) == (not loose)


def test_a_bend_is_used_said_and_stored(tmp_path: Path) -> None:
    """B's rows turned by up to 11 degrees, either way."""
    pair = make_pair(3, rows=45)
    b = pair.b
    assert b.depth_mm is not None
    by = np.round(np.linspace(-16, 16, b.grid.n_z)).astype(int)
    column = (np.arange(b.grid.n_theta) - by[:, None]) % b.grid.n_theta
    row = np.arange(b.grid.n_z)[:, None]
    turned = replace(b, intensity=b.intensity[row, column], depth_mm=b.depth_mm[row, column])
    rigid, bent = (compare_panoramas(pair.a, one, COARSE) for one in (b, turned))
    assert rigid.result.alignment is not None
    assert rigid.result.alignment.bend is None
    assert rigid.result.to_json()["alignment"]["bend"] is None
    assert "bent-along-the-bore" not in [doubt.code for doubt in rigid.doubts]
    assert bent.alignment is not None
    assert bent.alignment.bend is not None
    assert {doubt.code for doubt in bent.doubts} & {"bent-along-the-bore", "parts-out-of-place"} == {
        "bent-along-the-bore"
    }
    assert bent.result.jaccard == pytest.approx(rigid.result.jaccard, abs=0.02)
    assert bent.result.own_rows_jaccard == pytest.approx(rigid.result.own_rows_jaccard, abs=0.02)
    save_comparison(bent, tmp_path / "comparison.zarr")
    (tmp_path / "result.json").write_text(json.dumps(bent.result.to_json()))
    assert load_comparison(tmp_path / "comparison.zarr").alignment == bent.alignment


def test_cells_that_an_eye_saw_align_the_sides(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    """They tell more exactly where B lies than the darkness does."""
    plain = place_sides(*two_sides(pair.a, pair.b), COARSE)

    def seen(a: Side, b: Side, *_: object) -> tuple[Segmentation, Segmentation]:
        return replace(plain.cells[0], probability=pair.cells_a.astype(np.float32)), plain.cells[1]

    monkeypatch.setattr("endoct.fusion.comparison.segment_sides", seen)
    placed = place_sides(*two_sides(pair.a, pair.b), COARSE)
    assert placed.outcome.alignment is not None
    assert plain.outcome.alignment is not None
    assert placed.outcome.alignment.correlation > plain.outcome.alignment.correlation
    middle_mm = np.array([float(pair.b.z_mm.mean())])
    assert placed.outcome.alignment.z_error_mm(middle_mm) < plain.outcome.alignment.z_error_mm(middle_mm)
    own = evidence_of(placed.both[1], placed.cells[1])
    assert own is placed.both[1].evidence
    by_light = replace(placed.cells[1], probability=np.ones_like(own.values))
    assert evidence_of(placed.both[1], by_light) is own  # what measures depth is aligned by it
    of_a = evidence_of(placed.both[0], placed.cells[0])
    assert of_a.kind == "probability"
    assert of_a.knows_cells
    np.testing.assert_array_equal(of_a.values, pair.cells_a)
    assert evidence_of(plain.both[0], plain.cells[0]) is plain.both[0].evidence
