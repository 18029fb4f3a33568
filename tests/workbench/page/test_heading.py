"""What a page says first: what it shows, its scores and how many notes there are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import MaskScores, Overlap, PairScores, Result, StoredAlignment
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.heading import comparison_heading, panorama_heading, uncounted_text
from endoct.workbench.page.opening import _seen

GRID = SurfaceGrid.full_circle(50, 100, z0_mm=0.0, dz_mm=0.02, radius_mm=1.25)


def compared(**changed: Any) -> Result:
    made = Result(
        sides=("endoscope", "oct"),
        aligned=True,
        alignment=StoredAlignment.of(Alignment(1.5, -0.4, confidence=0.49)),
        jaccard=0.691,
        dice=0.8171,
        scores=PairScores(grid=Overlap(jaccard=0.691, dice=0.8171, jaccard_interval=(0.6, 0.79), both_mm2=1.0)),
        valid_fraction=0.9912,
        notes={"endoscope": ("a", "b"), "oct": ("c",)},
        versions={"endoct": "1.2"},
    )
    return made.model_copy(update=changed)


def test_a_comparison_is_headed_by_its_sides_and_scores() -> None:
    outline: Any = SimpleNamespace(
        result=compared(overlap_mm=7.26), alignment=Alignment(1.5, -0.4), grid=GRID, cells=()
    )
    heading = comparison_heading("bore-1", (("made", "today"),), outline)
    assert heading.title == "bore-1: endoscope and oct"
    assert heading.facts == (("made", "today"), ("frame", "θ and z of endoscope"))
    assert heading.verdict.sentences[-1].startswith("Common grid: 50 × 100 samples")
    assert (heading.notes, heading.endoct) == (3, "1.2")
    first, *_, dice, observed = heading.scores
    assert first.title.startswith("Jaccard index on the common grid")
    assert (first.value, first.of) == ("0.691", "95 % interval 0.60 to 0.79")
    assert (dice.title, dice.value) == ("Dice index on the common grid", "0.817")
    assert (observed.value, observed.of) == ("99.1%", "of the 7.3 mm that they share")
    outline.result = compared(truth={"masks/anna.png": {"oct": MaskScores(jaccard=0.5)}})
    scores = comparison_heading("x", (), outline).scores
    assert scores[-1].of == "of the wall"
    assert any(score.title.startswith("Jaccard index of ") and score.value == "0.500" for score in scores)


def test_sides_that_are_not_aligned_have_no_index_and_each_a_frame_of_its_own() -> None:
    result = compared(aligned=False, alignment=None, scores=None, jaccard=None, dice=None, reason="Nothing stood out.")
    outline: Any = SimpleNamespace(result=result, alignment=None, grid=GRID)
    heading = comparison_heading("x", (), outline)
    assert heading.facts == (("frame", "each side its own"),)
    assert [score for score in heading.scores if "Dice" in score.title or "Observed" in score.title] == []
    assert heading.verdict.level == "unaligned"


def test_cells_that_are_not_counted_are_said_by_reason() -> None:
    def cell(side: str, observed: float) -> Any:
        return SimpleNamespace(side=side, observed_by_other=observed, counts=observed >= 0.5)

    names = ("endoscope", "oct")
    cells = [cell("endoscope", 0.0), cell("endoscope", 0.0), cell("endoscope", 0.49), cell("endoscope", 0.5)]
    assert uncounted_text(cells[3:], names) == ""
    assert uncounted_text([*cells, cell("oct", 0.1)], names) == (
        "4 of 5 cells are not counted. Of endoscope: 2 where oct observed nothing, 1 of which oct observed less than "
        "half. Of oct: 1 of which endoscope observed less than half."
    )


@pytest.mark.parametrize(
    ("counts", "is_matched", "state", "said"),
    [
        (False, True, "not observed", "not counted: oct observed 40% of it, where it is oct 3"),
        (False, False, "not observed", "not counted: oct observed 40% of it"),
        (True, True, "matched", "is oct 3: overlap 0.80"),
        (True, False, "overlapping", "overlaps oct 3 by 0.80, less than half"),
    ],
)
def test_a_cell_says_whether_it_counts(counts: bool, is_matched: bool, state: str, said: str) -> None:
    cell: Any = SimpleNamespace(counts=counts, is_matched=is_matched, partner=3, overlap=0.8, observed_by_other=0.4)
    assert _seen(cell, "oct", aligned=True) == (state, said)


@pytest.mark.parametrize(("name", "title"), [("oct", "oct"), ("bore-1", "bore-1: oct")])
def test_a_panorama_is_headed_by_its_modality_and_frames(name: str, title: str) -> None:
    places = SimpleNamespace(values=np.arange(5.0))
    outline: Any = SimpleNamespace(
        modality="oct", frame_dim="slice", per_frame={"slice_z_mm": places}, notes=("a",), provenance={},
        doubts=(Doubt("odd", "Odd."),),
    )  # fmt: skip
    heading = panorama_heading(name, (("made", "today"),), outline)
    assert heading.title == title
    assert heading.facts[:2] == (("made", "today"), ("slices", "5"))
    assert (heading.notes, heading.endoct, heading.scores) == (1, "", ())
    assert heading.verdict.headline == "1 doubt. Unrolled."
    outline.per_frame = {}
    assert panorama_heading(name, (), outline).facts[0] == ("slices", "0")
