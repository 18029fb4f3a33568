"""Raw spectra on disk: what is read, what is refused and in which words, and what is recognised."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tolerances import A_SCAN

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import validate
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.pullback_stream import Pullback
from endoct.modalities.recognition import open_recording, recognise
from tests.modalities.oct.spectra.fringes import levels_db, mirror, quadratic_chirp

N, ASCANS, SLICES = 128, 80, 3
CHIRP = quadratic_chirp(N)
KEYS: dict[str, Any] = {
    "modality": "oct",
    "axial_pixel_mm": 0.02,
    "pullback_pitch_mm": 0.2,
    "bore_diameter_mm": 2.5,
    "capillary_outer_diameter_mm": 1.7,
}
SPECTRA: dict[str, Any] = {"file": "spectra.bin", "samples": N, "ascans": ASCANS, "chirp": "Chirp.bin"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three slices of a mirror at depths 20, 25 and 30."""
    spectra = [mirror(CHIRP, depth_px, n_ascans=ASCANS) for depth_px in (20.0, 25.0, 30.0)]
    np.concatenate(spectra).astype("<u2").tofile(tmp_path / "spectra.bin")
    CHIRP.astype("<f8").tofile(tmp_path / "Chirp.bin")
    np.full(N, 25000.0).astype("<f8").tofile(tmp_path / "Offset.bin")
    return tmp_path


def opened(path: Path, **spectra: Any) -> Pullback:
    return OCT.open(path, validate(OctAcquisition, {**KEYS, "spectra": {**SPECTRA, **spectra}}, "acquisition.toml"))


def refused(path: Path, **spectra: Any) -> str:
    with pytest.raises(EndoctError) as caught:
        opened(path, **spectra)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_bscans_are_theta_by_depth_and_logarithmic(folder: Path) -> None:
    stream = opened(folder)
    assert (len(stream), stream.n_ascans, stream.n_depth) == (SLICES, ASCANS, N // 2)
    assert (stream.acquisition.intensity, stream.acquisition.db_per_count) == ("log", 1 / 256)
    for i, depth_px in enumerate((20, 25, 30)):
        frame = stream[i]
        assert (frame.samples.shape, frame.samples.dtype) == ((ASCANS, N // 2), np.uint16)
        assert (frame.samples.argmax(axis=1) == depth_px).all()
        assert not frame.samples.flags.writeable


def test_a_file_is_read_like_its_folder(folder: Path) -> None:
    np.testing.assert_array_equal(opened(folder / "spectra.bin")[1].samples, opened(folder)[1].samples)


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("chirp.data", lambda path: CHIRP.astype("<f4").tofile(path)),
        ("chirp.txt", lambda path: np.savetxt(path, CHIRP)),
        ("chirp.csv", lambda path: path.write_text(", ".join(map(str, CHIRP)))),
    ],
)
def test_vectors_may_be_single_precision_or_text(folder: Path, name: str, written: Any) -> None:
    written(folder / name)
    found, known = opened(folder, chirp=name)[2].samples, opened(folder)[2].samples
    np.testing.assert_allclose(levels_db(found), levels_db(known), atol=0.5)
    assert (found.argmax(axis=1) == 30).all()


def test_a_chirp_the_other_way_round(folder: Path) -> None:
    np.interp(np.arange(N), CHIRP, np.arange(N)).astype("<f8").tofile(folder / "inverse.bin")
    inverse = opened(folder, chirp="inverse.bin", chirp_gives="sample")[0].samples
    np.testing.assert_allclose(levels_db(inverse)[:, 20], levels_db(opened(folder)[0].samples)[:, 20], atol=0.02)
    wrong = opened(folder, chirp_gives="sample")[0].samples
    assert levels_db(wrong).max() < levels_db(inverse).max() - 3


def test_a_source_that_is_clocked_evenly_needs_no_chirp(tmp_path: Path) -> None:
    mirror(np.arange(N, dtype=float), 20.0, n_ascans=ASCANS).astype("<u2").tofile(tmp_path / "spectra.bin")
    assert (opened(tmp_path, chirp="even")[0].samples.argmax(axis=1) == 20).all()


def test_an_offset_as_the_background(folder: Path) -> None:
    """What it leaves of a level has depth 0, where no mirror image shares it: it shows at twice its height."""
    still = opened(folder, offset="Offset.bin", background="offset")[0].samples
    assert levels_db(still)[0, 0] == pytest.approx(20 * np.log10(2 * 5000), abs=0.5)
    in_electrons = opened(folder, offset="Offset.bin", background="offset", electrons_per_count=0.5)[0].samples
    assert levels_db(in_electrons)[0, 0] == pytest.approx(20 * np.log10(2 * 10000), abs=0.5)


def test_samples_with_a_sign(folder: Path) -> None:
    counts = np.fromfile(folder / "spectra.bin", "<u2").astype(int) - 30000
    counts.astype("<i2").tofile(folder / "signed.bin")
    signed = opened(folder, file="signed.bin", sample_type="i16")[1].samples
    known = levels_db(opened(folder)[1].samples)
    bright = known > known.max() - 40
    np.testing.assert_allclose(levels_db(signed)[bright], known[bright], atol=0.05)


def test_an_incomplete_turn_is_left_out_where_that_is_stated(folder: Path) -> None:
    spectra = np.fromfile(folder / "spectra.bin", "<u2")
    spectra[: -20 * N].tofile(folder / "spectra.bin")
    said = refused(folder)
    assert "does not end with a whole slice" in said
    assert "220 A-scans, 60 more than 2 slices of 80" in said
    assert "'slices = 2'" in said
    assert len(opened(folder, slices=2)) == 2


def broken(folder: Path, chirp: np.ndarray) -> str:
    chirp.astype("<f8").tofile(folder / "Chirp.bin")
    return refused(folder)


def test_what_is_no_chirp_is_refused(folder: Path) -> None:
    bumpy = CHIRP.copy()
    bumpy[40] = bumpy[41]
    assert "does not rise throughout; found 46.5528 and then 46.5528 at values 40 and 41" in broken(folder, bumpy)
    assert "subtracting it from 127" in broken(folder, CHIRP[::-1])
    assert "holds no places in samples; found values from 1200 to 1368" in broken(folder, np.linspace(1200, 1368, N))
    assert "holds no places in samples" in broken(folder, np.linspace(0, 1, N))
    assert "has the wrong length; found 800 bytes; expected 1024 bytes (float64) or 512 (float32)" in broken(
        folder, CHIRP[:100]
    )
    assert "value 7 is NaN" in broken(folder, np.where(np.arange(N) == 7, np.nan, CHIRP))


def test_other_files_that_do_not_fit(folder: Path) -> None:
    assert "Missing.bin cannot be read; found No such file" in refused(folder, chirp="Missing.bin")
    assert "names a place outside" in refused(folder, chirp="../Chirp.bin")
    assert "names a place outside" in refused(folder, file="/etc/passwd")
    (folder / "words.txt").write_text("one two")
    assert "words.txt holds no numbers" in refused(folder, offset="words.txt")
    (folder / "short.txt").write_text("1 2 3")
    assert "found 3 numbers; expected 128, one a sample" in refused(folder, dispersion="short.txt")
    assert "holds fewer slices than stated; found 3 of 80 A-scans; expected 4" in refused(folder, slices=4)
    with (folder / "spectra.bin").open("ab") as file:
        file.write(b"header")
    assert "does not hold a whole number of A-scans" in refused(folder)
    (folder / "spectra.bin").write_bytes(b"")
    assert "does not hold a whole number of A-scans; found 0 bytes" in refused(folder)


def test_a_slice_too_large_for_memory_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENDOCT_LARGEST_ARRAY_GB", "1e-6")
    assert "asks for too much memory" in refused(folder)


@pytest.mark.parametrize(
    ("spectra", "said"),
    [
        ({"window": "kaiser"}, "'spectra.window' in acquisition.toml cannot be used; found 'kaiser'"),
        ({"windw": "hann"}, "unknown key 'spectra.windw' in acquisition.toml; expected 'spectra.window'"),
        ({"samples": 127}, "'spectra.samples' in acquisition.toml cannot be used; found 127"),
        ({"samples": "1024"}, "'spectra.samples' in acquisition.toml cannot be used"),
        ({"ascans": 10}, "expected 64 to 1e+06"),
        ({"background": "offset"}, "an offset, where background is offset"),
        ({"dispersion": "a", "dispersion_rad": [1]}, "one of dispersion and dispersion_rad"),
        ({"dispersion_rad": []}, "'spectra.dispersion_rad'"),
    ],
)
def test_keys_that_do_not_fit(folder: Path, spectra: dict[str, Any], said: str) -> None:
    assert said in refused(folder, **spectra)


def test_a_key_that_lacks_says_what_it_is() -> None:
    with pytest.raises(EndoctError, match=r"lacks 'spectra\.chirp' \(file of places on even wavenumbers; or even"):
        validate(OctAcquisition, {**KEYS, "spectra": {k: v for k, v in SPECTRA.items() if k != "chirp"}}, "a.toml")


@pytest.mark.parametrize("keys", [{"intensity": "linear"}, {"db_per_count": 0.3}])
def test_levels_of_bscans_are_not_stated_of_spectra(keys: dict[str, Any]) -> None:
    with pytest.raises(EndoctError, match="leave them out where spectra are stated"):
        validate(OctAcquisition, {**KEYS, "spectra": SPECTRA, **keys}, "a.toml")


def test_a_recording_that_shrinks_is_refused(folder: Path) -> None:
    stream = opened(folder)
    np.fromfile(folder / "spectra.bin", "<u2")[: -N * ASCANS].tofile(folder / "spectra.bin")
    with pytest.raises(EndoctError, match="truncated; found slice 2 incomplete"):
        stream[2]


def write_sidecar(folder: Path, **spectra: Any) -> None:
    keys = {**KEYS, **{f"spectra.{key}": value for key, value in {**SPECTRA, **spectra}.items()}}
    lines = [f"{key} = {value!r}" for key, value in keys.items()]
    (folder / "acquisition.toml").write_text("\n".join(lines))


def test_single_keys_of_the_table_can_be_overridden(folder: Path) -> None:
    write_sidecar(folder)
    _, stream = open_recording(folder, overrides={"spectra.window": "flat", "spectra.slices": 1})
    assert len(stream) == 1
    assert stream.acquisition.model_dump()["spectra"]["window"] == "flat"
    assert stream.acquisition.model_dump()["spectra"]["chirp"] == "Chirp.bin"


def test_spectra_are_recognised_by_their_sidecar_and_by_a_chirp(folder: Path) -> None:
    verdict = OCT.sniff(folder)
    assert (verdict.claims, verdict.certainty) == (True, "likely")
    assert "Chirp.bin looks like a chirp, and spectra.bin could hold raw spectra of 128 samples" in verdict.reason
    assert recognise(folder).manifest.name == "oct"
    assert OCT.sniff(folder / "spectra.bin").claims
    with pytest.raises(EndoctError, match="state them in a table 'spectra' of the sidecar"):
        OCT.open(folder, OctAcquisition(**KEYS))
    write_sidecar(folder)
    preview = OCT.sniff(folder).preview
    assert preview is not None
    assert (preview.n_frames, preview.size, preview.dtype) == (3, "80 A-scans × 64 depth samples", "uint16")
    write_sidecar(folder, chirp="Missing.bin")
    assert "Missing.bin cannot be read" in OCT.sniff(folder).reason


def test_other_files_are_not_taken_for_spectra(folder: Path) -> None:
    (folder / "Chirp.bin").unlink()
    assert not OCT.sniff(folder).claims
    np.linspace(5000, 6000, N).astype("<f8").tofile(folder / "rising.bin")
    assert not OCT.sniff(folder).claims


def turning_spectra(folder: Path, starts: list[int]) -> None:
    """Write spectra of a mirror whose depth follows the beam; turns begin at ``starts``, the last one is not whole."""
    turns = np.interp(np.arange(starts[-1]), starts, np.arange(len(starts), dtype=float))
    angle = 2 * np.pi * turns[: starts[-1] - 30]
    depth_px = 30 + 12 * np.sin(angle) + 3 * np.sin(5 * angle)
    noise = np.random.default_rng(7).normal(scale=200.0, size=(angle.size, N))
    wave = 30000 + 10000 * np.cos(2 * np.pi * CHIRP * depth_px[:, None] / N + 7 * angle[:, None])
    (wave + noise).astype("<u2").tofile(folder)


def test_turns_are_found_where_their_length_is_not_stated(folder: Path) -> None:
    starts = [0, 300, 606, 900, 1198, 1500]
    turning_spectra(folder / "spectra.bin", starts)
    stream = opened(folder, ascans=None)
    assert len(stream) == 4, "the last is not whole"
    assert stream.n_ascans == pytest.approx(299, abs=A_SCAN)
    assert any("Turns were found in the A-scans: 4, of" in note for note in stream.remarks.notes)
    assert any("after the last whole turn were left out" in note for note in stream.remarks.notes)
    deepest = [stream[k].samples.argmax(axis=1) for k in range(4)]
    for bscan in deepest[1:]:
        np.testing.assert_allclose(bscan, deepest[0], atol=1)
    assert len(opened(folder, ascans=None, slices=2)) == 2
    assert "fewer turns than stated; found 4" in refused(folder, ascans=None, slices=5)


def test_a_file_a_stop_gives_the_first_turn_of_each(folder: Path) -> None:
    (folder / "spectra.bin").unlink()
    for k, period in ((2, 300), (10, 306), (1, 296)):
        turning_spectra(folder / f"stop_{k}.bin", [0, period, 2 * period])
    stream = opened(folder, file="stop_*.bin", ascans=None)
    assert len(stream) == 3
    assert stream.n_ascans == pytest.approx(300, abs=A_SCAN)
    found = [float(note.split("of ")[1].split(" ")[0]) for note in stream.remarks.notes if "Turns were found" in note]
    assert found == pytest.approx([296], abs=A_SCAN)
    np.testing.assert_array_equal(opened(folder, file="stop_*.bin", ascans=296)[0].samples.shape, (296, N // 2))
    assert "found 0 named like other_*.bin" in refused(folder, file="other_*.bin", ascans=None)
    assert "found 3 named like stop_*.bin; expected 4" in refused(folder, file="stop_*.bin", slices=4)
