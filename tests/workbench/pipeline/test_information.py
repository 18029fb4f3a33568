"""What `endoct info` says of a path, and the sidecar that it lays out."""

import tomllib
from itertools import pairwise
from pathlib import Path
from random import Random

import cv2
import numpy as np
import pytest
from tolerances import CT_PLACE_MM, FRAME_Z_MM

from benchmarks.ct_faults.drawn import drawn, named_slices
from benchmarks.ct_faults.writing import nrrd_header, write_nrrd, write_series
from benchmarks.frame_faults.videos import write_video
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.ct.trajectory import Trajectory, write_line
from endoct.modalities.recognition import open_recording, recognise
from endoct.workbench import unroll
from endoct.workbench.pipeline.information import describe, in_lines, side_by_side, write_thumbnail
from endoct.workbench.pipeline.sidecar_template import write_sidecar_template
from endoct.workbench.pipeline.unread import texts_in, unread_next_to


def frames(folder: Path) -> Path:
    folder.mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((40, 40, 3), 90 + k, np.uint8))
    return folder


@pytest.mark.parametrize("text", ["{", "[]", '{"sides": 1}', '{"aligned": true}', "[" * 100_000, "9" * 9_000, "\udcff"])
def test_a_damaged_comparison_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(EndoctError) as caught:
        describe(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_template_is_laid_out_anew_with_the_keys_it_has(tmp_path: Path) -> None:
    sidecar, missing = write_sidecar_template(recognise(frames(tmp_path / "endo"), "endoscope"), overwrite=False)
    assert "bore_diameter_mm" in missing
    sidecar.write_text(sidecar.read_text().replace("# bore_diameter_mm = ", "bore_diameter_mm = 2.5"))
    with pytest.raises(EndoctError, match="exists already"):
        write_sidecar_template(recognise(tmp_path / "endo", "endoscope"), overwrite=False)
    _, missing = write_sidecar_template(recognise(tmp_path / "endo"), overwrite=True)
    assert list(missing.values()) == ["the scale along the bore"]  # which one of several keys would give
    sidecar.write_text(sidecar.read_text().replace("# visible_length_mm = ", "visible_length_mm = 1.0"))
    _, missing = write_sidecar_template(recognise(tmp_path / "endo"), overwrite=True)
    assert not missing
    assert "\nbore_diameter_mm = 2.5\n" in sidecar.read_text()


@pytest.mark.parametrize("mine", ["# measured twice\n", "travel = 'in'  # I saw it\n"])
def test_comments_of_the_user_are_not_overwritten(mine: str, tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(recognise(frames(tmp_path / "endo"), "endoscope"), overwrite=False)
    sidecar.write_text(sidecar.read_text() + mine)
    before = sidecar.read_text()
    with pytest.raises(EndoctError, match="was not written by endoct, or changed since"):
        write_sidecar_template(recognise(tmp_path / "endo", "endoscope"), overwrite=True)
    assert sidecar.read_text() == before


@pytest.mark.parametrize("mine", ["feed_pich_mm = 0.2\n", "theta_origin_rad = nan\n"])
def test_a_value_that_would_be_lost_stops_it(mine: str, tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(recognise(frames(tmp_path / "endo"), "endoscope"), overwrite=False)
    sidecar.write_text(sidecar.read_text() + mine)
    before = sidecar.read_text()
    with pytest.raises(EndoctError):
        write_sidecar_template(recognise(tmp_path / "endo", "endoscope"), overwrite=True)
    assert sidecar.read_text() == before


def test_keys_of_a_calibration_stay_there(tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(recognise(frames(tmp_path / "endo"), "endoscope"), overwrite=False)
    (tmp_path / "endo" / "😀.toml").write_text("bore_diameter_mm = 2.5\n", encoding="utf-8")
    sidecar.write_text(sidecar.read_text(encoding="utf-8") + 'calibration = "😀.toml"\n', encoding="utf-8")
    write_sidecar_template(recognise(tmp_path / "endo", "endoscope"), overwrite=True)
    text = sidecar.read_text(encoding="utf-8")
    assert '\ncalibration = "😀.toml"\n' in text
    assert "\nbore_diameter_mm = 2.5" not in text


def test_a_table_of_the_sidecar_is_kept(tmp_path: Path) -> None:
    np.save(tmp_path / "pullback.npy", np.zeros((3, 100, 100), np.uint8))
    sidecar, _ = write_sidecar_template(recognise(tmp_path, "oct"), overwrite=False)
    assert "# spectra = { file = …, samples = …, chirp = … }" in sidecar.read_text(encoding="utf-8")
    table = '{ file = "a.bin", samples = 1024, ascans = 500, chirp = "even", dispersion_rad = [1.5, 2] }'
    with sidecar.open("a", encoding="utf-8") as file:
        file.write(f"spectra = {table}\n")
    write_sidecar_template(recognise(tmp_path, "oct"), overwrite=True)
    assert f"\nspectra = {table}\n" in sidecar.read_text(encoding="utf-8")


def test_a_template_says_where_one_of_several_keys_is_needed(tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(recognise(frames(tmp_path / "endo"), "endoscope"), overwrite=False)
    about = {line.partition(" =")[0]: before for before, line in pairwise(sidecar.read_text().splitlines())}
    assert "or another key that gives the scale along the bore" in about["# feed_pitch_mm"]
    assert "another key" not in about["# outer_rim"]


def video(folder: Path, times_s: list[float]) -> Path:
    folder.mkdir()
    pictures = np.random.default_rng(0).integers(0, 256, (len(times_s), 48, 64), dtype=np.uint8)
    write_video(folder / "r.mkv", pictures, times_s)
    return folder


def test_a_video_states_its_rate_and_is_not_asked_for_it(tmp_path: Path) -> None:
    folder = video(tmp_path / "v", [k / 25 for k in range(6)])
    facts = describe(folder, "endoscope")
    assert (facts["format"], facts["measures"]) == ("video", {"duration": "0.24 s, 25 frames a second"})
    assert facts["stated"] == {"by": "the time stamps of r.mkv", "frame_rate_hz": 25.0}
    lines = facts["lines"]
    assert not any("frame_rate_hz =" in line for line in lines)
    sidecar, _ = write_sidecar_template(recognise(folder, "endoscope"), overwrite=False)
    text = sidecar.read_text(encoding="utf-8")
    assert "\n# frame_rate_hz = 25.0  # by the time stamps of r.mkv\n" in text
    assert tomllib.loads(text) == {"modality": "endoscope"}
    sidecar.write_text(text.replace("# feed_speed_mm_s = ", "feed_speed_mm_s = 5.0"), encoding="utf-8")
    _, missing = write_sidecar_template(recognise(folder), overwrite=True)
    assert list(missing) == ["bore_diameter_mm"]


def test_the_lines_that_are_missing_can_be_pasted(tmp_path: Path) -> None:
    times_s = [0.0, 0.04, 0.08, 0.2, 0.25, 0.31]  # frames are lost, and the rest comes unevenly
    folder = video(tmp_path / "v", times_s)
    facts = describe(folder, "endoscope")
    lines = "\n".join(facts["lines"])
    with pytest.raises(tomllib.TOMLDecodeError):
        tomllib.loads(lines)  # no value is left out unnoticed
    filled = lines.replace("bore_diameter_mm =", "bore_diameter_mm = 2.5")
    filled = filled.replace("# feed_speed_mm_s =", "feed_speed_mm_s = 5")
    (folder / "acquisition.toml").write_text(filled, encoding="utf-8")
    _, stream = open_recording(folder)
    np.testing.assert_allclose([stream[k].z_mm for k in range(6)], np.multiply(times_s, 5), atol=FRAME_Z_MM)
    facts = describe(folder)
    assert "lines" not in facts
    assert str(facts["measures"]["length"]).endswith("mm from frame to frame")


def test_a_rate_that_is_not_the_files_is_doubted(tmp_path: Path) -> None:
    folder = video(tmp_path / "v", [k / 25 for k in range(6)])
    text = 'modality = "endoscope"\nbore_diameter_mm = 2.5\nframe_rate_hz = 30\nfeed_speed_mm_s = 6\n'
    (folder / "acquisition.toml").write_text(text, encoding="utf-8")
    (doubt,) = describe(folder)["doubts"]
    assert doubt["code"] == "stated-otherwise"
    assert "frame_rate_hz is 30" in doubt["what"]


def test_raw_samples_next_to_a_chirp_need_a_table(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rng.integers(0, 4000, 1024 * 100, dtype=np.uint16).tofile(tmp_path / "scan.bin")
    (np.arange(1024) + 3 * np.sin(np.linspace(0, np.pi, 1024))).tofile(tmp_path / "Chirp.data")
    facts = describe(tmp_path)
    assert (facts["modality"], "spectra" in facts["missing"]) == ("oct", True)
    assert str(facts["format"]).startswith("raw samples")
    assert any(line.startswith("spectra = { file = …, samples = …") for line in facts["lines"])


def recorded(specimen: Path, part: str, folder: Path) -> Path:
    """A recording without its sidecar."""
    (folder / part).mkdir()
    for file in (specimen / part).iterdir():
        if file.suffix != ".toml":
            (folder / part / file.name).symlink_to(file)
    return folder / part


def test_a_pullback_without_a_sidecar_is_described(quick_specimen: Path, tmp_path: Path) -> None:
    path = recorded(quick_specimen, "oct", tmp_path)
    facts = describe(path)
    assert (facts["modality"], facts["certainty"], facts["frames"]) == ("oct", "likely", 40)
    assert facts["axes"] == "2000 A-scans × 512 depth samples, 40 slices"
    assert list(facts["missing"]) == [
        "bore_diameter_mm",
        "axial_pixel_mm",
        "pullback_pitch_mm",
        "capillary_outer_diameter_mm",
    ]
    assert facts["next"] == f"endoct info {path} --write-sidecar"
    spaced = path.rename(path.with_name("left ear"))
    assert describe(spaced)["next"] == f"endoct info '{spaced}' --write-sidecar"


def test_an_endoscope_without_a_sidecar_is_described(quick_specimen: Path, tmp_path: Path) -> None:
    facts = describe(recorded(quick_specimen, "endoscope", tmp_path))
    assert (facts["modality"], facts["certainty"]) == ("endoscope", "likely")
    assert str(facts["axes"]).endswith("40 frames")
    required, one_of = facts["missing"]
    assert required == "bore_diameter_mm"
    assert one_of.startswith("one of feed_pitch_mm, visible_length_mm, ")
    assert one_of.endswith(", or cone_half_angle_deg with focal_px and mirror_distance_mm")


def test_what_is_missing_is_what_unrolling_lacks(quick_specimen: Path, tmp_path: Path) -> None:
    path = recorded(quick_specimen, "endoscope", tmp_path)
    (path / "acquisition.toml").write_text('modality = "endoscope"\nbore_diameter_mm = 2.5\n')
    assert list(describe(path)["missing"].values()) == ["the scale along the bore"]
    with pytest.raises(EndoctError, match="the scale along the bore is not known"):
        unroll(path, progress=False)
    (path / "acquisition.toml").write_text('modality = "endoscope"\nbore_diameter_mm = 2.5\nfeed_pitch_mm = 0.2\n')
    facts = describe(path)
    assert "missing" not in facts
    assert str(facts["next"]).startswith(f"endoct unroll {path}")


def test_an_unfilled_sidecar_is_to_be_filled_in_not_written_again(quick_specimen: Path, tmp_path: Path) -> None:
    path = recorded(quick_specimen, "oct", tmp_path)
    sidecar, _ = write_sidecar_template(recognise(path), overwrite=False)
    assert describe(path)["next"] == f"fill in what is missing in {sidecar}"


def test_a_stated_modality_that_does_not_fit_is_said(quick_specimen: Path, tmp_path: Path) -> None:
    assert describe(quick_specimen / "oct")["certainty"] == "stated"
    facts = describe(recorded(quick_specimen, "oct", tmp_path), "endoscope")
    assert facts["certainty"] == "stated, but it does not look like one"
    assert "no annulus" in str(facts["seen"])
    assert str(facts["next"]).endswith("--modality endoscope --write-sidecar")


def test_one_key_a_line_and_nothing_of_python(quick_specimen: Path) -> None:
    for part in ("oct", "endoscope"):
        lines = list(in_lines(describe(quick_specimen / part)))
        assert not any(mark in line for line in lines for mark in "{}[]")
        assert sum("bore_diameter_mm: " in line for line in lines) == 1
        assert not any("\n" in line for line in lines)


def test_a_thumbnail_shows_three_frames(quick_specimen: Path, tmp_path: Path) -> None:
    recording = recognise(quick_specimen / "oct")
    write_thumbnail(recording, tmp_path / "oct.png")
    picture = cv2.imread(str(tmp_path / "oct.png"), cv2.IMREAD_UNCHANGED)
    assert picture.ndim == 2
    assert picture.shape[1] > 2.5 * picture.shape[0]
    bright = picture.mean(axis=1)
    assert bright[: len(bright) // 3].max() > bright[-len(bright) // 3 :].max()  # the catheter's lines are on top
    with pytest.raises(EndoctError, match=r"exists already; choose another file"):
        write_thumbnail(recording, tmp_path / "oct.png")
    with pytest.raises(EndoctError, match="lies inside the input"):
        write_thumbnail(recording, quick_specimen / "oct" / "new.png")


def test_a_thumbnail_keeps_colours_and_stretches_grey_levels() -> None:
    red = np.zeros((40, 60, 3), np.uint8)
    red[:20, :, 0] = 200
    assert side_by_side((red,))[0, 0].tolist() == [255, 0, 0]
    deep = np.linspace(1000, 3000, 2400).reshape(40, 60).astype(np.uint16)
    assert (side_by_side((deep, deep)).min(), side_by_side((deep, deep)).max()) == (0, 255)


def test_a_doubt_is_one_line() -> None:
    doubt = Doubt("wall-far-from-nominal", "The wall lies 0.2 mm before the nominal bore.", value=2.1, unit="mm")
    (line,) = in_lines({"doubts": [doubt.to_json()]})
    assert line.split(maxsplit=1) == ["doubts", f"{doubt.what} (wall-far-from-nominal)"]
    assert list(in_lines({"doubts": []})) == [f"{'doubts':<18}none"]


def test_a_ct_labels_and_a_plan_say_what_they_are(tmp_path: Path) -> None:
    volume = drawn(Random(2))
    series = write_series(tmp_path / "series", named_slices(volume))
    said = describe(series)
    corners = np.array(
        [volume.place(*(np.array(at) * (np.array(volume.voxels.shape) - 1))) for at in np.ndindex(2, 2, 2)]
    )
    assert (said["kind"], said["numbers"], said["coordinates"]) == ("CT", "Hounsfield units", "lps")
    assert np.allclose(said["from_mm"], corners.min(axis=0), atol=CT_PLACE_MM)  # type: ignore[arg-type]
    assert np.allclose(said["to_mm"], corners.max(axis=0), atol=CT_PLACE_MM)  # type: ignore[arg-type]
    assert said["certainty"] == "placed as its file says; nothing speaks against it"
    assert any("Hounsfield units" in line for line in in_lines(said))
    labels = (volume.voxels > 0).astype(np.uint8)
    header = nrrd_header(volume) | {"type": "uchar"}
    del header["space"]
    path = write_nrrd(
        tmp_path / "labels.nrrd", {"type": header.pop("type"), "space dimension": "3"} | header, labels.tobytes()
    )
    said = describe(path)
    assert (said["kind"], said["coordinates"], "from_mm" in said) == ("label map", None, False)
    assert "state --coordinates" in str(said["certainty"])
    assert said["numbers"] == "2 labels, which nothing names"
    write_line(Trajectory((1.0, 2.0, 3.0), (1.0, 2.0, 33.0)), "plan", tmp_path / "plan.mrk.json")
    said = describe(tmp_path / "plan.mrk.json")
    assert (said["kind"], said["coordinates"], said["target_mm"]) == ("plan", "lps", [1.0, 2.0, 33.0])
    (series / "IM0003.dcm").unlink()
    with pytest.raises(EndoctError, match=r"between IM0002\.dcm and IM0004\.dcm"):
        describe(series)


def test_files_beside_frames_that_nothing_reads_are_listed(tmp_path: Path) -> None:
    folder = frames(tmp_path / "endo")
    for name in ("acquisition.toml", "Chirp.dat", ".hidden"):
        (folder / name).write_text("")
    assert "unread" not in describe(folder, "endoscope")
    for k in range(22):
        (folder / f"notes {k:02d}.txt").write_text("twice")
    facts = describe(folder, "endoscope")
    assert facts["unread"]["count"] == 22
    lines = list(in_lines({"unread": facts["unread"]}))
    assert lines[0] == "unread            notes 00.txt: 5 bytes; expected PNG, JPEG, BMP or TIFF"
    assert lines[-1].split() == ["and", "2", "more"]
    assert len(lines) == 21


def test_files_that_a_sidecar_cites_are_no_junk(tmp_path: Path) -> None:
    manifest = recognise(frames(tmp_path / "endo"), "endoscope").manifest
    (tmp_path / "endo" / "rises.txt").write_text("1\n2")
    assert (
        unread_next_to(tmp_path / "endo", manifest, texts_in({"spectra": {"chirp": "rises.txt", "samples": 2}})).count
        == 0
    )
    assert unread_next_to(tmp_path / "endo", manifest, texts_in({"note": "other"})).count == 1


def test_so_many_files_are_opened_at_most(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest = recognise(frames(tmp_path / "endo"), "endoscope").manifest
    for k in range(5):
        (tmp_path / "endo" / f"{k}.scan").write_bytes(b"II*\0")  # begins as a TIFF does
    assert unread_next_to(tmp_path / "endo", manifest, ()).count == 0  # they hold frames
    monkeypatch.setattr("endoct.workbench.pipeline.unread.MOST_ASKED", 3)
    assert unread_next_to(tmp_path / "endo", manifest, ()).count == 0  # and the others are called alike
    for k in range(5):
        (tmp_path / "endo" / f"{k}.junk").write_text("twice")
    unread = unread_next_to(tmp_path / "endo", manifest, ()).to_json()
    assert unread["count"] == 5
    assert [each["why"].split(",")[0] for each in unread["files"][1:3]] == ["5 bytes; expected PNG", "not looked at"]


def test_pictures_lie_side_by_side_on_one_grey_scale() -> None:
    """From 100 to 300 in all: the darkest of the first is black, and the middle of the second is grey."""
    first, second = np.full((20, 30), 100, np.uint16), np.full((20, 30), 200, np.uint16)
    second[:, 15:] = 300
    both = side_by_side((first, second))
    assert both.shape == (20, 30 + 6 + 30)
    assert (both[:, :30] == 0).all()
    assert (both[:, 30:36] == 255).all()
    assert (np.abs(both[:, 36:51] - 127.5) <= 1).all()
    assert (both[:, 51:] == 255).all()
    assert side_by_side((np.zeros((960, 480), np.uint8),)).shape == (480, 240)
    assert side_by_side((np.zeros((4000, 500), np.uint8),)).shape == (480, 240), "uneven ones are drawn less so"
