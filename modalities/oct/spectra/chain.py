"""From what is stated of raw spectra to the chain that makes B-scans of them, wherever its vectors lie."""

from collections.abc import Callable

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.oct.spectra.keys import EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, reconstruction
from endoct.modalities.oct.spectra.resampling import dispersion_phase, sample_places, taps, window

LEAST_COVERED = 0.5
"""Share of the even wavenumbers that a chirp must reach; places in other units reach none or all too few."""

ReadVector = Callable[[str, str, int], Coordinates]


def chain_of(keys: SpectraKeys, read: ReadVector) -> Reconstruction:
    """Return the chain that ``keys`` describe; ``read`` returns a vector by its name, its key, and its length.

    Raises :class:`EndoctError` where a vector is missing, or is none of its kind.
    """
    n = keys.samples
    places = np.arange(n, dtype=np.float64)
    if keys.chirp != EVEN:
        places = _places(read(keys.chirp, "spectra.chirp", n), keys)
    background = None
    if keys.offset is not None:
        offset = read(keys.offset, "spectra.offset", n)
        background = offset / keys.electrons_per_count if keys.background == "offset" else None
    phase = None
    if keys.dispersion_rad is not None:
        phase = dispersion_phase(n, keys.dispersion_rad)
    elif keys.dispersion is not None:
        phase = read(keys.dispersion, "spectra.dispersion", n)
    return reconstruction(
        taps(places, keys.interpolation),
        window(keys.window, places),
        electrons_per_count=keys.electrons_per_count,
        background=background,
        phase_rad=phase,
    )


def _places(chirp: Coordinates, keys: SpectraKeys) -> Coordinates:
    """Return where even wavenumbers lie among the samples. Raises :class:`EndoctError` for what is no chirp."""
    if (falls := np.flatnonzero(np.diff(chirp) <= 0)).size:
        i = int(falls[0])
        raise EndoctError(
            f"the chirp in {keys.chirp} does not rise throughout",
            found=f"{chirp[i]:g} and then {chirp[i + 1]:g} at values {i} and {i + 1}",
            expected=f"places in samples, from about 0 to about {chirp.size - 1}",
            remedy="check the file; one that falls throughout is turned around by subtracting it from "
            f"{chirp.size - 1}",
        )
    reached = np.count_nonzero((np.arange(chirp.size) >= chirp[0]) & (np.arange(chirp.size) <= chirp[-1]))
    places = sample_places(chirp, keys.chirp_gives)
    if np.isfinite(places).sum() < LEAST_COVERED * chirp.size or reached < LEAST_COVERED * chirp.size:
        raise EndoctError(
            f"the chirp in {keys.chirp} holds no places in samples",
            found=f"values from {chirp[0]:g} to {chirp[-1]:g}",
            expected=f"from about 0 to about {chirp.size - 1}",
            remedy="scale it, if it holds wavenumbers; or check the file",
        )
    return places
