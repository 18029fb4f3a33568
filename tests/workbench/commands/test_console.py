"""What commands say of a comparison."""

from pathlib import Path

import pytest
from mock_comparison import Kind, write_comparison

from endoct.fusion.result import ByLi, Overlap, OwnRows, PairScores
from endoct.workbench.commands.console import print_either, print_result


def test_the_indices_by_lis_threshold_stand_beside_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sides = Kind("endoscope", depth=False), Kind("oct")
    nothing = ByLi(grid=Overlap(), own_rows=OwnRows(rows_of="oct", jaccard=None), threshold={})
    written = write_comparison(tmp_path / "found", *sides)
    write_comparison(tmp_path / "drawn", *sides, scores=written.scores.model_copy(update={"by_li": None}))
    write_comparison(tmp_path / "empty", *sides, scores=PairScores(by_li=nothing))
    said = f"Jaccard index {written.jaccard:.3f}, Dice {written.dice:.3f}"
    for folder, by_li in (
        ("found", "; by Li's threshold alone 0.432 and 0.603"),
        ("drawn", ""),
        ("empty", "; by Li's threshold alone not known and not known"),
    ):
        assert print_result(tmp_path / folder, as_json=False) == 0
        assert capsys.readouterr().out.splitlines()[0] == f"{said}{by_li} (endoscope and oct)"


def test_facts_are_printed_for_programs_and_lines_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    printed = []
    for as_json in (False, True):
        assert print_either({"rows": 2}, ["two rows", "of three"], as_json=as_json) == 0
        printed.append(capsys.readouterr().out)
    assert printed == ["two rows\nof three\n", '{\n "rows": 2\n}\n']
