"""Raw spectra of the simulator: against its own reconstruction, and as a recording like any other."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tolerances import RAW_SPECTRA_DB, REBUILT_DB, SAME_WALL_MM

from endoct.modalities.conformance import CHECKS, Check, Subject
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.spectra.keys import SpectraKeys
from endoct.modalities.oct.spectra.reading import is_sharper_turned_around, open_spectra
from endoct.modalities.recognition import open_recording
from endoct.modalities.registry import manifests
from endoct.synthetic.draw import draw
from endoct.synthetic.oct.spectrometer import LOG_BIAS_DB, chirp, counts, digitised, reconstruct, spectrometer
from tests.modalities.oct.spectra.fringes import chain, levels_db
from tests.modalities.oct.unrolling import unroll
from tests.modalities.thorlabs_writer import Oct, with_vectors

N = 1024


@pytest.fixture(scope="module")
def subject(small_specimen: Path) -> Subject:
    return Subject(manifests()["oct"], small_specimen / "oct-spectra")


# how the stream behaves; what is made of it is the same for all
@pytest.mark.parametrize(
    "check",
    [check for check in CHECKS if check.__module__.endswith(".recording_checks")],
    ids=lambda check: check.__name__,
)
def test_raw_spectra_conform(check: Check, subject: Subject) -> None:
    check(subject)


def test_at_even_wavenumbers_it_is_what_the_simulator_makes_of_the_same_spectra() -> None:
    oct_ = draw("learning", 1).oct.model_copy(update={"db_per_count": 0.5, "floor_count": 60.0})
    one, m, rng = spectrometer(oct_, N), np.arange(N, dtype=np.float64), np.random.default_rng(0)
    depth_px, strength = rng.uniform(10, 500, (2, 128)), 1e-3 * rng.exponential(size=(2, 128))
    field = sum(s[:, None] * np.exp(2j * np.pi * m * x[:, None] / N) for s, x in zip(strength, depth_px, strict=True))
    spectra = digitised(rng, one, m, counts(one, m, np.asarray(field, np.complex64)), np.full(N, 80.0))
    theirs_db = (reconstruct(oct_, one, spectra).T - oct_.floor_count) * oct_.db_per_count - LOG_BIAS_DB
    ours_db = levels_db(chain(m).bscan(spectra))
    # 0 dB there is the level of the noise, here an amplitude of one count
    unit_db = 20 * np.log10(one.unit * np.sum(one.reference(m) * one.window) * 2 / one.window.sum())
    inside = theirs_db > -25
    inside[:, 0] = False
    assert np.abs(ours_db - unit_db - theirs_db)[inside].max() < REBUILT_DB


def test_behind_the_chirp_it_is_the_bscan_that_the_simulator_writes(small_specimen: Path) -> None:
    """As the simulator's own test: noise differs in part, what is well above it does not."""
    written, read = (open_recording(small_specimen / name)[1] for name in ("oct", "oct-spectra"))
    assert isinstance(written.acquisition, OctAcquisition)
    assert written.acquisition.db_per_count is not None
    for i in (0, 7, 15):
        theirs_db = written[i].samples * written.acquisition.db_per_count
        apart = levels_db(read[i].samples) - theirs_db
        bright = theirs_db > np.median(theirs_db) + 22
        bright[:, :20] = bright[:, 300:] = False
        assert bright.sum() > 1000
        assert np.sqrt(np.mean(np.square(apart[bright] - np.median(apart[bright])))) < RAW_SPECTRA_DB


def test_the_wrong_way_round_it_blurs(small_specimen: Path) -> None:
    sharpness = []
    for gives in ("wavenumber", "sample"):
        _, stream = open_recording(small_specimen / "oct-spectra", overrides={"spectra.chirp_gives": gives})
        power = 10 ** (levels_db(stream[5].samples)[:, 150:] / 10)
        sharpness.append(np.mean(power**2) / np.mean(power) ** 2)
    assert sharpness[0] > 2 * sharpness[1]


def test_a_chirp_the_wrong_way_round_is_said(small_specimen: Path, tmp_path: Path) -> None:
    assert "turned around" not in OCT.sniff(small_specimen / "oct-spectra").reason
    moved = shutil.copytree(small_specimen / "oct-spectra", tmp_path / "turned")
    sidecar = moved / "acquisition.toml"
    sidecar.write_text(sidecar.read_text().replace('chirp = "', 'chirp_gives = "sample", chirp = "'))
    assert "the chirp seems to be turned around" in OCT.sniff(moved).reason


def test_a_chirp_the_right_way_round_is_not_doubted_for_a_blur_that_reaches_deeper(tmp_path: Path) -> None:
    """One line just above the depths that are judged: the wrong way round, it smears into them."""
    sample = np.arange(512)
    places = sample + sample * (511 - sample) / 7000
    phase = np.arange(64)[:, None] * np.pi / 32
    np.rint(1000 + 200 * np.cos(2 * np.pi * 60 * places / 512 + phase)).astype("<u2").tofile(tmp_path / "spectra.bin")
    (tmp_path / "chirp.txt").write_text("\n".join(map(str, places)))
    keys = SpectraKeys(file="spectra.bin", samples=512, ascans=64, chirp="chirp.txt")
    bscan = open_spectra(tmp_path, keys)[0]
    assert bscan.mean(axis=1).argmax() == 60
    assert not is_sharper_turned_around(tmp_path, keys, bscan)


def test_the_wall_lies_where_it_lies_in_the_written_bscans(small_specimen: Path) -> None:
    panoramas = []
    for name in ("oct", "oct-spectra"):
        _, stream = open_recording(small_specimen / name)
        assert isinstance(stream.acquisition, OctAcquisition)
        panoramas.append(unroll(small_specimen / name, stream.acquisition)[2])
    written, read = panoramas
    assert written.depth_mm is not None
    assert read.depth_mm is not None
    both = written.valid & read.valid
    assert both.mean() > 0.9
    apart = (read.depth_mm - written.depth_mm)[both]
    assert abs(np.median(apart)) < SAME_WALL_MM / 2
    assert np.median(np.abs(apart)) < SAME_WALL_MM
    assert np.mean(np.abs(apart) > 0.03) < 0.1
    assert np.corrcoef(written.intensity[both], read.intensity[both])[0, 1] > 0.7


def test_the_sidecar_that_the_simulator_writes_says_all(small_specimen: Path, tmp_path: Path) -> None:
    """The vectors beside it are those of its model, and the folder can be moved."""
    moved = shutil.copytree(small_specimen / "oct-spectra", tmp_path / "elsewhere")
    _, stream = open_recording(moved)
    assert isinstance(stream.acquisition, OctAcquisition)
    assert stream.acquisition.spectra is not None
    assert stream.acquisition.spectra.chirp_gives == "wavenumber"
    np.testing.assert_array_equal(np.fromfile(moved / "Chirp.bin", "<f8"), chirp(N))


def test_in_a_thorimage_file_they_give_the_same_panorama(small_specimen: Path, tmp_path: Path) -> None:
    """To the bit, where the headerless file's chirp is rounded to float32 as the program writes it."""
    spectra = shutil.copytree(small_specimen / "oct-spectra", tmp_path / "spectra")
    vectors = [np.fromfile(spectra / f"{name}.bin", "<f8").astype("<f4") for name in ("Chirp", "Offset")]
    vectors[0].tofile(spectra / "Chirp.bin")
    _, known = open_recording(spectra)
    assert isinstance(known.acquisition, OctAcquisition)
    keys = known.acquisition.model_dump(mode="json", exclude_none=True)
    keys.pop("spectra")
    n_ascans, n_depth = known[0].samples.shape
    made = Oct(size=(n_depth, n_ascans, len(known)), range_mm=(keys.pop("axial_pixel_mm") * n_depth, 20.0, 7.0))
    for k, frame in enumerate(np.fromfile(spectra / "spectra.bin", "<u2").reshape(len(known), n_ascans, N)):
        made.add(f"Spectral{k}", frame)
    path = with_vectors(made, *vectors).write(tmp_path / "Bore_0001_Mode3D.oct")
    _, stream = open_recording(path, overrides=keys)
    assert isinstance(stream.acquisition, OctAcquisition)
    for k in range(len(known)):
        np.testing.assert_array_equal(stream[k].samples, known[k].samples)
    ours, theirs = (unroll(at, of)[2] for at, of in ((path, stream.acquisition), (spectra, known.acquisition)))
    np.testing.assert_array_equal(ours.intensity, theirs.intensity)
    np.testing.assert_array_equal(ours.valid, theirs.valid)
    assert ours.valid.mean() > 0.9
