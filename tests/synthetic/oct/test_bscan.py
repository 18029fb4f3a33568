"""B-scans as wholes: speckle, levels, the seam, raw spectra and reproducibility."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from tolerances import RAW_SPECTRA_DB, SPECKLE_GRAIN

from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.oct import bscan
from endoct.synthetic.oct.beams import Echoes, trace
from endoct.synthetic.oct.bscan import noise_free, offset, render_bscan, render_bscans, spectra
from endoct.synthetic.oct.scattered_field import scattered
from endoct.synthetic.oct.spectrometer import LOG_BIAS_DB, Spectrometer, chirp, roll_off, spectrometer
from endoct.synthetic.oct.sweep import Appearance, Sweep, Turn, build_appearance
from endoct.synthetic.sample.parameters import LostAscans, Oct, Sample
from endoct.synthetic.sample.presets import PRESETS
from tests.synthetic.fingerprints import KINDS, changed

N = 1024
N_RING = 2000
RADIUS_MM = 1.25


@pytest.fixture(scope="module")
def sample() -> Sample:
    drawn = draw("learning", 4, ranges={"oct.flare_db": (0.0, 0.0), "bore.bone": ("phantom",), "oct.scan": ("step",)})
    return drawn.model_copy(update={"oct": drawn.oct.model_copy(update={"lost_ascans": ()})})


@pytest.fixture(scope="module")
def wall(sample: Sample) -> Wall:
    return build_wall(sample)


@pytest.fixture(scope="module")
def appearance(sample: Sample, wall: Wall) -> Appearance:
    return build_appearance(sample, wall)


def _even(sample: Sample) -> Oct:
    """An OCT that sees bone that does not weaken with depth and nothing else, brighter than all noise."""
    return sample.oct.model_copy(
        update={
            "sheath": (),
            "wall_db": 40.0,
            "attenuation_mm": 1e9,
            "tail_db": -60.0,
            "roll_off_db": 4.0,
            "first_sample_mm": 0.0,
            "axial_pixel_mm": 0.005,
            "axial_resolution_mm": 0.0095,
            "lateral_resolution_mm": 0.025,
            "focus_mm": 1.0,
            "floor_bands_db": 0.0,
            "inner_face_db": -60.0,
            "outer_face_db": -60.0,
            "catheter_face_db": -60.0,
            "detector_line_db": -60.0,
        }
    )


def _flat(n: int, path_mm: float) -> Echoes:
    """Return beams that all meet a plain wall squarely at one path."""
    nothing = np.full(n, np.nan)
    return Echoes(
        alpha_rad=np.zeros(n),
        inner_path_mm=np.full(n, 0.4),
        outer_path_mm=np.full(n, 0.7),
        inner_incidence_rad=np.full(n, 0.1),
        outer_incidence_rad=np.full(n, 0.1),
        fluid_path_mm=nothing,
        wall_path_mm=np.full(n, path_mm),
        exit_path_mm=nothing,
        reentry_path_mm=nothing,
        wall_z_mm=np.zeros(n),
        wall_theta_rad=np.zeros(n),
        wall_radius_mm=np.full(n, RADIUS_MM),
        wall_cosine=np.ones(n),
        fluid_cosine=np.ones(n),
        cell=np.zeros(n, np.int32),
        dust=np.zeros(n, np.bool_),
        shadow_db=np.zeros(n),
        crossing_rad=np.mod(2 * np.pi / N_RING * np.arange(n), 2 * np.pi),
        slant_rad=np.zeros(n),
        beyond_mm=np.zeros(n),
    )


def _field_of(oct_: Oct, instrument: Spectrometer, echoes: Echoes, seed: int = 0) -> NDArray[np.complex128]:
    """Return the field in depth, (column, 512), 0 dB a magnitude of 1."""
    n = echoes.alpha_rad.size
    sweep = Sweep(
        oct_, instrument, Turn(N_RING, 0, n), echoes, np.zeros(n), np.full(n, -60.0), RADIUS_MM,
        catheter_mm=0, lean=0, density=None, seed=seed, bore_seed=seed, slice_index=0,
    )  # fmt: skip
    light = scattered(sweep)
    m = np.arange(N, dtype=np.float64)
    reference = instrument.reference(m)
    field = np.concatenate([part for _, part in light.field(0, 1, N, with_line=False)]).real * 2 * reference
    depth = np.fft.rfft(field * instrument.window, axis=1)[:, :512] / (
        instrument.unit * np.sum(reference * instrument.window)
    )
    return np.asarray(depth, dtype=np.complex128)


@pytest.fixture(scope="module")
def speckle(sample: Sample) -> NDArray[np.complex128]:
    oct_ = _even(sample).model_copy(update={"roll_off_db": 30.0})  # so that nothing folds back
    one = spectrometer(oct_, N)
    flattened = _field_of(oct_, one, _flat(N_RING, 1.0)) / roll_off(oct_, np.arange(512.0), N)
    return flattened[:, 210:330]


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_slice_that_was_published(kind: str) -> None:
    assert changed("oct", kind) == []


def test_bone_is_fully_developed_speckle(speckle: NDArray[np.complex128]) -> None:
    intensity = np.abs(speckle) ** 2
    assert intensity.std() / intensity.mean() == pytest.approx(1, abs=0.03)
    level_db = 10 * np.log10(intensity)
    assert level_db.std() == pytest.approx(5.57, abs=0.1)
    assert np.mean((level_db - level_db.mean()) ** 3) / level_db.std() ** 3 == pytest.approx(-1.14, abs=0.06)
    assert 10 * math.log10(intensity.mean()) == pytest.approx(40, abs=0.3)


def test_the_grain_of_speckle_is_the_resolution(sample: Sample, speckle: NDArray[np.complex128]) -> None:
    def correlation(axis: int, shift: int) -> float:
        one, other = (np.roll(speckle, -shift, axis), speckle)
        inner = (slice(0, -shift), slice(None)) if axis == 0 else (slice(None), slice(0, -shift))
        return float(np.abs(np.mean((one * np.conj(other))[inner])) / np.mean(np.abs(speckle) ** 2))

    # laterally: a beam whose intensity has σ gives a field with √2·σ, which correlates as exp(−s²/(8σ²))
    sigma = 0.025 / 2.3548 / (2 * np.pi * RADIUS_MM / N_RING)
    for shift in (2, 5, 8):
        assert correlation(0, shift) == pytest.approx(math.exp(-(shift**2) / (8 * sigma**2)), abs=SPECKLE_GRAIN)
    # axially: as the squared shape of the spectrum transforms
    one = spectrometer(_even(sample), N)
    shape = (one.reference(np.arange(N, dtype=np.float64)) * one.window) ** 2
    expected = np.abs(np.fft.fft(shape)) / shape.sum()
    for shift in (1, 2, 3):
        assert correlation(1, shift) == pytest.approx(expected[shift], abs=SPECKLE_GRAIN)


def test_the_surface_of_bone_is_where_its_path_ends(sample: Sample) -> None:
    oct_ = _even(sample)
    one = spectrometer(oct_, N)
    for path_mm in (1.0, 1.00125, 1.0025):
        mean = np.mean(np.abs(_field_of(oct_, one, _flat(N_RING, path_mm))) ** 2, axis=0)
        # what folds back from beyond the full depth is a twentieth
        assert mean[:195].max() < 0.1 * mean[215:260].mean(), "no bone above its surface"
        # half of the plateau at the surface
        at = np.interp(0.5, mean[190:215] / mean[215:260].mean(), np.arange(190, 215))
        assert at == pytest.approx(path_mm / 0.005, abs=0.25)


def test_behind_a_septum_there_is_a_gap_and_weaker_bone(sample: Sample) -> None:
    oct_ = _even(sample).model_copy(update={"attenuation_mm": 0.2})
    one = spectrometer(oct_, N)
    thin = replace(_flat(N_RING, 1.0), exit_path_mm=np.full(N_RING, 1.155), reentry_path_mm=np.full(N_RING, 1.5))
    mean = np.mean(np.abs(_field_of(oct_, one, thin)) ** 2, axis=0) / roll_off(oct_, np.arange(512.0), N) ** 2
    assert 10 * math.log10(mean[240:290].mean() / mean[205]) < -25
    # 0.155 mm of light's way is 0.1 mm of bone with an index of 1.55
    lost_db = 10 * math.log10(mean[305:310].mean() / mean[205:210].mean())
    assert lost_db == pytest.approx(-10 * 0.1 / 0.2 / math.log(10), abs=0.5)


def test_a_full_turn_closes(sample: Sample) -> None:
    oct_ = _even(sample)
    field = _field_of(oct_, spectrometer(oct_, N), _flat(N_RING + 100, 1.0))
    np.testing.assert_allclose(field[20:80, 220:], field[N_RING + 20 : N_RING + 80, 220:], atol=1e-2)


def test_faces_and_sheath_are_at_their_paths(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    oct_ = sample.oct.model_copy(update={"sheath": (), "outer_face_db": 60.0, "glint_rad": 1.0, "scan": "step"})
    bright = sample.model_copy(update={"oct": oct_})
    clean = noise_free(bright, wall, appearance, 3).astype(np.float64)
    echoes = trace(bright, wall.scene, 3, np.arange(512.0))
    row = (echoes.outer_path_mm - oct_.first_sample_mm) / oct_.axial_pixel_mm
    window = np.rint(row).astype(int)[None, :] + np.arange(-3, 4)[:, None]
    power = 10 ** (clean[window, np.arange(512)[None, :]] * oct_.db_per_count / 10)
    found = np.sum(power * window, axis=0) / power.sum(axis=0)
    assert np.median(np.abs(found - row)) < 0.1
    assert np.quantile(np.abs(found - row), 0.95) < 0.3


def test_lost_ascans_are_left_out_of_one_and_the_same_turn(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    lost = (LostAscans(slice_index=1, ascan=200, count=30),)
    gap = sample.model_copy(update={"oct": sample.oct.model_copy(update={"lost_ascans": lost})})
    whole, cut = noise_free(sample, wall, appearance, 1), noise_free(gap, wall, appearance, 1)
    assert cut.shape == whole.shape
    same = (slice(60, 400), slice(10, 190))
    # phases wander over one ring in both, but for the few columns after the turn's end
    assert np.corrcoef(whole[same].ravel(), cut[same].ravel())[0, 1] > 0.95
    assert np.corrcoef(whole[60:400, 240:500].ravel(), cut[60:400, 210:470].ravel())[0, 1] > 0.95
    assert np.corrcoef(whole[60:400, 210:470].ravel(), cut[60:400, 210:470].ravel())[0, 1] < 0.9


def test_spectra_are_written_slice_by_slice(sample: Sample, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bscan, "spectra", lambda *given: np.full((2, 3), given[-1], np.uint16))
    shares: list[float] = []
    nothing: Any = None
    bscan.write_spectra(tmp_path / "raw", sample, nothing, nothing, shares.append, 2)
    n = PRESETS[sample.preset].n_slices
    written = np.fromfile(tmp_path / "raw" / "spectra.bin", "<u2").reshape(n, 2, 3)
    assert np.array_equal(written[:, 0, 0], np.arange(n))
    np.testing.assert_allclose(shares, np.arange(1, n + 1) / n)


def test_raw_spectra_give_the_same_bscan(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    raw = spectra(sample, wall, appearance, 5)
    assert (raw.dtype, raw.shape) == (np.uint16, (512, N))
    electrons = raw * sample.oct.electrons_per_count - offset(sample)
    assert abs(np.median(electrons[:, :5]) / sample.oct.electrons_per_count) < 3000
    fringes = electrons - electrons.mean(axis=0)
    even = CubicSpline(chirp(N), fringes, axis=1)(np.arange(N))
    power = np.abs(np.fft.rfft(even * np.hanning(N), axis=1)[:, :512].T) ** 2
    direct = render_bscan(sample, wall, appearance, 5).astype(np.float64)
    rendered_db = (direct - sample.oct.floor_count) * sample.oct.db_per_count
    difference = 10 * np.log10(power) - rendered_db
    # noise differs, what is well above it does not
    bright = (noise_free(sample, wall, appearance, 5) - sample.oct.floor_count) * sample.oct.db_per_count > 22
    bright[:20] = False
    assert bright.sum() > 1000
    apart = difference[bright] - np.median(difference[bright])
    assert math.sqrt(np.mean(np.square(apart))) < RAW_SPECTRA_DB
    # resampled the other way round, lines blur
    wrong = CubicSpline(np.arange(N), fringes, axis=1)(chirp(N))
    blurred = np.abs(np.fft.rfft(wrong * np.hanning(N), axis=1)[:, :512].T) ** 2
    sharpness = [np.mean(image[150:] ** 2) / np.mean(image[150:]) ** 2 for image in (power, blurred)]
    assert sharpness[0] > 2 * sharpness[1]


def test_no_background_takes_the_detectors_line_away(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    oct_ = sample.oct.model_copy(update={"detector_line_px": 480.0, "detector_line_db": 25.0, "tail_db": -60.0})
    lined = sample.model_copy(update={"oct": oct_})
    levels = (render_bscan(lined, wall, appearance, 6) - oct_.floor_count) * oct_.db_per_count - LOG_BIAS_DB
    assert 10 * math.log10(np.mean(10 ** (levels[480] / 10))) == pytest.approx(25, abs=1.0)
    assert np.quantile(levels[480], 0.05) > 20
    # and nothing of it is in the twin
    dark = lined.model_copy(update={"oct": oct_.model_copy(update={"detector_line_db": -60.0})})
    twins = (noise_free(each, wall, appearance, 6) for each in (lined, dark))
    np.testing.assert_array_equal(*twins)


def test_a_bscan_is_reproducible_and_its_noise_its_own(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    first, again = (render_bscan(sample, wall, appearance, 2) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert first.dtype == np.uint8
    assert first.shape == (512, 512)
    third, second = render_bscans(sample, wall, appearance, [3, 2])
    np.testing.assert_array_equal(second, list(render_bscans(sample, wall, appearance, [3, 2]))[1])
    other = render_bscan(sample, wall, appearance, 3)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(other, third)
    assert abs(np.corrcoef(first[420:].ravel(), other[420:].ravel())[0, 1]) < 0.05


def test_noise_free_keeps_the_speckle(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    noisy, clean = render_bscan(sample, wall, appearance, 2), noise_free(sample, wall, appearance, 2)
    over = (sample.oct.floor_count + 15 / sample.oct.db_per_count < clean) & (np.arange(512) > 20)[:, None]
    apart_db = (noisy[over].astype(float) - clean[over]) * sample.oct.db_per_count
    assert abs(np.median(apart_db)) < 0.2
    assert np.median(np.abs(apart_db)) < 1.0
