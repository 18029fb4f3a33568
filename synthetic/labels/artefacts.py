"""What a B-scan shows besides bone: lines of the instrument and of the detector, and their ghosts."""

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Mask
from endoct.synthetic.model import Model
from endoct.synthetic.oct.bscan import artificial
from endoct.synthetic.oct.reflectors import N_FACES, N_GHOSTS
from endoct.synthetic.oct.spectrometer import spectrometer
from endoct.synthetic.sample.presets import PRESETS

FLAGS = (
    "1 capillary face or its ghost",
    "2 sheath or catheter",
    "4 detector line",
    "8 autocorrelation",
    "16 saturated A-scan",
)
FACE, CATHETER, DETECTOR, AUTOCORRELATION, SATURATED = 1, 2, 4, 8, 16
FAINTEST_DB = 0.0
"""What is fainter than the noise is no artefact that one could see."""


def artefacts(model: Model, slice_index: int) -> NDArray[np.uint8]:
    """Return bit ``FLAGS`` of what outshines the noise, u8 (depth, A-scan).

    A line covers the samples within its full width at half maximum, wherever it appears: mirrored ones too.
    """
    size, oct_ = PRESETS[model.sample.preset], model.sample.oct
    light, column, saturated = artificial(model.sample, model.wall, model.appearance, slice_index)
    n, unit = 2 * size.n_depth, spectrometer(oct_, 2 * size.n_depth).unit
    flags = np.zeros((size.n_depth, light.delay_px.shape[1]), np.uint8)
    reach_px = oct_.axial_resolution_mm / oct_.axial_pixel_mm
    with np.errstate(divide="ignore"):
        level_db = 20 * np.log10(np.abs(light.amplitude) / unit)
    instrument = N_FACES + len(oct_.sheath) + 1
    own = instrument + N_GHOSTS
    for k in range(light.delay_px.shape[0]):
        if k < own or k >= light.n_optical:
            kind = FACE if k < N_FACES else CATHETER if k < instrument else FACE if k < own else DETECTOR
            _draw(flags, light.delay_px[k], level_db[k] > FAINTEST_DB, n, reach_px, kind)
    for k in range(instrument):
        for other in range(k):
            # |E|² against 2·Re E: the product of two amplitudes compares with twice one
            ghost_db = level_db[k] + level_db[other] + 20 * np.log10(unit)
            apart = light.delay_px[k] - light.delay_px[other]
            _draw(flags, apart, ghost_db > FAINTEST_DB, n, reach_px, AUTOCORRELATION)
    flags = flags[:, column]
    flags[:, saturated] |= SATURATED
    return flags


def _draw(flags: NDArray[np.uint8], delay_px: Coordinates, visible: Mask, n: int, reach_px: float, kind: int) -> None:
    """Set ``kind`` around where a path difference shows, folded at zero delay and at full depth, in place."""
    row = np.abs(np.mod(delay_px + n / 2, n) - n / 2)
    for k in range(-int(reach_px) - 1, int(reach_px) + 2):
        at = np.rint(row).astype(np.intp) + k
        drawn = np.flatnonzero(visible & (np.abs(at - row) <= reach_px) & (at >= 0) & (at < flags.shape[0]))
        flags[at[drawn], drawn] |= kind
