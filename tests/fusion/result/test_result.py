"""What a result says in JSON: the same again when read and written, whichever version wrote it."""

import json
import re
from typing import Any

import pytest
from pydantic import ValidationError

from benchmarks.fuzz.seed_results import comparison_files
from endoct.base.doubt import Doubt
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.fusion.result import NotVisible, Overlap, OwnRows, PairScores, Result, StoredAlignment, Strata, Stratum

SMALLEST = {"sides": ["a", "b"], "aligned": False, "alignment": None, "jaccard": None, "dice": None}


def stored(*, aligned: bool = True) -> dict[str, Any]:
    """Return a result with everything in it: truth, raters, a corrected twist, a budget, strata."""
    found: dict[str, Any] = json.loads(comparison_files(aligned=aligned)["result.json"])
    return found


@pytest.mark.parametrize("aligned", [True, False])
def test_what_is_read_is_written_again_in_the_same_order(aligned: bool) -> None:
    before = stored(aligned=aligned)
    result = Result.model_validate(before)
    assert json.dumps(result.to_json()) == json.dumps(before)
    assert Result.model_validate(result.to_json()) == result


def test_what_was_not_stated_is_absent_and_what_is_not_there_is_null() -> None:
    smallest = SMALLEST | {"valid_fraction": 0.5}
    assert Result.model_validate(smallest).to_json() == smallest
    explicit = smallest | {"reason": None, "scores": None, "budget": None}
    assert Result.model_validate(explicit).to_json() == explicit


def test_keys_of_another_version_are_kept() -> None:
    later = stored() | {"later": {"list": [1, 2.5, None], "deeper": {"text": "x"}}}
    later["scores"]["grid"]["later"] = 3
    assert Result.model_validate(later).to_json() == later


def test_the_json_of_parts() -> None:
    assert NotVisible(cells=0, area_mm2=sum(())).model_dump_json() == '{"cells":0,"area_mm2":0}'
    rows = OwnRows(rows_of="oct", jaccard=None)
    (row,) = Strata(diameter_mm=(Stratum(low=None, to=0.3, sites=2, jaccard=0.1, jaccard_interval=None),)).diameter_mm
    scores = PairScores(grid=Overlap(jaccard=0.5, jaccard_interval=(0.25, 0.75)), strata=Strata(depth_mm=(row,)))
    result = Result.model_validate(SMALLEST | {"valid_fraction": 1})
    written = result.model_copy(update={"scores": scores.model_copy(update={"own_rows": rows})}).to_json()["scores"]
    assert written == {
        "grid": {"jaccard": 0.5, "jaccard_interval": [0.25, 0.75]},
        "strata": {"depth_mm": [{"from": None, "to": 0.3, "sites": 2, "jaccard": 0.1, "jaccard_interval": None}]},
        "own_rows": {"rows_of": "oct", "jaccard": None},
    }
    assert list(scores.strata.by_kind()) == ["depth_mm"]


def test_the_overlap_is_that_of_the_grid_where_the_sides_are_aligned() -> None:
    aligned = Result.model_validate(stored())
    assert aligned.overlap == aligned.scores.grid
    assert Result.model_validate(stored(aligned=False)).overlap is None
    alignment = StoredAlignment.of(Alignment(0.1, 0.2))
    older = Result(
        sides=("a", "b"), aligned=True, alignment=alignment, jaccard=0.5, dice=0.6, valid_fraction=1.0, scores=None
    )
    assert (older.overlap.jaccard, older.overlap.dice, older.own_rows_jaccard) == (0.5, 0.6, None)


def test_a_result_is_shown_in_one_line() -> None:
    assert re.fullmatch(r"<Result of endoscope and oct: Jaccard index 0\.\d{3}>", repr(Result.model_validate(stored())))
    assert str(Result.model_validate(stored(aligned=False))) == "<Result of endoscope and oct: not aligned>"


def test_a_result_is_completed_by_how_it_was_made() -> None:
    doubt = {"code": "odd", "side": "a", "what": "d", "value": 0.5, "unit": "1", "expected": [0.9, 1.0]}
    result = Result.model_validate(SMALLEST | {"valid_fraction": 1.0, "doubts": [doubt]})
    made = result.completed(
        truth={}, raters=None, notes={"a": ("n",), "b": ()}, versions={"endoct": "1"}, inputs={"x": "d"},
        parameters={"compare": {"force": True}}, seconds={"align": 1.0},
    )  # fmt: skip
    assert made.notes == {"a": ("n",), "b": ()}
    assert made.doubts == (Doubt("odd", "d", "a", 0.5, "1", (0.9, 1.0)),)
    assert made.to_json()["doubts"] == [doubt]
    assert made.forced
    assert not {"truth", "raters", "twist"} & made.to_json().keys()
    assert list(made.to_json())[-5:] == ["notes", "versions", "inputs", "parameters", "seconds"]


@pytest.mark.parametrize(
    "changed",
    [
        {"doubts": {"a": "text"}}, {"doubts": [3]}, {"doubts": [{"code": "A B", "what": "x"}]}, {"doubts": "x"},
        {"aligned": True}, {"aligned": 1}, {"sides": ["a"]}, {"valid_fraction": None}, {"jaccard": True},
        {"parameters": {"compare": None}}, {"raters": {"pairs": [], "consensus": {}}},
        {"scores": {"strata": {"colour": []}}}, {"scores": {"own_rows": {"jaccard": 0.5}}}, {"seconds": {"x": 1e13}},
    ],
)  # fmt: skip
def test_what_is_no_result(changed: dict[str, object]) -> None:
    Result.model_validate(SMALLEST | {"valid_fraction": 1.0})
    with pytest.raises(ValidationError):
        Result.model_validate(SMALLEST | {"valid_fraction": 1.0} | changed)


def test_a_bend_is_stored_read_and_refused_where_it_is_none() -> None:
    bent = Alignment(0.1, 0.2, bend=Bend((0.0, 1.0), (0.0, 0.1), (0.2, 0.0), (0.01, 0.02), (0.03, 0.04)))
    stored = StoredAlignment.of(bent)
    assert stored is not None
    assert stored.to_alignment() == bent
    text = stored.model_dump_json()
    assert StoredAlignment.model_validate_json(text).to_alignment() == bent
    with pytest.raises(ValueError, match="bend of an alignment is none"):
        StoredAlignment.model_validate_json(text.replace("[0.0,0.1]", "[0.0,-1.1]"))
    assert Alignment(0.1, 0.2) == StoredAlignment.of(Alignment(0.1, 0.2)).to_alignment()  # type: ignore[union-attr]
