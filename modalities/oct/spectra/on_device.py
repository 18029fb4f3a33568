"""B-scans of raw spectra by torch: the steps of the reference, for a whole slice at a time. Loads torch."""

import functools
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from endoct.modalities.device import memory_of
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.reconstruction import Counts, Reconstruction

MOST = float(np.iinfo(np.uint16).max)


@dataclass(frozen=True, eq=False)
class OnDevice:
    """The chain ``reference`` on ``device``, as torch names it; picklable, as nothing of the device is in it."""

    reference: Reconstruction
    device: str

    def bscan(self, spectra: Counts) -> NDArray[np.uint16]:
        """Return the B-scan (A-scan, n / 2) of ``spectra`` (A-scan, n), as :meth:`Reconstruction.bscan` does.

        Sums in float32 are taken in another order there, so that amplitudes differ by about 2⁻²⁴ of the largest sample.
        Levels down to 20 dB below noise of a digit or more differ by one count at most, those of hardly anything by
        many.
        Raises ``MemoryError`` where the device's memory does not hold the slice.
        """
        with memory_of(self.device):
            return _bscan(spectra, _constants(self))


@dataclass(frozen=True, eq=False)
class _Constants:
    """A chain's arrays as tensors on its device; ``turning``, complex64 (n,), takes the dispersion off, if any."""

    first: Tensor
    weights: Tensor
    gain: Tensor
    background: Tensor | None
    turning: Tensor | None


@functools.lru_cache(maxsize=2)  # two sides of a comparison
def _constants(chain: OnDevice) -> _Constants:
    of = chain.reference

    def there(array: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(array).to(chain.device)

    return _Constants(
        first=there(of.first.astype(np.int64)),
        weights=there(of.weights),
        gain=there(of.gain),
        background=None if of.background is None else there(of.background),
        turning=None if of.cos_sin is None else torch.complex(there(of.cos_sin[0]), there(-of.cos_sin[1])),
    )


def _bscan(spectra: Counts, of: _Constants) -> NDArray[np.uint16]:
    samples = torch.from_numpy(spectra.view(np.int16)).to(of.first.device).to(torch.int32)
    if spectra.dtype.kind == "u":
        samples = samples & 0xFFFF  # torch can do little with unsigned types
    background = of.background if of.background is not None else samples.sum(dim=0) / float(len(samples))
    fringes = _resampled(samples.float(), of) - _resampled(background[None].double(), of).float()
    n_depth = fringes.shape[1] // 2
    if of.turning is None:
        spectrum = torch.fft.rfft(fringes)[:, :n_depth]
    else:
        spectrum = torch.fft.fft(fringes * of.turning)[:, :n_depth]
    power = (spectrum.real**2 + spectrum.imag**2) * of.gain
    level = (10 * torch.log10(power) - ZERO_DB) * COUNTS_PER_DB + 0.5  # which rounds
    counts = level.clamp(0, MOST).to(torch.int32).to(torch.int16)  # the bits of the unsigned ones
    return counts.cpu().numpy().view(np.uint16)


def _resampled(values: Tensor, of: _Constants) -> Tensor:
    """Return ``values`` (A-scan, n) at even wavenumbers, with the window in them."""
    taps = (values[:, of.first + k] * of.weights[:, k] for k in range(of.weights.shape[1]))
    return functools.reduce(Tensor.add_, taps)
