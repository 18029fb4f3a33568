"""`endoct verify` says of every kind of output whether it is as it was written."""

import shutil
from pathlib import Path

import pytest
from cheap_specimens import Cheap
from mock_comparison import Kind, write_comparison

from endoct.base.errors import EndoctError
from endoct.base.files.contents import NAME
from endoct.base.files.output import new_output
from endoct.workbench.dataset.creation import make_dataset
from endoct.workbench.dataset.plan import DatasetPlan
from endoct.workbench.page.report import write_report
from endoct.workbench.running.outputs import COMPARISON
from endoct.workbench.verifying import Integrity, verify

SET = DatasetPlan(4, seed=3)
SHARDS = DatasetPlan(4, seed=3, format="webdataset", specimens_per_shard=2)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("comparisons") / "result"
    with new_output(folder, COMPARISON) as scratch:
        write_comparison(scratch, Kind("endoscope", depth=False), Kind("oct"))
        write_report(scratch)
    return folder


@pytest.fixture
def comparison(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "result"))


def only(path: Path) -> Integrity:
    (verdict,) = verify(path)
    return verdict


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def test_a_comparison_is_checked_with_its_figures_and_its_page(comparison: Path) -> None:
    verdict = only(comparison)
    assert (verdict.kind, verdict.intact) == ("comparison", True)
    assert only(comparison / "report.html").intact
    assert only(comparison / "figures").intact
    chunk = next(path for path in (comparison / "comparison.zarr" / "mask" / "c").rglob("*") if path.is_file())
    figure = next((comparison / "figures").glob("*.png"))
    (comparison / "cells.csv").unlink(missing_ok=True)
    for path in (chunk, figure, comparison / "report.html"):
        flip(path)
    (comparison / "result.json").unlink()
    (comparison / "notes.txt").write_text("mine")
    found = only(comparison).differences
    assert set(found.altered) == {
        chunk.relative_to(comparison).as_posix(), f"figures/{figure.name}", "report.html",
    }  # fmt: skip
    assert found.missing == ("result.json",)
    assert found.added == ("notes.txt",)
    assert not only(comparison / "report.html").intact


def test_a_report_may_be_written_again_and_replaces_nothing_foreign(comparison: Path) -> None:
    (comparison / "notes.txt").write_text("mine")
    write_report(comparison)
    assert only(comparison).differences.added == ("notes.txt",)
    (comparison / "figures" / "mine.png").write_text("mine")
    with pytest.raises(EndoctError, match=r"figures holds more than endoct wrote.*mine\.png"):
        write_report(comparison)
    (comparison / "figures" / "mine.png").unlink()
    page = comparison / "report.html"
    page.write_text(page.read_text().replace("</h1>", " with a note of mine</h1>"))
    with pytest.raises(EndoctError, match=r"report\.html was not written by endoct, or changed"):
        write_report(comparison)
    assert "a note of mine" in page.read_text()


def test_scratch_of_a_save_that_was_killed_is_no_part(comparison: Path) -> None:
    for place in (".endoct-session.json-x1", "masks/oct/.endoct-anna_1.png-x2", "masks/oct/.endoct.gone-endoct-y-z"):
        (comparison / place / "new").mkdir(parents=True)
        (comparison / place / "lock").write_text("process 1 on a machine\n")
        (comparison / place / "new" / "anna_1.png").write_bytes(b"half")
    assert only(comparison).intact
    (comparison / "masks" / "oct" / ".other").write_text("mine")
    assert only(comparison).differences.added == ("masks/oct/.other",)


def test_a_folder_of_outputs_is_checked_one_by_one(comparison: Path, tmp_path: Path) -> None:
    shutil.copytree(comparison, tmp_path / "other")
    flip(tmp_path / "other" / "result.json")
    assert [(verdict.path.name, verdict.intact) for verdict in verify(tmp_path)] == [("other", False), ("result", True)]


@pytest.mark.parametrize("plan", [SET, SHARDS], ids=["folders", "shards"])
def test_a_data_set_is_checked_by_its_records(plan: DatasetPlan, tmp_path: Path) -> None:
    root = tmp_path / "set"
    make_dataset(root, plan, workers=1, make=Cheap(tmp_path / "log"))
    assert only(root).intact
    if plan is SET:
        flip(root / "specimens/000001/oct/pullback.tif")
        (root / "specimens/000002/truth/sample.json").unlink()
        (root / "specimens/000003/notes.txt").write_text("mine")
        found = only(root).differences
        assert found.altered == ("specimens/000001/oct/pullback.tif",)
        assert found.missing == ("specimens/000002/truth/sample.json",)
        assert found.added == ("specimens/000003/notes.txt",)
        assert not only(root / "specimens/000001").intact
        assert only(root / "specimens/000000").intact
    else:
        flip(root / "shards/train-000000.tar")
        assert only(root).differences.altered == ("shards/train-000000.tar",)
        assert not only(root / "shards/train-000000.tar").intact
    flip(root / "manifest.csv")
    assert "manifest.csv" in only(root).differences.altered
    (next((root / "records").iterdir())).unlink()
    assert any("specimens" in name for name in only(root).differences.missing)


def test_a_data_set_without_its_specimens_lacks_them(tmp_path: Path) -> None:
    root = tmp_path / "set"
    make_dataset(root, SET, workers=1, make=Cheap(tmp_path / "log"))
    shutil.rmtree(root / "specimens")
    (verdict,) = verify(root, progress=False)
    assert not verdict.intact
    assert verdict.differences.missing


def test_strangers_in_a_data_set_are_told(tmp_path: Path) -> None:
    root = tmp_path / "set"
    make_dataset(root, SET, workers=1, make=Cheap(tmp_path / "log"))
    (root / "notes.txt").write_text("mine")
    (root / "specimens" / "000000x").mkdir()
    (root / "records" / "loose.txt").write_text("")
    (root / ".written.json").unlink()
    (root / "contact_sheet.png").unlink()
    found = only(root).differences
    assert found.added == ("notes.txt", "records/loose.txt", "specimens/000000x")
    assert found.missing == (".written.json", "contact_sheet.png")


def test_an_output_that_lost_its_list_is_told(comparison: Path) -> None:
    (comparison / NAME).unlink()
    shutil.copytree(comparison / "figures", comparison.parent / "figures")
    verdicts = {verdict.path.name: verdict for verdict in verify(comparison.parent)}
    assert verdicts["figures"].intact
    assert verdicts["result"].differences.missing == (NAME,)


def test_another_output_is_no_part(comparison: Path) -> None:
    (comparison / "report.html").unlink()
    shutil.copytree(comparison / "figures", comparison / "report.html")
    assert only(comparison).differences.altered == ("report.html",)


def test_what_is_no_output_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("")
    for path in (tmp_path, tmp_path / "thesis.tex", tmp_path / "nowhere"):
        with pytest.raises(EndoctError, match="is no output of endoct's"):
            verify(path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / NAME).write_text('{"format": "endoct-output-1"}')
    with pytest.raises(EndoctError, match="is damaged"):
        verify(tmp_path / "out")


@pytest.mark.parametrize("name", ["result.json", "zarr.json", "truth"])
def test_what_lost_its_list_and_its_mark_is_not_passed_over(tmp_path: Path, name: str) -> None:
    """A comparison without its store, a panorama whose metadata are damaged, a specimen without its sample."""
    (tmp_path / "output").mkdir()
    (tmp_path / "output" / name).write_text("damaged")
    (verdict,) = verify(tmp_path)
    assert not verdict.intact
    assert verdict.kind == "output without its list"
