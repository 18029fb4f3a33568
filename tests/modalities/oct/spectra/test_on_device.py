"""Raw spectra by torch against the reference. On torch's CPU device: what differs on a GPU is the order of sums."""

import pickle
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tolerances import ON_DEVICE_AMPLITUDE, ON_DEVICE_COUNTS

from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB
from endoct.modalities.oct.spectra.on_device import OnDevice
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, dispersion_phase, sample_places
from tests.modalities.oct.spectra.fringes import chain, levels_db, mirror, quadratic_chirp

N, ASCANS = 1024, 2000
CHIRP = quadratic_chirp(N)
PLACES = sample_places(CHIRP, "wavenumber")
UNDER_NOISE_DB = 20


@pytest.fixture(scope="module")
def spectra() -> NDArray[np.uint16]:
    """A wall of ten reflectors, a count to 30 counts bright, in noise of 20 counts."""
    rng = np.random.default_rng(0)
    counts = rng.normal(2000, 20, (ASCANS, N))
    for depth_px, amplitude in zip(rng.uniform(60, 300, 10), np.geomspace(1, 30, 10), strict=True):
        phase_rad = rng.uniform(0, 2 * np.pi, (ASCANS, 1))
        counts += amplitude * np.cos(2 * np.pi / N * depth_px * CHIRP + phase_rad)
    return counts.round().astype(np.uint16)


def assert_same(reference: Reconstruction, spectra: NDArray[Any], electrons: float = 1.0) -> None:
    """Assert that torch gives the same counts down to where float32 ends, and the same amplitudes below that too."""
    expected, found = reference.bscan(spectra), OnDevice(reference, "cpu").bscan(spectra)
    assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
    apart = np.abs(found.astype(int) - expected)
    clear = expected >= np.median(expected) - UNDER_NOISE_DB * COUNTS_PER_DB
    assert apart[clear].max() <= ON_DEVICE_COUNTS
    assert_same_amplitudes(expected, found, electrons * np.abs(spectra.astype(int)).max())


def assert_same_amplitudes(expected: NDArray[Any], computed: NDArray[Any], largest: float) -> None:
    theirs, ours = (10 ** (levels_db(bscan) / 20) for bscan in (expected, computed))
    a_count = 10 ** (ON_DEVICE_COUNTS / COUNTS_PER_DB / 20) - 1
    assert (np.abs(ours - theirs) - np.maximum(theirs, ours) * a_count).max() <= ON_DEVICE_AMPLITUDE * largest


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "sinc"])
def test_a_wall_in_noise_is_the_same(spectra: NDArray[np.uint16], interpolation: str) -> None:
    assert_same(chain(PLACES, interpolation), spectra)


@pytest.mark.parametrize("shape", ["hamming", "blackman", "flat"])
def test_so_it_is_through_other_windows(spectra: NDArray[np.uint16], shape: str) -> None:
    assert_same(chain(PLACES, shape=shape), spectra[:200])


def test_so_it_is_with_dispersion_a_background_and_electrons(spectra: NDArray[np.uint16]) -> None:
    phase_rad = dispersion_phase(N, (40.0, -10.0))
    assert_same(chain(PLACES, phase_rad=phase_rad), spectra)
    assert_same(chain(PLACES, background=np.linspace(1900, 2100, N)), spectra)
    assert_same(chain(PLACES, electrons_per_count=540.0, phase_rad=phase_rad), spectra, 540.0)


def test_samples_use_all_their_bits(spectra: NDArray[np.uint16]) -> None:
    whole = np.random.default_rng(1).integers(0, 2**16, (200, N))
    assert_same(chain(PLACES), whole.astype(np.uint16))
    assert_same(chain(PLACES), (whole - 2**15).astype(np.int16))


def test_where_there_is_no_noise_amplitudes_are_the_same_and_levels_of_nothing_are_not() -> None:
    clean = mirror(CHIRP, 150.0, n_ascans=200)
    reference = chain(PLACES)
    expected, found = reference.bscan(clean), OnDevice(reference, "cpu").bscan(clean)
    assert_same_amplitudes(expected, found, clean.max())
    np.testing.assert_allclose(found[:, 150].astype(int), expected[:, 150], atol=ON_DEVICE_COUNTS)


def test_levels_end_where_the_reference_ends_them() -> None:
    nothing = np.full((64, N), 4000, np.uint16)
    assert (OnDevice(chain(np.arange(N, dtype=np.float64)), "cpu").bscan(nothing) == 0).all()
    glaring = chain(PLACES, electrons_per_count=1e9)
    spectra = mirror(CHIRP, 150.0)
    assert (OnDevice(glaring, "cpu").bscan(spectra)[:, 150] == 2**16 - 1).all()
    assert (glaring.bscan(spectra)[:, 150] == 2**16 - 1).all()


def test_it_can_be_sent_to_a_process_after_use(spectra: NDArray[np.uint16]) -> None:
    there = OnDevice(chain(PLACES), "cpu")
    first = there.bscan(spectra[:64])
    assert b"torch" not in pickle.dumps(there)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(there)).bscan(spectra[:64]), first)


def test_memory_of_the_device_that_runs_out_is_that(
    spectra: NDArray[np.uint16], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> torch.Tensor:
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(torch.fft, "rfft", full)
    with pytest.raises(MemoryError, match="device cpu"):
        OnDevice(chain(PLACES), "cpu").bscan(spectra[:64])
