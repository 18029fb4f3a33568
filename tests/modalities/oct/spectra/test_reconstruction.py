"""From spectra to B-scans: where a mirror shows, how sharp and how bright, and what else shows with it."""

import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import (
    CHIRPED_PEAK_PX,
    COUNT_DB,
    PEAK_PX,
    POINT_SPREAD_SHARE,
    POINT_WIDTH_PX,
    QUANTISED_DB,
    ROLL_OFF_LEFT_DB,
    SIDE_LOBE_DB,
)

from endoct.base.compute.parallel import thread_map
from endoct.modalities.oct.spectra.reconstruction import (
    Interpolation,
    dispersion_phase,
    mean_spectrum,
    reconstruction,
    sample_places,
    taps,
    window,
)
from tests.modalities.oct.spectra.fringes import (
    AMPLITUDE,
    Array,
    chain,
    chirped,
    levels_db,
    mirror,
    peak_px,
    quadratic_chirp,
)

N = 1024
EVEN = np.arange(N, dtype=np.float64)
LEVEL_DB = 20 * math.log10(AMPLITUDE)


@pytest.mark.parametrize("n", [128, 512, 1024, 1200, 2048])
def test_a_cosine_of_whole_waves_shows_at_their_number_as_bright_as_its_amplitude(n: int) -> None:
    even = np.arange(n, dtype=np.float64)
    level = levels_db(chain(even).bscan(mirror(even, 50.0)))
    assert (level.argmax(axis=1) == 50).all()
    # the window is symmetric: one sample short of a whole period
    np.testing.assert_allclose(level[:, 50], LEVEL_DB, atol=COUNT_DB + 9 / n)


@settings(max_examples=25, deadline=None)
@given(st.floats(8, 0.45 * N))
def test_a_mirror_shows_where_it_is(depth_px: float) -> None:
    level = levels_db(chain(EVEN).bscan(mirror(EVEN, depth_px)))
    assert max(abs(peak_px(ascan) - depth_px) for ascan in level) < PEAK_PX


@settings(max_examples=25, deadline=None)
@given(st.floats(8, 0.35 * N), st.floats(-0.25, 0.25))
def test_so_it_does_behind_any_chirp(depth_px: float, bend: float) -> None:
    chirp = quadratic_chirp(N, bend)
    level = levels_db(chirped(chirp).bscan(mirror(chirp, depth_px)))
    assert max(abs(peak_px(ascan) - depth_px) for ascan in level) < CHIRPED_PEAK_PX


@pytest.mark.parametrize(
    ("shape", "theirs", "width_px", "side_lobe_db"),
    # widths at −6 dB and highest side lobes, Harris 1978
    [
        ("flat", np.ones, 1.21, -13.3),
        ("hann", np.hanning, 2.00, -31.5),
        ("hamming", np.hamming, 1.81, -42.7),
        ("blackman", np.blackman, 2.30, -58.1),
    ],
)
def test_points_are_as_wide_and_side_lobes_as_low_as_the_window_says(
    shape: str, theirs: Callable[[int], Array], width_px: float, side_lobe_db: float
) -> None:
    chirp, finer = quadratic_chirp(N), 32
    steps = np.arange(-8 * finer, 8 * finer + 1) / finer
    through = chirped(chirp, shape=shape)
    spread = np.array([levels_db(through.bscan(mirror(chirp, 100 + step)))[5, 100] for step in steps])
    response = np.abs(np.fft.rfft(theirs(N), finer * N)) / theirs(N).sum()
    theory = response[np.round(np.abs(steps) * finer).astype(int)]
    np.testing.assert_allclose(10 ** ((spread - LEVEL_DB) / 20), theory, atol=POINT_SPREAD_SHARE)
    above = steps[spread > LEVEL_DB - 20 * math.log10(2)]
    assert above[-1] - above[0] + 1 / finer == pytest.approx(width_px, abs=POINT_WIDTH_PX)
    beside = spread[np.abs(steps) > {"flat": 1, "hann": 2, "hamming": 2, "blackman": 3}[shape]]
    assert beside.max() - LEVEL_DB == pytest.approx(side_lobe_db, abs=SIDE_LOBE_DB)


def test_no_image_but_the_mirrors_own_is_seen() -> None:
    """At even wavenumbers the rounding of counts alone is left; behind a chirp, what cubics make of waves."""
    for at, through, least_db in ((EVEN, chain(EVEN), 80.0), (chirp := quadratic_chirp(N), chirped(chirp), 45.0)):
        level = levels_db(through.bscan(mirror(at, 200.0, n_ascans=256)))
        beside = np.abs(np.arange(N // 2) - 200) > 12
        assert (level[:, 200, None] - level[:, beside]).min() > least_db


def test_a_mirror_beyond_the_last_depth_folds_back() -> None:
    level = levels_db(chain(EVEN).bscan(mirror(EVEN, 600.0)))
    assert (level.argmax(axis=1) == N - 600).all()


def false_echo_db(interpolation: str, depth_px: int) -> float:
    """The highest level away from a mirror behind a chirp, over that of the mirror."""
    chirp = quadratic_chirp(N)
    level = levels_db(chirped(chirp, interpolation).bscan(mirror(chirp, float(depth_px))))
    beside = np.abs(np.arange(N // 2) - depth_px) > 12
    return float((level[:, beside].max(axis=1) - level[:, depth_px]).max())


@pytest.mark.parametrize(("depth_px", "cubic_db", "sinc_db"), [(200, 8, 25), (350, 4, 15)])
def test_cubics_see_deeper_than_lines_and_sincs_than_cubics(depth_px: int, cubic_db: float, sinc_db: float) -> None:
    linear = false_echo_db("linear", depth_px)
    assert false_echo_db("cubic", depth_px) < linear - cubic_db
    assert false_echo_db("sinc", depth_px) < linear - sinc_db


@pytest.mark.parametrize("depth_px", [50.0, 150.0, 250.0, 350.0])
def test_what_interpolation_takes_from_waves_is_given_back(depth_px: float) -> None:
    chirp = quadratic_chirp(N)
    level = levels_db(chirped(chirp).bscan(mirror(chirp, depth_px)))
    np.testing.assert_allclose(level.max(axis=1), LEVEL_DB, atol=ROLL_OFF_LEFT_DB)


def test_noise_of_the_detector_is_as_high_at_all_depths() -> None:
    noise = np.random.default_rng(0).normal(2000, 100, (4096, N)).round().astype(np.uint16)
    for interpolation in ("sinc", "cubic", "linear"):
        through = chirped(quadratic_chirp(N), interpolation)
        power_db = 10 * np.log10((10 ** (levels_db(through.bscan(noise)) / 10)).mean(axis=0))
        np.testing.assert_allclose(power_db[4:], power_db[4:].mean(), atol=5 * 4.34 / math.sqrt(4096))
    # of 100 counts through a Hann window: 4·σ²·Σw²/(Σw)² = 6·σ²/n
    even_db = 10 * np.log10((10 ** (levels_db(chain(EVEN).bscan(noise)) / 10)).mean(axis=0))
    np.testing.assert_allclose(even_db[4:], 10 * math.log10(6 * 100**2 / N), atol=5 * 4.34 / math.sqrt(4096))


@pytest.mark.parametrize("n", [128, 1024])
def test_energy_is_kept(n: int) -> None:
    """Parseval: what the depths hold together is the variance of the samples."""
    even = np.arange(n, dtype=np.float64)
    noise = np.random.default_rng(1).integers(0, 60000, (64, n)).astype(np.uint16)
    through = chain(even, shape="flat", background=np.full(n, 30000.0))
    amplitude2 = 10 ** (levels_db(through.bscan(noise)) / 10)
    fringes = noise - 30000.0
    last = np.abs((fringes * (-1) ** np.arange(n)).sum(axis=1)) ** 2 / n**2  # the depth n / 2, which is not kept
    held = amplitude2[:, 0] / 4 + (amplitude2[:, 1:] / 2).sum(axis=1) + last
    np.testing.assert_allclose(held, (fringes**2).mean(axis=1), rtol=QUANTISED_DB * math.log(10) / 10)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_is_the_same_in_all_ascans_is_not_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    signal = mirror(EVEN, 77.7) // 2
    fixed = rng.integers(0, 20000, N).astype(np.uint16)
    through = chirped(quadratic_chirp(N))
    plain, lined = through.bscan(signal), through.bscan(signal + fixed)
    bright = plain > plain.max() - 60 * 256
    np.testing.assert_allclose(levels_db(lined)[bright], levels_db(plain)[bright], atol=0.1)


def test_a_stated_background_is_subtracted_in_place_of_the_mean() -> None:
    still = np.repeat(mirror(EVEN, 50.0)[:1], 64, axis=0)
    assert levels_db(chain(EVEN).bscan(still)).max() < -60  # as the mean holds it
    seen = levels_db(chain(EVEN, background=np.full(N, 30000.0)).bscan(still))
    np.testing.assert_allclose(seen[:, 50], LEVEL_DB, atol=COUNT_DB + 9 / N)


def test_electrons_raise_the_level() -> None:
    spectra = mirror(EVEN, 50.0)
    raised = levels_db(chain(EVEN, electrons_per_count=540.0).bscan(spectra)) - levels_db(chain(EVEN).bscan(spectra))
    np.testing.assert_allclose(raised[:, 45:55], 20 * math.log10(540), atol=2 * COUNT_DB)


@pytest.mark.parametrize(("second_rad", "third_rad"), [(20.0, 0.0), (-35.0, 10.0)])
def test_dispersion_is_taken_off(second_rad: float, third_rad: float) -> None:
    phase = dispersion_phase(N, [second_rad, third_rad])
    chirp = quadratic_chirp(N)
    at_samples = np.interp(chirp, EVEN, phase)
    blurred = levels_db(chirped(chirp).bscan(mirror(chirp, 150.0, at_samples)))
    through = chirped(chirp)
    corrected = chain(np.interp(EVEN, chirp, EVEN), phase_rad=phase)
    sharp = levels_db(corrected.bscan(mirror(chirp, 150.0, at_samples)))
    ideal = levels_db(through.bscan(mirror(chirp, 150.0)))
    assert blurred[:, 140:160].max() < ideal.max() - 6
    point = ideal > ideal.max() - 45
    np.testing.assert_allclose(sharp[point], ideal[point], atol=0.1)
    wrong = chain(np.interp(EVEN, chirp, EVEN), phase_rad=-phase)
    assert levels_db(wrong.bscan(mirror(chirp, 150.0, at_samples)))[:, 140:160].max() < blurred[:, 140:160].max()


def test_dispersion_of_nothing_changes_nothing() -> None:
    spectra = np.random.default_rng(0).integers(0, 4096, (100, N)).astype(np.uint16)
    plain = chain(EVEN).bscan(spectra).astype(int)
    np.testing.assert_allclose(chain(EVEN, phase_rad=np.zeros(N)).bscan(spectra), plain, atol=1)


@settings(max_examples=20, deadline=None)
@given(st.integers(64, 400), st.integers(0, 2**32 - 1))
def test_an_ascan_does_not_depend_on_its_neighbours(n_ascans: int, seed: int) -> None:
    n = 96
    spectra = np.random.default_rng(seed).integers(0, 65536, (n_ascans, n)).astype(np.uint16)
    through = chain(quadratic_chirp(n), background=np.full(n, 1000.0))
    whole = through.bscan(spectra)
    np.testing.assert_array_equal(through.bscan(spectra[::-1]), whole[::-1])
    np.testing.assert_array_equal(through.bscan(spectra[-64:]), whole[-64:])


def test_against_numpy_step_by_step() -> None:
    """The whole chain in float64: mean, Lagrange's cubics, Hann, Fourier, decibels."""
    rng = np.random.default_rng(3)
    spectra = rng.integers(0, 65536, (90, N)).astype(np.uint16)
    chirp = quadratic_chirp(N)
    places = np.interp(EVEN, chirp, EVEN)
    first = np.clip(np.floor(places).astype(int) - 1, 0, N - 4)
    fringes = spectra - spectra.mean(axis=0)
    even = np.zeros_like(fringes)
    for i in range(4):
        others = [j for j in range(4) if j != i]
        even += fringes[:, first + i] * np.prod([(places - first - j) / (i - j) for j in others], axis=0)
    hann = np.hanning(N)
    amplitude = np.abs(np.fft.rfft(even * hann))[:, : N // 2] * 2 / hann.sum()
    found = levels_db(chain(places).bscan(spectra)) - 10 * np.log10(chain(places).gain)
    strong = amplitude > amplitude.max() * 1e-3
    np.testing.assert_allclose(found[strong], 20 * np.log10(amplitude[strong]), atol=2 * COUNT_DB)


@pytest.mark.parametrize("n_ascans", [64, 65, 66, 67, 2000])
@pytest.mark.parametrize("dtype", [np.uint16, np.int16])
def test_the_mean_spectrum_is_that_of_all_ascans(n_ascans: int, dtype: type[np.integer[Any]]) -> None:
    info = np.iinfo(dtype)
    spectra = np.random.default_rng(4).integers(info.min, info.max, (n_ascans, N), dtype, endpoint=True)
    spectra[:, 0], spectra[:, 1] = info.max, info.min
    np.testing.assert_array_equal(mean_spectrum(spectra), spectra.sum(axis=0, dtype=np.int64) / n_ascans)


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "sinc"])
def test_what_is_given_back_is_what_white_noise_loses(interpolation: Interpolation) -> None:
    """Of a matrix that takes samples to even wavenumbers in a window, Fourier-transformed, the sums of squares."""
    n = 520
    places = sample_places(quadratic_chirp(n), "wavenumber")
    read, over = taps(places, interpolation), window("hann", places)
    matrix = np.zeros((n, n))
    for k in range(n):
        matrix[read.first[k] : read.first[k] + read.weights.shape[1], k] = read.weights[k] * over[k]
    power = (np.abs(np.fft.rfft(matrix)) ** 2).sum(axis=0)
    np.testing.assert_allclose(reconstruction(read, over).gain, power[0] / power[: n // 2], rtol=1e-6)


def test_samples_with_a_sign() -> None:
    spectra = np.random.default_rng(0).integers(0, 4096, (64, N))
    signed = chain(EVEN).bscan((spectra - 2048).astype(np.int16))
    np.testing.assert_allclose(signed, chain(EVEN).bscan(spectra.astype(np.uint16)), atol=256 * 0.1)


def test_a_dead_slice_is_dark_and_a_glaring_one_bright() -> None:
    assert (chain(EVEN).bscan(np.full((64, N), 4000, np.uint16)) == 0).all()
    glaring = np.where(np.arange(64)[:, None] % 2, 0, 65535) * np.ones(N)
    assert levels_db(chain(EVEN).bscan(glaring.astype(np.uint16)))[0, 0] == pytest.approx(
        20 * math.log10(65535), abs=COUNT_DB
    )


def test_threads_do_not_meet() -> None:
    slices = np.random.default_rng(0).integers(0, 4096, (12, 200, N)).astype(np.uint16)
    through = chirped(quadratic_chirp(N))
    for found, one in zip(thread_map(through.bscan, slices, 4), slices, strict=True):
        np.testing.assert_array_equal(found, through.bscan(one))


def test_a_chain_is_picklable() -> None:
    through, spectra = chirped(quadratic_chirp(N)), mirror(EVEN, 50.0)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(through)).bscan(spectra), through.bscan(spectra))
