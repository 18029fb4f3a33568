"""Tables of a report, and its numbers in words: by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.fusion.result import (
    ByHand,
    CellScores,
    CuttingPlane,
    Distances,
    Limits,
    Moved,
    Overlap,
    PairDistance,
    PlacedPair,
    Result,
    StoredAlignment,
    StoredPlace,
    Threshold,
)
from endoct.fusion.result.scores import BoundaryScores, Scores
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report import tables
from endoct.workbench.report.findings import NamedOverlap
from endoct.workbench.report.sections import comparison_sections
from endoct.workbench.report.wording import interval_text, key_text, leaf_rows, value_text, without_stop

ALIGNMENT = StoredAlignment(
    theta_shift_rad=-0.5, z_shift_mm=1.2345, z_scale=1.02, mirrored=True, z_reversed=False, confidence=0.9123,
    correlation=0.5, ratio=12.345, chance=1.5e-7, overlap_mm2=20.456, uneven_rad=0.01, twist_rad_per_mm=-0.002,
    covariance=((1e-4, 0, 0), (0, 4e-6, 0), (0, 0, 9e-6)),
)  # fmt: skip


def test_planes_are_said_in_degrees_with_their_standard_errors() -> None:
    plane = CuttingPlane(
        z_mm=12.3456, dip_rad=0.5, azimuth_rad=1.0, z_error_mm=0.0123, dip_error_rad=0.02, azimuth_error_rad=0.03,
        support=0.914, radius_mm=1.25,
    )  # fmt: skip
    result = Result(
        sides=("a", "b"), aligned=False, alignment=None, jaccard=None, dice=None, valid_fraction=1.0,
        planes={"b": (plane,)},
    )  # fmt: skip
    assert tables.plane_rows(result) == [["b", "12.346 mm ± 0.012 mm", "28.6° ± 1.1°", "57.3° ± 1.7°", "91%"]]
    html = {section.name: section.html for section in comparison_sections(result)}
    assert "57.3° ± 1.7°" in html["agreement"]
    assert "Planes" not in comparison_sections(result.model_copy(update={"planes": {}}))[0].html


def test_an_alignment_is_said_in_degrees_and_mm_with_its_standard_errors() -> None:
    said = dict(tables.alignment_rows(ALIGNMENT))
    assert list(said.values()) == [
        "−28.65° ± 0.57°", "1.234 mm ± 0.002 mm", "1.0200 ± 0.0030", "yes", "no", "0.912", "0.500", "12.3", "1.5e−07",
        "20.46 mm²", "0.57°", "−0.11° per mm",
    ]  # fmt: skip
    assert said["Mirrored in θ"] == "yes"
    by_hand = list(tables.alignment_rows(ALIGNMENT, by_hand=True))
    assert [value for _, value in by_hand] == [*list(said.values())[:5], "0.500", "20.46 mm²"]
    for unknown in (None, ((-1e-9, 0, 0), (0, 1, 0), (0, 0, 1))):
        plain = dict(tables.alignment_rows(ALIGNMENT.model_copy(update={"covariance": unknown, "ratio": None})))
        assert plain["Turned by"] == "−28.65°"
        assert plain["Scaled along the bore by"] == "1.0200"
        assert plain["Score over that of the next best place"] == "–"


def test_overlaps_have_no_columns_of_which_nothing_is_known() -> None:
    whole = Overlap(jaccard=0.5, dice=2 / 3, both_mm2=1.0, only_a_mm2=0.25, only_b_mm2=0.75, neither_mm2=9.0, sites=7)
    of = "endoscope", "oct"
    header, rows = tables.overlap_table([NamedOverlap(of, "on the grid", whole), NamedOverlap(of, "by Li", Overlap())])
    assert header == ["", "Jaccard", "Dice", "Both", "Only one", "Neither", "Places"]
    assert rows[0] == [
        "endoscope and oct, on the grid", "0.500", "0.667", "1.00 mm²", "endoscope 0.25 mm², oct 0.75 mm²", "9.00 mm²",
        "7",
    ]  # fmt: skip
    assert rows[1] == ["endoscope and oct, by Li", *["–"] * 6]
    assert tables.overlap_table([NamedOverlap(of, "by Li", Overlap())])[0] == ["", "Jaccard", "Dice"]


@pytest.mark.parametrize(
    ("threshold", "text"),
    [
        (None, "–"),
        (Threshold(), "as given"),
        (Threshold(of="relief.", value=0.0312, unit="mm"), "relief, above 0.0312 mm"),
        (Threshold(of="probability", value=0.4, unit="1"), "probability, above 0.4"),
        (
            Threshold.model_validate(
                {"of": "darkness", "value": 1, "by_depth": {"known": 0.8, "added": 0.012, "dropped": 0.2}}
            ),
            "darkness, above 1; depth, known on 80%, added 1.2% of the wall and dropped 20.0%",
        ),
    ],
)
def test_what_cells_were_segmented_by(threshold: Threshold | None, text: str) -> None:
    assert tables.threshold_text(threshold) == text


def test_a_side_is_told_by_what_of_it_was_observed() -> None:
    valid = np.ones((4, 10), np.bool_)
    valid[0] = False
    mask = np.zeros_like(valid)
    mask[1, :6] = True
    mask[0] = True  # not observed
    depth = np.linspace(-0.1, 0.9, 40).reshape(4, 10)
    panorama = SimpleNamespace(frame_dim="slice", grid=SimpleNamespace(n_z=4, n_theta=10), valid=valid[:2])
    side: Any = SimpleNamespace(
        name="oct", panorama=panorama, mask=mask, valid=valid, depth_mm=depth, frame_z_mm=np.arange(3.0)
    )
    result: Any = SimpleNamespace(threshold=None, polarity={"oct": "dark"})
    said = tables._side_facts(side, result)
    low, high = np.percentile(depth[1:], (5, 95))
    assert list(said.values()) == [
        "3 slices", "4 × 10 samples", "50.0%", "75.0%", "20.0%", f"{low:.3f} to {high:.3f} mm", "–", "dark",
    ]  # fmt: skip
    bare = SimpleNamespace(**{**vars(side), "frame_z_mm": np.arange(1.0), "valid": ~valid & False, "depth_mm": depth})
    said = tables._side_facts(bare, SimpleNamespace(threshold={}, polarity=None))  # type: ignore[arg-type]
    assert [said[name] for name in ("Recorded", "Cells, of the wall it observed", "Cells look")] == [
        "1 slice",
        "–",
        "–",
    ]
    assert said["Depth, 5th to 95th percentile"] == "–"


def test_the_grid_and_thresholds_are_said() -> None:
    grid = SurfaceGrid.full_circle(50, 100, z0_mm=0.0, dz_mm=0.02, radius_mm=1.25)
    result: Any = SimpleNamespace(sides=("a", "b"), threshold={"b": Threshold(of="relief", value=0.1, unit="mm")})
    assert tables.conditions(result, grid) == (
        "Common grid: 50 × 100 samples (z × θ), 20 µm along the bore and 78.5 µm around it at a bore radius of "
        "1.250 mm. "
        "Cells of b: relief, above 0.1 mm."
    )


def pair(role: str, apart: float | None, name: str = "") -> PlacedPair:
    place = StoredPlace(theta_rad=1.0, z_mm=2.0)
    after = None if apart is None else PairDistance(around_mm=apart, along_mm=-apart, distance_mm=apart)
    return PlacedPair.model_validate(
        {"name": name, "role": role, "a": place, "b": place, "sigma_mm": 0.1, "before": None, "after": after}
    )


def distances(n: int) -> Distances:
    rest = {"around_median_mm": 0.1, "around_max_mm": 0.1, "along_median_mm": 0.1, "along_max_mm": 0.1}
    return Distances(pairs=n, median_mm=0.05, max_mm=0.0789, **rest)


BY_HAND = ByHand(
    corrected=True, automatic=None, pairs=(pair("correct", 0.01, "rim"), pair("correct", None), pair("check", -0.2)),
    moved=Moved(around_mm=-0.25, along_mm=0.125, turn_rad=0.1, z_scale=1.0), correct=distances(2), check=distances(3),
)  # fmt: skip


def test_what_landmark_pairs_did_is_said_in_a_headline_sentences_and_rows() -> None:
    three = "3 pairs that had no part in it lie 0.050 mm off (median), 0.079 mm at most"
    assert tables.by_hand_headline(BY_HAND) == f"Corrected by 2 landmark pairs; {three}."
    assert list(tables.by_hand_sentences(BY_HAND)) == [
        "By hand it was moved by +0.125 mm along and −0.250 mm around the bore, amid the pairs, against the automatic "
        "alignment.",
        "The pairs that corrected it lie 0.050 mm apart (median) since; that is no error of the alignment, which "
        "followed them.",
        f"{three}.",
    ]
    assert tables.pair_rows(BY_HAND) == [
        ["1 rim", "corrects", "–", "–", "+0.010 mm", "−0.010 mm"],
        ["2", "corrects", "–", "–", "–", "–"],
        ["3", "checks", "–", "–", "−0.200 mm", "+0.200 mm"],
    ]
    asked = BY_HAND.model_copy(
        update={"corrected": False, "automatic_reason": "none", "check": distances(1), "pairs": BY_HAND.pairs[1:]}
    )
    one = "1 pair that had no part in it lies 0.050 mm off"
    assert tables.by_hand_headline(asked) == f"Aligned by hand, by 1 landmark pair; {one}."
    assert list(tables.by_hand_sentences(asked)) == [f"{one}."]
    assert [row[1] for row in tables.pair_rows(asked)] == ["would correct", "checks"]
    unchecked = asked.model_copy(update={"check": None})
    assert "no pair was set apart to check it" in tables.by_hand_headline(unchecked)
    assert list(tables.by_hand_sentences(unchecked)) == []


def test_scores_of_outlines_and_cells_are_rows_with_intervals() -> None:
    boundary = BoundaryScores(
        mean_mm=0.0361, mean_interval_mm=(0.027, 0.046), p95_mm=0.1, within_share=0.7, within_interval=(0.5, 0.9),
        tolerance_mm=0.05,
    )  # fmt: skip
    cells = CellScores(
        of_reference=21, of_other=18, matched=15, precision=0.8, precision_interval=(0.6, 0.9), recall=0.7, quality=0.6
    )
    limits = Limits(pairs=4, bias=-0.018, low=-0.194, high=0.158)
    rows = list(
        tables._rows({("a", "b"): Scores(boundary=boundary, cells=cells, area_mm2=limits), ("a", "c"): Scores()})
    )
    assert rows == [
        ["Outlines, mean distance", "0.036 mm (0.027 to 0.046)", "–"],
        ["Outlines, 95th percentile", "0.100 mm", "–"],
        ["Outlines within 0.05 mm of each other", "0.700 (0.50 to 0.90)", "–"],
        ["Cells counted", "a 21, b 18", "–"],
        ["Cells matched", "15", "–"],
        ["Cells, precision", "0.800 (0.60 to 0.90)", "–"],
        ["Cells, recall", "0.700", "–"],
        ["Cells, quality", "0.600", "–"],
        ["Area of matched cells, difference", "b − a: −0.018 mm² (95 % within −0.194 to 0.158, 4 cells)", "–"],
    ]
    assert list(tables._rows({("a", "b"): Scores()})) == []


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("jaccard", 0.12345, "0.123"),
        ("z_shift_mm", -1.23456, "−1.235 mm"),
        ("z_shift_mm", 0.0004, "0.0004 mm"),
        ("z_shift_mm", 0.0005, "0.001 mm"),
        ("z_shift_mm", 0.0, "0.000 mm"),
        ("area_mm2", 2.345, "2.35 mm²"),
        ("turn_rad", 0.5, "0.5000 rad (28.65°)"),
        ("twist_rad_per_mm", 0.5, "0.5000 rad per mm (28.65° per mm)"),
        ("rate_hz", 12345.678, "1.235e+04 Hz"),
        ("a", 0.123456, "0.1235"),
        ("a", float("nan"), "–"),
        ("a", None, "–"),
        ("a", True, "yes"),
        ("size_px", 7, "7 px"),
        ("size", 7, "7"),
        ("of_mm", [1.0, 2.0], "1.000 mm, 2.000 mm"),
        ("of_mm", [], "–"),
        ("a", "some text", "some text"),
    ],
)
def test_values_have_the_unit_and_digits_of_their_names(name: str, value: object, text: str) -> None:
    assert value_text(name, value) == text


def test_words_are_made_of_keys() -> None:
    assert key_text("z_shift_mm") == "z shift"
    assert key_text("twist_rad_per_mm") == "twist"
    assert key_text("turns_per_mm") == "turns"
    assert key_text("mm") == "mm"
    assert list(leaf_rows({"a_b": {"c_mm": 1.0, "d": {"e": True}}, "f": 2})) == [
        ("a b › c", "1.000 mm"), ("a b › d › e", "yes"), ("f", "2"),
    ]  # fmt: skip
    assert interval_text((-0.5, 0.25)) == "95 % interval −0.50 to 0.25"
    assert interval_text((0.0, 1.0), 1) == "95 % interval 0.0 to 1.0"
    assert interval_text(None) == ""
    assert without_stop(" It is. ") == "It is"
    assert without_stop(None) == ""
