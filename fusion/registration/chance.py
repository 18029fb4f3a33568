"""How much a correlation says, and how likely chance alone would give as much."""

from dataclasses import replace

import numpy as np

from endoct.fusion.evidence.evidence import Evidence, reoriented
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Orientation
from endoct.fusion.registration.correlation import correlate, padded_rows, spectra
from endoct.stitching.arrays import Image

PIECE_MM2 = 0.25
"""Wall whose evidence hangs together, as the search sees it: one independent piece."""
FEWEST_PIECES = 4
SHUFFLES = 16
SLICE_MM = 1.0
"""Height of the rings that a shuffle turns; cells, which must stay whole, are smaller."""
EULER = 0.5772156649


def score(correlation: Image, overlap_mm2: Image) -> Image:
    """Return how far from chance each correlation is, float32 of the same shape, in standard deviations.

    Fisher's transform artanh(r) of a correlation by chance scatters with 1/√(n − 3), n the independent pieces of wall
    in the overlap. Where there are too few the score is 0.
    """
    pieces = overlap_mm2 / np.float32(PIECE_MM2) - FEWEST_PIECES
    strength = np.arctanh(np.minimum(np.abs(correlation), np.float32(0.999)))
    return np.asarray(strength * np.sqrt(np.maximum(pieces, 0)), dtype=np.float32)


def chance_of(best: float, a: Evidence, b: Evidence, orientation: Orientation, n_maps: int) -> float:
    """Return how likely ``b`` would reach the score ``best`` somewhere on ``a`` in ``n_maps`` maps if it did not match.

    A permutation null: rings of ``b``, ``SLICE_MM`` high, are turned at random against each other, so that cells and
    light stay as they are but no place is right any more; nor are the orientations other than ``orientation``, in which
    alone the shuffled are laid on ``a``. To the highest scores of all these maps Gumbel's distribution of extremes is
    fitted. ``a`` and ``b`` have rows and columns of one spacing. The same arguments give the same answer.
    """
    random = np.random.default_rng(0)
    fixed = spectra(a.values, a.valid, padded_rows(a.z_mm.size, b.z_mm.size))
    sample_mm2 = np.float32(a.dz_mm * a.column_mm)
    highest = []
    for _ in range(SHUFFLES):
        shuffled = _shuffled(b, random)
        for mirrored, z_reversed in ALL_ORIENTATIONS:
            if (mirrored, z_reversed) == orientation:
                continue
            turned = reoriented(shuffled, mirrored=mirrored, z_reversed=z_reversed, z_scale=1.0)
            correlation, overlap = correlate(fixed, turned)
            highest.append(float(score(correlation, overlap * sample_mm2).max()))
    width = max(float(np.std(highest, ddof=1)) * np.sqrt(6) / np.pi, 1e-6)
    mode = float(np.mean(highest)) - EULER * width
    return float(-np.expm1(-n_maps * np.exp(-min((best - mode) / width, 700.0))))


def _shuffled(evidence: Evidence, random: np.random.Generator) -> Evidence:
    """Return ``evidence`` with its rings turned at random."""
    values, valid = evidence.values.copy(), evidence.valid.copy()
    height = max(1, round(SLICE_MM / evidence.dz_mm))
    for first in range(-int(random.integers(height)), values.shape[0], height):
        ring = slice(max(first, 0), first + height)
        turn = int(random.integers(values.shape[1]))
        values[ring], valid[ring] = np.roll(values[ring], turn, axis=1), np.roll(valid[ring], turn, axis=1)
    return replace(evidence, values=values, valid=valid)
