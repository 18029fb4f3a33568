"""Sidecars that contradict their pullback, and pullbacks of no catheter at all."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doubted import codes_of
from numpy.typing import NDArray
from tolerances import AGREEING_RTOL

from endoct.base.errors import NotSeen
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.doubts import doubts_of_floor, doubts_of_surface, longest_gaps, plain_wall
from endoct.modalities.oct.surface.background import Background
from endoct.stitching.panorama import Panorama
from tests.modalities.oct.phantom import BORE_MM, CAPILLARY_MM, PIXEL_MM, Phantom
from tests.modalities.oct.unrolling import UnrollPhantom

FAR, AGAINST = "wall-far-from-nominal", "capillary-against-stated"
SMALL = Phantom(n_ascans=512)


def codes(panorama: Panorama) -> list[str]:
    return codes_of(panorama.doubts)


def of_bone(phantom: Phantom, *, plate_px: int) -> NDArray[np.uint8]:
    """Noise, a bright plate off the axis, marrow, and bone: no catheter."""
    rng = np.random.default_rng(3)
    angle = 2 * np.pi * np.arange(phantom.n_ascans) / phantom.n_ascans
    shape = phantom.n_slices, phantom.n_depth, phantom.n_ascans
    below = np.arange(phantom.n_depth)[:, None] - (150 + 25 * np.cos(angle - 1))
    mean = 1 + np.where(below > 0, 150 * np.exp(-np.maximum(below, 0) / 90), 0)
    mean = np.where((below > plate_px) & (below < plate_px + 65), 1, mean)
    return np.clip(60 + 10 * np.log10(mean * rng.exponential(1, shape)) / 0.3, 0, 255).astype(np.uint8)


def test_a_true_sidecar_is_not_doubted(unrolled: UnrollPhantom) -> None:
    assert codes(unrolled(SMALL)[2]) == []


@pytest.mark.parametrize(
    ("key", "true", "factor"),
    [
        ("capillary_outer_diameter_mm", 2 * CAPILLARY_MM, 0.95),
        ("capillary_outer_diameter_mm", 2 * CAPILLARY_MM, 1.05),
        ("bore_diameter_mm", 2 * BORE_MM, 1.03),
        ("axial_pixel_mm", PIXEL_MM, 0.88),
        ("axial_pixel_mm", PIXEL_MM, 1.12),
        ("medium_index", 1.0, 1.12),
    ],
)
def test_a_false_size_is_doubted_with_the_value_that_agrees(
    unrolled: UnrollPhantom, key: str, true: float, factor: float
) -> None:
    panorama = unrolled(replace(SMALL, sidecar={key: true * factor}))[2]
    doubt = next(each for each in panorama.doubts if each.code == FAR)
    assert doubt.value is not None
    assert isinstance(doubt.expected, float)
    assert abs(doubt.value / doubt.expected - 1) > 0.015
    assert f"{key} = " in doubt.what
    agreeing = float(doubt.what.split(f"{key} = ")[1].split()[0].strip(",."))
    assert agreeing == pytest.approx(true, rel=AGREEING_RTOL)


def test_a_capillary_of_half_the_size_does_not_pass(unrolled: UnrollPhantom) -> None:
    false = replace(SMALL, offset_mm=0.2, sidecar={"capillary_outer_diameter_mm": 1.06 * CAPILLARY_MM})
    try:
        panorama = unrolled(false)[2]
    except NotSeen:
        return
    assert {FAR, AGAINST} & set(codes(panorama))


@pytest.mark.parametrize("plate_px", [2, 10])
def test_bone_without_a_catheter_is_refused(unrolled: UnrollPhantom, plate_px: int) -> None:
    with pytest.raises(NotSeen, match="outer face cannot be found"):
        unrolled(SMALL, of_bone(SMALL, plate_px=plate_px))


@pytest.mark.parametrize("missing", [slice(2, 4), slice(0, None, 3)])
def test_slices_that_show_no_catheter_are_not_valid(unrolled: UnrollPhantom, missing: slice) -> None:
    pages: NDArray[Any] = SMALL.log_counts()
    pages[missing] = of_bone(SMALL, plate_px=10)[missing]
    panorama = unrolled(SMALL, pages)[2]
    none = np.zeros(SMALL.n_slices, bool)
    none[missing] = True
    assert not panorama.valid[none].any()
    assert panorama.valid[~none].mean() > 0.95


@pytest.mark.parametrize(
    ("step_rad", "offset_mm", "doubted"), [(0.3, 0.15, True), (0.3, 0.06, True), (0.05, 0.15, False)]
)
def test_a_step_within_every_turn_is_doubted(
    unrolled: UnrollPhantom, step_rad: float, offset_mm: float, doubted: bool
) -> None:
    panorama = unrolled(replace(SMALL, step_rad=step_rad, offset_mm=offset_mm))[2]
    found = [doubt for doubt in panorama.doubts if doubt.code == "turns-uneven"]
    assert bool(found) == doubted
    for doubt in found:
        assert doubt.value is not None
        assert step_rad / 2 - 0.03 < doubt.value < step_rad


def test_the_plain_wall_is_where_it_is_densest_whatever_its_cells_do() -> None:
    rng = np.random.default_rng(0)
    depth_mm = np.concatenate([0.04 + 0.004 * rng.normal(size=5000), rng.uniform(0.1, 1.2, 7000)]).astype(np.float32)
    plain = plain_wall(depth_mm)
    assert plain.beyond_mm == pytest.approx(0.04, abs=0.001)
    assert plain.share == pytest.approx(5 / 12, abs=0.02)


def with_fractions(panorama: Panorama, opening: float, before: float, dark: float) -> Panorama:
    """The panorama as if every slice had these shares of openings, of bone before them, and of dark wall."""
    values = {"opening_fraction": opening, "bone_before_fraction": before, "dark_wall_fraction": dark}
    of_slices = {
        name: replace(panorama.per_frame[name], values=np.full(panorama.grid.n_z, value))
        for name, value in values.items()
    }
    return replace(panorama, per_frame={**panorama.per_frame, **of_slices})


def codes_of_surface(panorama: Panorama) -> list[str]:
    return codes_of(doubts_of_surface(panorama))


def test_what_samples_contradict_is_doubted(unrolled: UnrollPhantom) -> None:
    panorama = unrolled(SMALL)[2]
    assert codes_of_surface(panorama) == []
    assert codes_of_surface(with_fractions(panorama, 0.2, 0.015, 0.0)) == []
    assert codes_of_surface(with_fractions(panorama, 0.2, 0.025, 0.0)) == ["bone-before-surface"]
    assert codes_of_surface(with_fractions(panorama, 0.2, 0.0, 0.06)) == []
    assert codes_of_surface(with_fractions(panorama, 0.2, 0.0, 0.08)) == ["darkness-behind-wall"]
    assert codes_of_surface(with_fractions(panorama, 0.0, 0.0, 0.005)) == [], "hardly any of the wall"


def test_noise_as_uneven_as_the_wall_is_bright_is_doubted() -> None:
    level = np.zeros(50, np.float32)
    for most, doubted in ((4.0, []), (6.0, ["noise-near-wall"])):
        floor = np.linspace(-most / 2, most / 2, 50, dtype=np.float32)
        background = Background(noise=40.0, noise_sigma=5.0, wall=50.0, line_excess=level, floor=floor)
        assert [doubt.code for doubt in doubts_of_floor(background)] == doubted


def test_wall_erased_behind_the_search_is_doubted(unrolled: UnrollPhantom, monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of every turn is taken for an opening: what the second look is for."""
    from endoct.modalities.oct import unroll

    found = unroll.first_edge

    def erasing(*given: Any) -> NDArray[np.intp]:
        row = found(*given).copy()
        row[: row.size // 6], row[-row.size // 6 :] = given[0].shape[1], given[0].shape[1]
        return row

    monkeypatch.setattr(unroll, "first_edge", erasing)
    assert "bone-before-surface" in codes(unrolled(SMALL)[2])


@pytest.mark.parametrize("offset_mm", [0.02, 0.15])
def test_a_nearest_wall_that_is_lost_is_doubted(unrolled: UnrollPhantom, offset_mm: float) -> None:
    panorama = unrolled(replace(SMALL, offset_mm=offset_mm))[2]
    nearest_rad = panorama.per_frame["offset_direction_rad"].values
    for turned_rad, doubted in ((0.0, offset_mm > 0.05), (np.pi, False)):
        away = wrap_rad(panorama.grid.theta_rad - nearest_rad[:, None] - turned_rad)
        lost = replace(panorama, valid=panorama.valid & (np.abs(away) > 0.3))
        assert codes_of_surface(lost) == (["nearest-wall-lost"] if doubted else []) + ["gap-along-pullback"]


@pytest.mark.parametrize(("width_deg", "slices", "doubted"), [(20, 0.9, True), (20, 0.4, False), (3, 1.0, False)])
def test_a_gap_along_the_pullback_is_doubted(
    unrolled: UnrollPhantom, width_deg: float, slices: float, doubted: bool
) -> None:
    panorama = unrolled(SMALL)[2]
    valid = panorama.valid.copy()
    n = round(slices * len(valid))
    column = np.arange(valid.shape[1])
    for row in range(n):  # it winds around the bore, over θ = 0
        valid[row] &= np.mod(column - row, column.size) >= column.size * width_deg / 360
    found = [each for each in doubts_of_surface(replace(panorama, valid=valid)) if each.code == "gap-along-pullback"]
    assert bool(found) == doubted
    for each in found:
        assert each.value == pytest.approx(n / len(valid))
        assert f"{width_deg}° wide" in each.what


def test_slices_without_any_wall_are_no_gap(unrolled: UnrollPhantom) -> None:
    panorama = unrolled(SMALL)[2]
    valid = panorama.valid.copy()
    valid[1:] = False
    assert "gap-along-pullback" not in codes_of_surface(replace(panorama, valid=valid))


def test_a_gap_is_as_long_as_it_is_around_the_circle() -> None:
    rows = ["1111", "0110", "0100", "0000"]
    valid = np.array([[sample == "1" for sample in row] for row in rows])
    assert longest_gaps(valid).tolist() == [0, 2, 3, 4]


def test_a_wrong_first_sample_is_noted(unrolled: UnrollPhantom) -> None:
    right = unrolled(Phantom(sidecar={"first_sample_mm": 0.0}))[1]
    wrong = unrolled(Phantom(sidecar={"first_sample_mm": 0.5}))[1]
    assert not any("first_sample_mm" in note for note in right.notes)
    assert any("first_sample_mm" in note for note in wrong.notes)
