"""Which samples are read for even wavenumbers, and the windows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL, INVERSE_CHIRP_PX

from endoct.modalities.oct.spectra.reconstruction import dispersion_phase, sample_places, taps, window
from tests.modalities.oct.spectra.fringes import quadratic_chirp

N = 128


def read(values: np.ndarray, places: np.ndarray, interpolation: str) -> np.ndarray:
    found = taps(places, interpolation)
    return (values[found.first[:, None] + np.arange(found.weights.shape[1])] * found.weights).sum(axis=1)


@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4), st.floats(-0.3, 0.3))
def test_cubic_reads_cubics_exactly_and_linear_lines(coefficients: list[float], bend: float) -> None:
    places = quadratic_chirp(N, bend)
    cubic = np.polynomial.Polynomial(coefficients, domain=[0, N - 1])
    np.testing.assert_allclose(read(cubic(np.arange(N)), places, "cubic"), cubic(places), atol=1e-9)
    line = np.polynomial.Polynomial(coefficients[:2], domain=[0, N - 1])
    np.testing.assert_allclose(read(line(np.arange(N)), places, "linear"), line(places), atol=1e-9)


@pytest.mark.parametrize("interpolation", ["sinc", "cubic", "linear"])
def test_at_even_places_samples_are_read_as_they_are(interpolation: str) -> None:
    values = np.random.default_rng(0).normal(size=N)
    np.testing.assert_allclose(read(values, np.arange(N, dtype=float), interpolation), values, atol=COORDINATE_ATOL)


@given(st.floats(-0.4, 0.4))
def test_a_chirp_and_its_inverse_say_the_same(bend: float) -> None:
    chirp = quadratic_chirp(N, bend)
    places = sample_places(chirp, "wavenumber")
    assert np.isfinite(places).all()
    u = places / (N - 1)  # what lies there is what was asked for
    np.testing.assert_allclose((N - 1) * (u + bend * u * (1 - u)), np.arange(N), atol=INVERSE_CHIRP_PX)
    np.testing.assert_array_equal(sample_places(chirp, "sample"), np.clip(chirp, 0, N - 1))


def test_what_was_not_recorded_is_not_read() -> None:
    places = sample_places(np.linspace(9.5, 119.5, N), "wavenumber")
    assert np.isnan(places[:10]).all()
    assert np.isnan(places[120:]).all()
    assert np.isfinite(places[10:120]).all()
    assert (taps(places, "cubic").weights[:10] == 0).all()
    shape = window("hann", places)
    assert shape[:11].tolist() == [0] * 11
    np.testing.assert_allclose(shape[10:120], np.hanning(110), atol=COORDINATE_ATOL)


@pytest.mark.parametrize(("name", "numpys"), [("hann", np.hanning), ("hamming", np.hamming), ("blackman", np.blackman)])
def test_windows_are_those_of_numpy(name: str, numpys: type) -> None:
    np.testing.assert_allclose(window(name, np.arange(N, dtype=float)), numpys(N), atol=COORDINATE_ATOL)
    assert (window("flat", np.arange(N, dtype=float)) == 1).all()


def test_dispersion_by_hand() -> None:
    phase = dispersion_phase(5, [3.0, 10.0])  # x = −1, −½, 0, ½, 1
    np.testing.assert_allclose(phase, [-7, 0.75 - 1.25, 0, 0.75 + 1.25, 13])
    np.testing.assert_allclose(dispersion_phase(5, [3.0]), [3, 0.75, 0, 0.75, 3])
