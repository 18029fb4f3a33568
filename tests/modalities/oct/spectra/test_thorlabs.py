"""Raw spectra in ThorImage files: the B-scans of a headerless file, and a panorama from the command line."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.oct.plugin import OctModality
from endoct.modalities.recognition import open_recording, recognise
from endoct.workbench.pipeline.information import describe
from tests.modalities.oct.spectra.fringes import levels_db, mirror, quadratic_chirp
from tests.modalities.thorlabs_writer import Oct, raw_file, with_vectors

N, ASCANS = 128, 80
CHIRP = quadratic_chirp(N).astype(np.float32).astype(np.float64)
SLICES = [mirror(CHIRP, depth_px, n_ascans=ASCANS) for depth_px in (20.0, 25.0, 30.0)]
LACKING: dict[str, Any] = {
    "bore_diameter_mm": 2.5,
    "capillary_outer_diameter_mm": 1.7,
    "pullback_pitch_mm": 0.2,
}
RANGES = (0.02 * N / 2, 10.0, 5.0)


def write(folder: Path, made: Oct, **how: Any) -> Path:
    folder.mkdir(exist_ok=True)
    return made.write(folder / "scan.oct", **how)


def bscans(path: Path, **overrides: Any) -> np.ndarray:
    _, stream = open_recording(path, overrides={**LACKING, **overrides})
    return np.stack([stream[k].samples for k in range(len(stream))])


def headerless(folder: Path, slices: list[np.ndarray] = SLICES, **spectra: Any) -> np.ndarray:
    folder.mkdir(exist_ok=True)
    np.concatenate(slices).astype("<u2").tofile(folder / "spectra.bin")
    CHIRP.astype("<f4").tofile(folder / "Chirp.bin")
    table = {"file": "spectra.bin", "samples": N, "ascans": ASCANS, "chirp": "Chirp.bin", "electrons_per_count": 540.0}
    return bscans(folder, modality="oct", axial_pixel_mm=0.02, spectra=table | spectra)


def refused(path: Path, **overrides: Any) -> str:
    with pytest.raises(EndoctError) as caught:
        bscans(path, **overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_bscans_are_those_of_a_headerless_file(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, CHIRP, range_mm=RANGES))
    known = headerless(tmp_path / "b")
    np.testing.assert_array_equal(bscans(path), known)
    np.testing.assert_array_equal(bscans(path.parent), known)
    assert (known[1].argmax(axis=1) == 25).all()
    _, stream = open_recording(path, overrides=LACKING)
    assert (stream.acquisition.axial_pixel_mm, stream.acquisition.medium_index) == (pytest.approx(0.02), 1.0)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(stream))[2].samples, known[2])


def test_single_keys_of_the_chain_can_be_overridden(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, CHIRP, range_mm=RANGES))
    np.testing.assert_array_equal(
        bscans(path, **{"spectra.window": "blackman", "spectra.slices": 2}),
        headerless(tmp_path / "b", SLICES[:2], window="blackman"),
    )
    assert "holds fewer slices than stated" in refused(path, **{"spectra.slices": 4})
    assert "does not hold the spectra that are stated; found 80 A-scans of 128" in refused(
        path, **{"spectra.ascans": 90}
    )


def test_of_bscans_longer_than_a_turn_the_first_turn_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, CHIRP, range_mm=RANGES))
    turns = [spectra[:70] for spectra in SLICES]
    np.testing.assert_array_equal(bscans(path, **{"spectra.ascans": 70}), headerless(tmp_path / "b", turns, ascans=70))
    _, stream = open_recording(path, overrides={**LACKING, "spectra.ascans": 70})
    assert "Of the 80 A-scans of every B-scan the first 70 were read, as one turn." in stream.remarks.notes


def test_a_file_a_stop_is_a_pullback(tmp_path: Path) -> None:
    folder, turns = tmp_path / "stops", [*SLICES, SLICES[0][:, ::-1], SLICES[1][:, ::-1]]
    folder.mkdir()
    for k, spectra in zip((1, 2, 3, 5, 6), turns, strict=True):  # 4 is missing
        raw_file([spectra], CHIRP, range_mm=RANGES, mode="Mode2D").write(folder / f"Bore_{k:04d}_Mode2D.oct")
    np.testing.assert_array_equal(bscans(folder), headerless(tmp_path / "b", turns))
    _, stream = open_recording(folder, overrides={**LACKING, "travel": "in"})
    np.testing.assert_allclose([stream[k].z_mm for k in range(5)], [0.0, 0.2, 0.4, 0.8, 1.0])
    raw_file([turns[4]], CHIRP + 0.25, mode="Mode2D", range_mm=RANGES).write(folder / "Bore_0006_Mode2D.oct")
    _, stream = open_recording(folder, overrides=LACKING)
    assert [doubt.code for doubt in stream.remarks.doubts] == ["stops-differ"]


def test_a_chirp_next_to_the_file(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, None, range_mm=RANGES))
    said = refused(path)
    assert "holds raw spectra and no chirp; expected data\\Chirp.data in it, or Chirp.dat next to it" in said
    assert "SpectralRadar\\Config" in said
    (path.parent / "Chirp.dat").write_bytes("\r\n".join(f"{value!r}" for value in CHIRP.tolist()).encode())
    np.testing.assert_array_equal(bscans(path), headerless(tmp_path / "b"))
    (path.parent / "Chirp.dat").unlink()
    CHIRP.astype("<f4").tofile(path.parent / "Chirp.data")
    np.testing.assert_array_equal(bscans(path.parent), headerless(tmp_path / "b"))
    CHIRP[:100].astype("<f4").tofile(path.parent / "Chirp.data")
    assert "has the wrong length; found 400 bytes" in refused(path)


def test_a_chirp_that_is_none(tmp_path: Path) -> None:
    for k, (chirp, said) in enumerate(
        [(CHIRP[::-1], "does not rise throughout"), (CHIRP / N, "no places in samples"), (CHIRP * np.nan, "not finite")]
    ):
        assert said in refused(write(tmp_path / str(k), raw_file(SLICES, chirp, range_mm=RANGES)))
    path = write(tmp_path / "flipped", raw_file(SLICES, CHIRP, range_mm=RANGES))
    data = bytearray(path.read_bytes())
    data[data.index(CHIRP.astype("<f4").tobytes()) + 200] ^= 1
    path.write_bytes(data)
    assert "is damaged; found another checksum than the archive lists" in refused(path)


def test_spectra_without_the_sample_as_the_background(tmp_path: Path) -> None:
    """A fixed line at depth 40 is in both; of the mean over a turn it is a part, of the spectra alone it is all."""
    rng = np.random.default_rng(0)
    line = 3000 * np.cos(2 * np.pi * CHIRP * 40 / N)
    dark = np.round(30000 + line + rng.normal(0, 3, (8, N))).astype(np.uint16)
    still = [np.round(spectra + line + rng.normal(0, 3, spectra.shape)).astype(np.uint16) for spectra in SLICES]
    level = {}
    for name, made in {
        "each": raw_file(still, CHIRP, apodisation=dark, range_mm=RANGES),
        "own": with_vectors(raw_file(still, None, range_mm=RANGES), CHIRP, np.zeros(N), 540.0 * dark.mean(axis=0)),
    }.items():
        path = write(tmp_path / name, made)
        level[name] = levels_db(bscans(path, **{"spectra.background": "apodisation"})[0])
        assert (level[name][:, 20] > level[name][:, 40] + 30).all()
        np.testing.assert_array_equal(bscans(path), headerless(tmp_path / "b", still))
    np.testing.assert_allclose(level["each"][:, 20], level["own"][:, 20], atol=0.01)
    bare = write(tmp_path / "bare", raw_file(still, CHIRP, range_mm=RANGES))
    assert "holds no spectra without the sample" in refused(bare, **{"spectra.background": "apodisation"})
    table = {"spectra": {"file": "spectra.bin", "samples": N, "ascans": ASCANS, "chirp": "even"}}
    table["spectra"]["background"] = "apodisation"
    (tmp_path / "b" / "acquisition.toml").write_text('modality = "oct"\n')
    assert "which is no ThorImage file" in refused(tmp_path / "b", axial_pixel_mm=0.02, **table)


def test_a_sidecar_that_says_otherwise_wins_and_is_doubted(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, CHIRP, range_mm=RANGES))
    (path.parent / "acquisition.toml").write_text("axial_pixel_mm = 0.0205\n")
    _, stream = open_recording(path, overrides=LACKING)
    assert stream.acquisition.axial_pixel_mm == 0.0205
    assert [doubt.code for doubt in stream.remarks.doubts] == ["stated-otherwise"]


def test_it_is_known_without_a_sidecar(tmp_path: Path) -> None:
    path = write(tmp_path / "a", raw_file(SLICES, CHIRP, range_mm=RANGES))
    assert recognise(path).manifest.name == recognise(path.parent).manifest.name == "oct"
    found = describe(path)
    assert (found["frames"], found["certainty"] != "unsure") == (3, True)
    assert set(found["missing"]) == set(LACKING)
    assert OctModality().sniff(path).preview is not None
