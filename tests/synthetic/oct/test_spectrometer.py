"""Point spread, roll-off, levels and artefacts of the spectrometer, against their formulas."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import LEVEL_DB, POINT_SPREAD_PX

from endoct.synthetic.draw import draw
from endoct.synthetic.oct.spectrometer import (
    FULL_SCALE,
    Spectrometer,
    axial_fwhm_px,
    bell,
    chirp,
    counts,
    digitised,
    reconstruct,
    roll_off,
    spectrometer,
)
from endoct.synthetic.sample.parameters import Oct

N = 1024
M = np.arange(N, dtype=np.float64)
DARK = np.full(N, 80.0)


@pytest.fixture(scope="module")
def oct_() -> Oct:
    drawn = draw("learning", 1).oct
    return drawn.model_copy(
        update={"db_per_count": 0.3, "floor_count": 60.0, "excess_noise_db": 12.0, "floor_bands_db": 0.0}
    )


@pytest.fixture(scope="module")
def instrument(oct_: Oct) -> Spectrometer:
    return spectrometer(oct_, N)


def _field(*reflectors: tuple[float, complex]) -> NDArray[np.complex64]:
    total = sum(a * np.exp(2j * np.pi * (M - (N - 1) / 2) * x / N) for x, a in reflectors)
    return np.asarray(total, dtype=np.complex64)[None]


def _depth(instrument: Spectrometer, fringes: NDArray[np.float64], finer: int = 1) -> NDArray[np.float64]:
    """Return power against that of a reflector at 0 dB, ``finer`` bins a pixel."""
    coherent = float(np.sum(instrument.reference(M) * instrument.window))
    spectrum = np.fft.rfft(fringes * instrument.window, finer * N) / (coherent * instrument.unit)
    return np.asarray(np.abs(spectrum) ** 2, dtype=np.float64)


def _without_reference(instrument: Spectrometer, field: NDArray[np.complex64]) -> NDArray[np.float64]:
    return counts(instrument, M, field)[0].astype(np.float64) - instrument.reference(M)


@pytest.mark.parametrize("place", [40.0, 150.25, 333.5])
@pytest.mark.parametrize("resolution_mm", [0.0076, 0.0095, 0.012])
def test_a_reflector_is_seen_at_its_path_as_wide_as_the_resolution(
    oct_: Oct, place: float, resolution_mm: float
) -> None:
    one = spectrometer(oct_.model_copy(update={"axial_resolution_mm": resolution_mm}), N)
    finer = 64
    power = _depth(one, _without_reference(one, _field((place, 1e-3))), finer)
    peak = int(np.argmax(power))
    assert peak / finer == pytest.approx(place, abs=POINT_SPREAD_PX)
    above = np.flatnonzero(power > power[peak] / 2)
    assert (above.size - 1) / finer * oct_.axial_pixel_mm == pytest.approx(resolution_mm, rel=0.02)


def test_hann_alone_gives_1_44_pixels_and_nothing_finer_can_be_had(oct_: Oct) -> None:
    assert axial_fwhm_px(np.hanning(N)) == pytest.approx(1.44, abs=0.01)
    finest = spectrometer(oct_.model_copy(update={"axial_resolution_mm": 0.001}), N)
    np.testing.assert_array_equal(finest.reference(M), oct_.reference_counts)


def test_sensitivity_rolls_off_as_sinc_and_gauss(oct_: Oct) -> None:
    steep = oct_.model_copy(update={"roll_off_db": 9.0})
    loss = 20 * np.log10(roll_off(steep, np.array([0.0, 256.0, 512.0]), N))
    half = 20 * math.log10(math.sin(math.pi / 4) / (math.pi / 4)) - (9 - 3.9224) / 4
    np.testing.assert_allclose(loss, [0, half, -9], atol=1e-3)
    np.testing.assert_array_equal(roll_off(steep, np.array([-100.0]), N), roll_off(steep, np.array([100.0]), N))


def test_levels_are_those_over_the_mean_noise(oct_: Oct, instrument: Spectrometer) -> None:
    rng = np.random.default_rng(1)
    reference = np.broadcast_to(counts(instrument, M, np.zeros((1, N), np.complex64)), (400, N))
    noise = digitised(rng, instrument, M, reference, DARK) - reference[0] - 80
    power = np.stack([_depth(instrument, a_scan) for a_scan in noise])[:, 20:500]
    assert 10 * math.log10(power.mean()) == pytest.approx(0, abs=LEVEL_DB)
    reflector = _depth(instrument, _without_reference(instrument, _field((200.0, instrument.unit * 10 ** (30 / 20)))))
    assert 10 * math.log10(reflector[200]) == pytest.approx(30, abs=LEVEL_DB)
    # white scatterers of unit level, one a pixel
    scatterers = rng.standard_normal((400, N, 2)) @ np.array([1, 1j]) * math.sqrt(instrument.bone_unit2 / 2)
    field = N * np.fft.ifft(scatterers, axis=1).astype(np.complex64)
    linear = 2 * field.real * instrument.reference(M)
    power = np.stack([_depth(instrument, a_scan) for a_scan in linear])[:, 20:500]
    # fringes show every scatterer's mirror image as well
    assert 10 * math.log10(power.mean() / 2) == pytest.approx(0, abs=LEVEL_DB)


def test_the_floor_of_a_bscan_is_the_stated_count(oct_: Oct, instrument: Spectrometer) -> None:
    reference = np.broadcast_to(counts(instrument, M, np.zeros((1, N), np.complex64)), (600, N))
    spectra = digitised(np.random.default_rng(2), instrument, M, reference, DARK)
    high = oct_.model_copy(update={"floor_count": 150.0})  # u8 cuts off none of the darkest
    samples = reconstruct(high, instrument, spectra)
    assert samples.shape == (512, 600)
    floor = samples[20:].astype(np.float64)
    assert floor.mean() == pytest.approx(150.0, abs=0.5)
    assert floor.std() * 0.3 == pytest.approx(5.57, abs=0.05)
    skew = np.mean((floor - floor.mean()) ** 3) / floor.std() ** 3
    assert skew == pytest.approx(-1.14, abs=0.05)


def test_what_lies_before_zero_delay_is_seen_mirrored(instrument: Spectrometer) -> None:
    power = _depth(instrument, _without_reference(instrument, _field((-37.0, 1e-3))), 16)
    assert np.argmax(power) / 16 == pytest.approx(37, abs=POINT_SPREAD_PX)


def test_what_lies_beyond_full_depth_folds_back(instrument: Spectrometer) -> None:
    power = _depth(instrument, _without_reference(instrument, _field((600.0, 1e-3))), 16)
    assert np.argmax(power) / 16 == pytest.approx(N - 600, abs=POINT_SPREAD_PX)


def test_two_reflectors_leave_an_echo_at_the_difference_of_their_paths(instrument: Spectrometer) -> None:
    a, b = 0.02, 0.01
    power = _depth(instrument, _without_reference(instrument, _field((180.0, a), (240.0, b))))
    near = power[50:70]
    assert int(np.argmax(near)) + 50 == 60
    assert 10 * math.log10(near.max()) == pytest.approx(20 * math.log10(a * b / instrument.unit), abs=LEVEL_DB)


def test_an_overflowing_ascan_streaks_over_all_depths(oct_: Oct, instrument: Spectrometer) -> None:
    field = np.repeat(_field((100.3, 0.002)), 60, axis=0)
    field *= np.exp(2j * np.pi * np.linspace(0, 7, 60))[:, None].astype(np.complex64)
    field[30] *= 400  # +52 dB
    spectra = digitised(np.random.default_rng(3), instrument, M, counts(instrument, M, field), DARK)
    assert spectra[30].max() == FULL_SCALE
    assert np.delete(spectra, 30, axis=0).max() < FULL_SCALE
    samples = reconstruct(oct_, instrument, spectra)
    deep = samples[250:].astype(np.float64).mean(axis=0)
    assert deep[30] > np.delete(deep, 30).mean() + 10 / 0.3


def test_noise_is_reproducible_and_close_to_gaussian() -> None:
    numbers = bell(np.random.default_rng(4), 200_001)
    np.testing.assert_array_equal(numbers, bell(np.random.default_rng(4), 200_001))
    assert numbers.shape == (200_001,)
    assert numbers.mean() == pytest.approx(0, abs=0.01)
    assert numbers.std() == pytest.approx(1, abs=0.01)
    assert np.mean(numbers**4) == pytest.approx(2.7, abs=0.05)
    neighbours = np.corrcoef(numbers[:-1], numbers[1:])[0, 1]
    assert abs(neighbours) < 0.01


def test_the_chirp_rises_over_all_pixels() -> None:
    m = chirp(N)
    assert np.all(np.diff(m) > 0)
    # a bit of the first pixel beyond the spectrum's end, by hand from the polynomial
    np.testing.assert_allclose(m[[0, 500, 1000]], [-0.48, 570.68, 1006.49], atol=1e-6)
    assert m.max() < N
