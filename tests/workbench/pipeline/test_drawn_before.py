"""Specimens whose cells somebody drew: what their comparisons say of the error of the next one."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from bore_pairs import make_pair

from endoct.base.errors import EndoctError
from endoct.fusion.files.result_file import read_result
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import Bounded, Bounds, Consensus, Features, MaskScores, Raters, Result, StoredAlignment
from endoct.workbench import compare, summarise
from endoct.workbench.commands.console import print_result
from endoct.workbench.pipeline.drawn_before import calibration_by
from endoct.workbench.report.verdict import verdict_of

FEATURES = Features(
    jaccard=0.8, alignment=0.05, cell_mm2=0.3, outline_per_mm=5, depth_mm=0.3, wall_spread_mm=0.01, contrast=5
)
BOUNDS = Bounds(
    light=Bounded(of="endoscope", expected=0.9, low=0.85, high=0.93),
    depth=Bounded(of="oct", expected=0.8),
    wall=Bounded(of="wall", expected=0.95),
    area_mm2=Bounded(of="wall", expected=10),
    features=FEATURES,
    level=0.9,
)


def scores(endoscope: float | None, oct_: float | None) -> dict[str, MaskScores]:
    return {"endoscope": MaskScores(jaccard=endoscope), "oct": MaskScores(jaccard=oct_)}


def write(
    folder: Path,
    truth: Mapping[str, dict[str, MaskScores]] | None,
    bounds: Bounds | None = BOUNDS,
    raters: Raters | None = None,
) -> Path:
    folder.mkdir()
    result = Result(
        sides=("endoscope", "oct"),
        aligned=True,
        alignment=StoredAlignment.of(Alignment(0.1, 0.2, confidence=0.5)),
        jaccard=0.8,
        dice=0.89,
        bounds=bounds,
        valid_fraction=1.0,
    ).model_copy(update={"truth": truth, "raters": raters})
    (folder / "result.json").write_text(json.dumps(result.to_json()))
    return folder


def test_each_side_is_held_against_its_mask_or_the_raters_majority(tmp_path: Path) -> None:
    folders = [write(tmp_path / f"s{k}", {"mask.png": scores(0.7 + k / 100, 0.6)}) for k in range(8)]
    both = {"anna_1.png": scores(0.1, 0.1), "ben_1.png": scores(0.2, 0.2)}
    raters = Raters(pairs=(), consensus={"majority": Consensus(method="", sides=scores(0.95, 0.65))})
    by = calibration_by([*folders, write(tmp_path / "raters", both, raters=raters)])
    assert by.by == "9 specimens with drawn masks"
    assert by.known[3].truth == pytest.approx({"light": 0.73, "depth": 0.6})
    assert by.known[8].truth == pytest.approx({"light": 0.95, "depth": 0.65})
    assert by.known[0].expected == BOUNDS


@pytest.mark.parametrize(
    ("truth", "bounds", "said"),
    [
        (None, BOUNDS, "no mask given as truth"),
        ({"a.png": scores(0.7, None)}, BOUNDS, "no mask given as truth"),
        ({"a.png": scores(0.7, 0.6)}, None, "no wall of both sides"),
    ],
)
def test_what_says_nothing_of_the_error_is_refused_by_name(
    tmp_path: Path, truth: dict[str, dict[str, MaskScores]] | None, bounds: Bounds | None, said: str
) -> None:
    folders = [write(tmp_path / f"s{k}", {"mask.png": scores(0.7, 0.6)}) for k in range(8)]
    with pytest.raises(EndoctError, match=said) as raised:
        calibration_by([*folders, write(tmp_path / "odd", truth, bounds)])
    assert str(tmp_path / "odd") in str(raised.value)
    with pytest.raises(EndoctError, match="9 or more"):
        calibration_by(folders)


def test_a_comparison_is_bounded_by_those_that_it_names(tmp_path: Path) -> None:
    pair = make_pair()
    folders = [write(tmp_path / f"s{k}", {"mask.png": scores(0.7, 0.6)}) for k in range(9)]
    result = compare(pair.a, pair.b, known=folders, progress=False).result
    assert result.bounds is not None
    assert (result.bounds.calibrated_by, result.bounds.specimens) == ("9 specimens with drawn masks", 9)
    assert result.bounds.alike == pytest.approx(0.1)  # nine that are all the same
    assert result.bounds.light.low is None
    assert result.doubts[0].code == "error-not-bounded"
    assert str(folders[3] / "result.json") in result.inputs
    assert str(folders[0]) not in str(compare(pair.a, pair.b, progress=False).result.inputs)
    with pytest.raises(EndoctError, match="9 or more"):
        compare(pair.a, pair.b, known=folders[:8])


def test_what_is_expected_is_a_row_of_a_summary(tmp_path: Path) -> None:
    folders = [write(tmp_path / "with", None), write(tmp_path / "older", None, bounds=None)]
    rows = {(row["score"], str(row["specimen"])): row for row in summarise(folders)["scores"]}
    light, depth = rows["expected_light", "with"], rows["expected_depth", "with"]
    assert (light["value"], light["low"], light["high"]) == pytest.approx((0.9, 0.85, 0.93))
    assert (depth["value"], depth["low"], depth["high"]) == (0.8, None, None)
    assert rows["expected_wall", "older"]["value"] is None


def test_what_is_expected_is_said_on_the_console_and_in_the_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write(tmp_path / "with", None)
    print_result(folder, as_json=False)
    said = capsys.readouterr().out
    assert BOUNDS.sentence in said
    assert "endoscope 0.90 (0.85–0.93), oct 0.80, wall 0.95" in said
    assert BOUNDS.sentence in verdict_of(read_result(folder)).sentences
    older = read_result(write(tmp_path / "older", None, bounds=None))
    assert not any("to expect" in sentence for sentence in verdict_of(older).sentences)
