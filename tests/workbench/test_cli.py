"""The command line as users run it, on one simulated specimen."""

import csv
import json
import re
import shutil
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr
import zarr
from made_once import MadeOnce

from endoct.base.errors import EndoctError
from endoct.fusion.files.masks import read_mask
from endoct.stitching.store import load_panorama
from endoct.workbench import cli, compare, unroll

Run = Callable[..., tuple[int, str]]
COARSE = "--set", "n_theta=512"
"""For what does not depend on how fine the common grid is."""

OCT_PER_SLICE = {
    "sine_amplitude_mm",
    "sine_omega",
    "sine_phase_rad",
    "sine_offset_mm",
    "offset_mm",
    "offset_direction_rad",
    "inlier_fraction",
    "residual_mm",
    "bridged",
}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run one command line; return its status and what it printed to stdout."""

    def run_once(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
        with pytest.raises(SystemExit) as leave:
            cli.main()
        return int(leave.value.code or 0), capsys.readouterr().out

    return run_once


@pytest.mark.parametrize(("columns", "widest"), [("1", 40), ("0", 500), ("100000000", 500)])
def test_help_fits_a_terminal_of_sensible_width(
    run: Run, monkeypatch: pytest.MonkeyPatch, columns: str, widest: int
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    status, said = run("info", "--help")
    assert status == 0
    (line,) = (line for line in said.splitlines() if "--modality" in line)  # of the table, which has all columns
    assert 30 < len(line) <= widest


@pytest.fixture(scope="module")
def compared(quick_specimen: Path, made_once: MadeOnce) -> Path:
    return made_once("comparison", lambda folder: compare(quick_specimen / "endoscope", quick_specimen / "oct", folder))


def test_compare_writes_what_the_design_fixes(compared: Path, quick_specimen: Path) -> None:
    result = json.loads((compared / "result.json").read_text())
    assert result["sides"] == ["endoscope", "oct"]
    assert result["aligned"] is True
    assert result["reason"] is None
    assert {"theta_shift_rad", "z_shift_mm", "z_scale", "mirrored", "z_reversed", "confidence"} <= set(
        result["alignment"]
    )
    assert {"value", "unit", "of", "by_depth"} == set(result["threshold"]["oct"])
    assert {"versions", "inputs", "parameters", "seconds", "valid_fraction", "scores"} <= set(result)
    assert str(quick_specimen / "oct" / "pullback.tif") in result["inputs"]
    with xr.open_zarr(compared / "comparison.zarr") as stored:
        assert stored["mask"].dims == ("side", "z", "theta")
        assert stored.sizes["theta"] == 2048
        assert list(stored["side"].values) == ["endoscope", "oct"]
        assert np.isnan(stored["depth_mm"].sel(side="endoscope")).all()
        mask, valid = stored["mask"].values.astype(bool), stored["valid"].values.astype(bool)
    both = valid[0] & valid[1]
    # the Jaccard index that is told is that of the masks that are stored
    told = (mask[0] & mask[1] & both).sum() / ((mask[0] | mask[1]) & both).sum()
    assert told == pytest.approx(result["jaccard"], abs=1e-6)
    assert (compared / "report.html").is_file()
    assert list((compared / "figures").glob("*.png"))


def test_compare_says_what_stands_in_the_way_of_full_agreement(compared: Path) -> None:
    result = json.loads((compared / "result.json").read_text())
    parts = result["budget"]["parts"]
    assert sum(part["share"] for part in parts.values()) == pytest.approx(1 - result["jaccard"])
    low, high = result["scores"]["grid"]["jaccard_interval"]
    assert low < result["jaccard"] < high
    assert result["scores"]["boundary"]["mean_mm"] < 0.3
    assert 0 < result["scores"]["cells"]["quality"] < 1
    assert {"budget.png", "scores.png"} <= {path.name for path in (compared / "figures").iterdir()}
    page = (compared / "report.html").read_text()
    assert "What stands in the way of full agreement" in page
    with (compared / "cells.csv").open() as file:
        cells = list(csv.DictReader(file))
    assert {cell["side"] for cell in cells} == {"endoscope", "oct"}
    with xr.open_zarr(compared / "comparison.zarr") as stored:
        assert stored["cells"].shape[0] == len(cells)
        assert float(stored["cells"].sel(property="area_mm2")[0]) == pytest.approx(
            float(cells[0]["area_mm2"]), rel=1e-5
        )


def test_masks_of_several_raters(tmp_path: Path, run: Run) -> None:
    rng = np.random.default_rng(1)
    cells = np.zeros((100, 256), np.uint8)
    for _ in range(20):
        cv2.circle(cells, (int(rng.integers(256)), int(rng.integers(100))), int(rng.integers(3, 8)), 255, -1)
    for name in ("one", "two"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), cells)
        sidecar = 'modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.04\n'
        (tmp_path / f"{name}.toml").write_text(sidecar)
    drawn = []
    for name, width in (("anna_1", 1), ("anna_2", 1), ("bea_1", 5)):
        drawn.append(tmp_path / f"{name}.png")
        cv2.imwrite(str(drawn[-1]), np.roll(cv2.dilate(cells, np.ones((width, width))), name == "anna_2", axis=1))
    arguments = ("compare", tmp_path / "one.png", tmp_path / "two.png", "-o", tmp_path / "c")
    status, said = run(*arguments, "--truth", *drawn, "--json")
    assert status == 0
    raters = json.loads(said)["raters"]
    assert raters["within"]["pairs"] == 1
    assert raters["between"]["pairs"] == 2
    assert raters["within"]["jaccard"] > raters["between"]["jaccard"]
    assert set(raters["consensus"]) == {"majority", "staple"}
    assert raters["consensus"]["majority"]["sides"]["mask-1"]["jaccard"] > 0.6
    assert "Two raters" in (tmp_path / "c" / "report.html").read_text()
    # what they agree on can be read as a mask again
    consensus = read_mask(tmp_path / "c" / "consensus.png")
    assert consensus.rater == "consensus"
    assert consensus.grid.n_theta == 2048
    (tmp_path / "more").mkdir()
    twice = tmp_path / "more" / "anna_1.png"
    twice.write_bytes(drawn[0].read_bytes())
    assert run(*arguments, "--overwrite", "--truth", drawn[0], twice)[0] == 1
    assert (tmp_path / "c" / "report.html").is_file()


def test_demo_seed_scores_as_the_paper_or_better(compared: Path) -> None:
    # the paper had 0.736 between a mask drawn by hand and its OCT
    assert json.loads((compared / "result.json").read_text())["scores"]["own_rows"]["jaccard"] > 0.736


def test_unroll_writes_a_panorama_that_xarray_reads(short: Path, tmp_path: Path, run: Run) -> None:
    store = tmp_path / "oct.zarr"
    status, said = run("unroll", short / "oct", "-o", store, "--volume", "--json")
    assert status == 0
    facts = json.loads(said)
    with xr.open_zarr(store) as stored:
        assert stored["intensity"].dims == ("z", "theta")
        assert stored["depth_mm"].shape == (facts["rows"], facts["columns"])
        assert set(stored.data_vars) >= OCT_PER_SLICE
        assert "slice_z_mm" in stored.coords
    volume = zarr.open_group(store / "volume", mode="r")
    (cylinder,) = (array for name, array in volume.arrays() if array.ndim == 3)
    assert cylinder.shape[:2] == (facts["rows"], facts["columns"])
    assert cylinder.chunks[0] == 1
    assert run("unroll", short / "oct", "-o", store)[0] == 1
    assert run("info", store)[0] == 0


def test_python_and_command_line_give_the_same(short: Path, tmp_path: Path, run: Run) -> None:
    assert run("unroll", short / "endoscope", "-o", tmp_path / "e.zarr")[0] == 0
    stored = load_panorama(tmp_path / "e.zarr")
    made = unroll(short / "endoscope")
    assert np.array_equal(stored.intensity, made.intensity)
    assert np.array_equal(stored.valid, made.valid)
    assert stored.per_frame.keys() == made.per_frame.keys()


@pytest.mark.usefixtures("without_report")
def test_panoramas_compare_like_their_recordings(
    compared: Path, quick_specimen: Path, tmp_path: Path, run: Run
) -> None:
    a, b = (compared / "panoramas" / f"{name}.zarr" for name in ("endoscope", "oct"))
    truth = quick_specimen / "truth"
    status, said = run("compare", a, b, "-o", tmp_path / "again", "--truth", truth, "--json")
    assert status == 0
    first = json.loads((compared / "result.json").read_text())
    assert json.loads(said)["jaccard"] == first["jaccard"]
    assert json.loads(said)["alignment"] == first["alignment"]
    # a simulated specimen's truth lies where its panoramas do
    assert json.loads(said)["truth"][str(truth)]["endoscope"]["jaccard"] > 0.8
    assert json.loads(said)["truth"][str(truth)]["oct"]["jaccard"] > 0.7


@pytest.mark.usefixtures("without_report")
def test_a_mask_drawn_over_a_panorama_is_a_side_and_a_truth(compared: Path, tmp_path: Path, run: Run) -> None:
    oct_store = compared / "panoramas" / "oct.zarr"
    panorama = load_panorama(oct_store)
    assert panorama.depth_mm is not None
    drawn = tmp_path / "drawn.png"
    cv2.imwrite(str(drawn), np.where(panorama.depth_mm > 0.05, 255, 0).astype(np.uint8))
    status, said = run("compare", oct_store, drawn, "-o", tmp_path / "c", "--truth", drawn, "--json", *COARSE)
    result = json.loads(said)
    assert status == 0
    assert result["sides"] == ["oct", "mask"]
    assert result["jaccard"] > 0.7
    assert str(drawn) in result["truth"]


def test_two_different_patterns_are_not_aligned_and_status_3(tmp_path: Path, run: Run) -> None:
    for name, seed in (("a", 1), ("b", 2)):
        rng = np.random.default_rng(seed)
        mask = np.zeros((200, 512), np.uint8)
        for _ in range(25):
            centre = int(rng.integers(512)), int(rng.integers(200))
            cv2.circle(mask, centre, int(rng.integers(5, 20)), 255, -1)
        cv2.imwrite(str(tmp_path / f"{name}.png"), mask)
        (tmp_path / f"{name}.toml").write_text('modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.04\n')
    status, said = run("compare", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "c", "--json", *COARSE)
    result = json.loads(said)
    assert status == 3
    assert result["aligned"] is False
    assert result["reason"]
    assert result["jaccard"] is None
    assert result["dice"] is None
    assert result["alignment"] is None
    # asked for all the same, it is shown, and says so
    sides = tmp_path / "a.png", tmp_path / "b.png"
    status, said = run("compare", *sides, "-o", tmp_path / "forced", "--force", "--strict", *COARSE)
    forced = json.loads((tmp_path / "forced" / "result.json").read_text())
    assert status == 3  # for the doubt; everything is written
    assert (tmp_path / "forced" / "report.html").is_file()
    assert forced["aligned"] is True
    assert "forced" in [doubt["code"] for doubt in forced["doubts"]]
    assert forced["parameters"]["compare"]["force"] is True
    assert "\nDOUBT: The best alignment was accepted because that was asked for" in said
    # and the report can be written again
    (tmp_path / "c" / "report.html").unlink()
    assert run("report", tmp_path / "c")[0] == 0
    assert (tmp_path / "c" / "report.html").is_file()


def test_a_doubt_of_one_recording_is_said_once_and_status_3_if_strict(
    short: Path, quick_specimen: Path, tmp_path: Path, run: Run
) -> None:
    store = tmp_path / "x.zarr"
    arguments = "-o", store, "--set", "bore_diameter_mm=2.1", "--overwrite"
    status, said = run("unroll", short / "oct", *arguments)
    assert status == 0
    assert said.count("\nDOUBT: The wall lies") == said.count("The wall lies") == 1
    status, said = run("unroll", quick_specimen / "oct", *arguments, "--strict", "--json")
    assert status == 3
    (doubt,) = json.loads(said)["doubts"]
    assert (doubt["code"], doubt["unit"], doubt["expected"]) == ("wall-far-from-nominal", "mm", 2.1)
    stated = tomllib.loads((quick_specimen / "oct" / "acquisition.toml").read_text())
    assert doubt["value"] == pytest.approx(stated["bore_diameter_mm"], abs=0.02)
    assert load_panorama(store).doubts[0].to_json() == doubt


@pytest.mark.usefixtures("without_report")
def test_scores_against_truth_are_printed(compared: Path, quick_specimen: Path, tmp_path: Path, run: Run) -> None:
    a, b = (compared / "panoramas" / f"{name}.zarr" for name in ("endoscope", "oct"))
    truth = quick_specimen / "truth"
    status, said = run("compare", a, b, "-o", tmp_path / "again", "--truth", truth, *COARSE)
    assert status == 0
    scores = json.loads((tmp_path / "again" / "result.json").read_text())["truth"][str(truth)]
    expected = ", ".join(f"{side} {scores[side]['jaccard']:.3f}" for side in ("endoscope", "oct"))
    assert f"Jaccard index against {truth}: {expected}" in said.splitlines()


def test_a_recording_is_not_compared_with_itself(short: Path, tmp_path: Path, run: Run) -> None:
    linked = tmp_path / "linked"
    linked.symlink_to(short / "oct")
    for other in (short / "oct", linked):
        assert run("compare", short / "oct", other, "-o", tmp_path / "c")[0] == 1
    with pytest.raises(EndoctError, match="compared with itself"):
        compare(short / "oct", short / "oct", progress=False)
    assert not (tmp_path / "c").exists()


@pytest.mark.usefixtures("without_report")
def test_a_copy_of_a_recording_is_compared_with_a_doubt(short: Path, tmp_path: Path, run: Run) -> None:
    shutil.copytree(short / "oct", tmp_path / "copy")
    status, said = run("compare", short / "oct", tmp_path / "copy", "-o", tmp_path / "c", "--strict", *COARSE)
    assert status == 3
    assert "DOUBT: Both sides were made from the same files" in said
    stored = json.loads((tmp_path / "c" / "result.json").read_text())
    assert stored["doubts"][0]["code"] == "compared-with-itself"
    # the same of one path with settings that differ, and of two other recordings not
    same, coarse = short / "oct", {"n_theta": 512}
    by_settings = compare(same, same, settings=coarse, settings_b={"undistort": "sine"}, progress=False)
    assert by_settings.doubts[0].code == "compared-with-itself"
    other = compare(short / "endoscope", same, settings={"force": True, **coarse}, progress=False)
    assert "compared-with-itself" not in {doubt.code for doubt in other.doubts}


@pytest.mark.parametrize(("typed", "meant"), [("simualte", "simulate"), ("comapre", "compare"), ("unrol", "unroll")])
def test_a_misspelt_command_suggests_the_nearest(
    typed: str, meant: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["endoct", typed, "-o", "somewhere"])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert leave.value.code == 2
    assert f"did you mean '{meant}'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "typed",
    [["demo", "--preset", "papr"], ["simulate", "-o", "x", "--preset=papr"], ["dataset", "x", "--preset", "papr"]],
)
def test_a_misspelt_preset_suggests_the_nearest(
    typed: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["endoct", *typed])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert leave.value.code == 2
    assert capsys.readouterr().err == "endoct: unknown preset 'papr'; did you mean 'paper'?\n"


@pytest.mark.parametrize(
    "command", ["demo", "simulate", "unroll", "compare", "pose", "dataset", "bench", "serve", "export", "info"]
)
def test_help_names_no_default_where_there_is_none(command: str, run: Run) -> None:
    status, said = run(command, "--help")
    assert status == 0
    plain = re.sub(r"[\s│]+", " ", said)
    assert "default: None" not in plain
    assert "default: " in plain  # those that there are


def test_modalities_lists_both(run: Run) -> None:
    status, said = run("modalities", "--json")
    assert status == 0
    rows = {row["name"]: row for row in json.loads(said)}
    assert "depth" in rows["oct"]["provides"]
    assert rows["endoscope"]["provides"] == ["intensity"]


def test_info_says_what_the_sidecar_lacks_and_writes_one(quick_specimen: Path, tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "oct"
    folder.mkdir()
    (folder / "pullback.tif").symlink_to(quick_specimen / "oct" / "pullback.tif")
    status, said = run("info", folder, "--modality", "oct", "--json")
    assert status == 0
    assert "capillary_outer_diameter_mm" in json.loads(said)["missing"]
    assert run("info", folder, "--modality", "oct", "--write-sidecar")[0] == 0
    template = (folder / "acquisition.toml").read_text()
    assert "# axial_pixel_mm =" in template
    assert 'modality = "oct"' in template
    filled = template
    for key, value in (
        ("axial_pixel_mm", 0.005),
        ("pullback_pitch_mm", 0.2),
        ("bore_diameter_mm", 2.5),
        ("capillary_outer_diameter_mm", 1.7),
    ):
        filled = filled.replace(f"# {key} = ", f"{key} = {value}")
    (folder / "acquisition.toml").write_text(filled)
    status, said = run("info", folder, "--json")
    assert status == 0
    assert json.loads(said)["frames"] == 40
    assert run("info", folder, "--write-sidecar")[0] == 1
