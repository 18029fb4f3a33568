"""The polymer of the catheter's sheath: bands of speckle behind its lines, which fade in and out around the turn."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft, sparse

from endoct.synthetic.oct.focus import spot_sigma_mm
from endoct.synthetic.oct.reflectors import fading_db, sheath_path_mm
from endoct.synthetic.oct.spectrometer import centred, roll_off
from endoct.synthetic.oct.sweep import REACH, Sweep
from endoct.synthetic.sample.randomness import Stage, bell, generator

N_NODES = 512  # around the sheath, which is narrower than the spot out of its focus
SOFT_PX = 1.5  # over which a band begins and ends
MOST_PX = 64  # of a band: scatterers are drawn for so many axial pixels, whatever its thickness


def add_sheath(sweep: Sweep, field: NDArray[np.complex64]) -> None:
    """Add what the sheath scatters to the scatterers ``field`` (column, n), in place."""
    oct_, n = sweep.oct_, field.shape[1]
    pixel, alpha = oct_.axial_pixel_mm, sweep.echoes.alpha_rad
    for line, sheath in enumerate(oct_.sheath):
        depth_px = min(MOST_PX - 8, sheath.thickness_mm / pixel)
        begin_px = (sheath_path_mm(sweep, line) - oct_.first_sample_mm) / pixel
        sigma = float(spot_sigma_mm(oct_, np.array([sheath.radius_mm]))[0]) / sheath.radius_mm / (2 * math.pi / N_NODES)
        rng = generator(sweep.seed, Stage.SHEATH, sweep.slice_index, line)
        n_px = 2 * math.ceil(depth_px / 2) + 6
        scatterers = bell(rng, N_NODES * 2 * MOST_PX).reshape(N_NODES, 2 * MOST_PX)[:, : 2 * n_px]
        band = (_around(alpha, sigma) @ scatterers).view(np.complex64)
        # a few pixels early, and as many late; and moved by the part of a pixel that the sheath is off them
        first = np.floor(begin_px).astype(np.intp) - 2
        off = np.exp(-2j * np.pi * np.outer(begin_px - np.floor(begin_px), fft.fftfreq(n_px)))
        band = fft.ifft(fft.fft(band, axis=1) * off.astype(np.complex64), axis=1)
        bins = first[:, None] + np.arange(n_px)
        into, left = bins - begin_px[:, None], begin_px[:, None] + depth_px - bins
        share = np.clip(into / SOFT_PX + 0.5, 0, 1) * np.clip(left / SOFT_PX + 0.5, 0, 1)
        level = 10 ** ((sheath.band_db + fading_db(sweep, line)) / 10)
        amplitude = np.sqrt(0.5 * sweep.spectrometer.bone_unit2 * level[:, None] * share)
        amplitude = amplitude * roll_off(oct_, bins.astype(np.float64), n) * centred(bins)
        column, k = np.nonzero((share > 0) & (np.abs(bins) < n // 2))
        field[column, bins[column, k] % n] += (band * amplitude.astype(np.float32))[column, k]


def _around(alpha_rad: NDArray[np.float64], sigma: float) -> sparse.csr_array:
    """Return how much of every node around the sheath each column gathers: a Gaussian of unit power."""
    at = np.mod(alpha_rad, 2 * np.pi) * (N_NODES / (2 * np.pi))
    half = min(N_NODES // 2 - 1, math.ceil(REACH * sigma))
    node = np.rint(at).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    weight = np.exp(-0.5 * ((node - at[:, None]) / sigma) ** 2)
    weight /= np.sqrt(np.sum(weight**2, axis=1, keepdims=True))
    ends = node.shape[1] * np.arange(len(at) + 1)
    return sparse.csr_array(
        (weight.astype(np.float32).ravel(), np.mod(node, N_NODES).ravel(), ends), shape=(len(at), N_NODES)
    )
