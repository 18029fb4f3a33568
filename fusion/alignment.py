"""Where one side's wall lies in the other side's frame, found globally and refined, or not at all.

The search is exhaustive: masked normalised cross-correlation over every turn (θ is a circle), every shift, a
range of z scales and every orientation left open. Its sign carries no information and is not used. The best
place is refined to a fraction of a sample. How far it stands out decides whether it is believed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from endoct.fusion.correlation import masked_correlation
from endoct.fusion.prepare import Evidence, on_grid
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.circle import gaussian, wrap_rad

SEARCH_DZ_MM = 0.08
SEARCH_COLUMNS = 256
SEARCH_BAND_MM = (0.06, 0.3)
"""Structure the search looks at, as sigmas of two Gaussians: what is smaller is noise; what is larger has too few
independent pieces on one bore's wall to tell places apart."""
DISTINCT_MM = 0.75
"""Two places nearer than this are one peak."""
LEAST_OVERLAP = 0.25
"""Of the largest overlap any shift has; less is chance."""
BELIEVABLE = 0.2
CLIP = {"relief": (0.0, 0.15), "darkness": (-0.5, 1.0), "mask": (0.0, 1.0)}
"""Beyond these, evidence of a kind says no more; mm for relief."""


@dataclass(frozen=True)
class Alignment:
    """Maps side B into side A's frame: θ_A = θ_shift ± θ_B, z_A = z_shift + z_scale·(±z_B).

    θ_B counts negative if ``mirrored``, z_B if ``z_reversed``. ``correlation`` is that of the two sides' evidence
    for cells in place (its sign says whether they agree or are each other's negative), ``ratio`` how its score
    compares with the runner-up's anywhere else, ``confidence`` |correlation|·(1 − 1/ratio), ``overlap_mm2`` the
    wall both have seen.
    """

    theta_shift_rad: float
    z_shift_mm: float
    z_scale: float = 1.0
    mirrored: bool = False
    z_reversed: bool = False
    confidence: float = 0.0
    correlation: float = 0.0
    ratio: float = 1.0
    overlap_mm2: float = 0.0

    def theta_to_a(self, theta_b_rad: ArrayLike) -> Coordinates:
        """Return θ in A's frame, in [0, 2π), of θ in B's (any shape)."""
        sense = -1.0 if self.mirrored else 1.0
        return np.mod(self.theta_shift_rad + sense * np.asarray(theta_b_rad, dtype=np.float64), 2 * np.pi)

    def theta_to_b(self, theta_a_rad: ArrayLike) -> Coordinates:
        """Return θ in B's frame, in [0, 2π), of θ in A's (any shape)."""
        sense = -1.0 if self.mirrored else 1.0
        return np.mod(sense * (np.asarray(theta_a_rad, dtype=np.float64) - self.theta_shift_rad), 2 * np.pi)

    def z_to_a(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return z in A's frame, mm, of z in B's (any shape)."""
        direction = -1.0 if self.z_reversed else 1.0
        return np.asarray(self.z_shift_mm + self.z_scale * direction * np.asarray(z_b_mm, dtype=np.float64))

    def z_to_b(self, z_a_mm: ArrayLike) -> Coordinates:
        """Return z in B's frame, mm, of z in A's (any shape)."""
        direction = -1.0 if self.z_reversed else 1.0
        return np.asarray(direction * (np.asarray(z_a_mm, dtype=np.float64) - self.z_shift_mm) / self.z_scale)

    def inverse(self) -> "Alignment":
        """Return the alignment that maps A into B's frame."""
        direction = -1.0 if self.z_reversed else 1.0
        sense = -1.0 if self.mirrored else 1.0
        return replace(
            self,
            theta_shift_rad=float(np.mod(-sense * self.theta_shift_rad, 2 * np.pi)),
            z_shift_mm=-direction * self.z_shift_mm / self.z_scale,
            z_scale=1 / self.z_scale,
        )


@dataclass(frozen=True)
class NotAligned:
    """No place stood out: why, in a full sentence, and the best there was."""

    reason: str
    best: Alignment | None = None


Orientation = tuple[bool, bool]
"""(mirrored, z_reversed)"""

ALL_ORIENTATIONS: tuple[Orientation, ...] = ((False, False), (True, False), (False, True), (True, True))


def open_orientations(*, handedness_known: bool, travel_known: bool) -> tuple[Orientation, ...]:
    """Return the orientations (mirrored, z_reversed) to search.

    With the direction of travel unknown all four: the wall seen from its other end is mirrored as well.
    """
    if not travel_known:
        return ALL_ORIENTATIONS
    return ALL_ORIENTATIONS[:1] if handedness_known else ALL_ORIENTATIONS[:2]


def align(
    a: Evidence,
    b: Evidence,
    *,
    orientations: tuple[Orientation, ...] = ALL_ORIENTATIONS,
    z_scale_range: tuple[float, float] = (0.95, 1.05),
    force: bool = False,
) -> Alignment | NotAligned:
    """Return where ``b`` lies on ``a``, to a fraction of a sample, or why that cannot be said.

    ``force`` believes the best place however little it stands out.
    """
    a, b = clipped(a), clipped(b)
    found = search(a, b, orientations, z_scale_range)
    if found is None:
        return NotAligned("The two sides share no structure: at least one shows no cells.")
    if found.confidence < BELIEVABLE and not force:
        return NotAligned(
            f"No place of one side on the other stands out: the best correlates at {abs(found.correlation):.2f}, "
            f"{found.ratio:.2f} times the runner-up.",
            found,
        )
    from endoct.fusion.refinement import refine

    return refine(a, b, found, z_scale_range)


def clipped(evidence: Evidence) -> Evidence:
    """Return ``evidence`` without the values beyond which it says no more."""
    return replace(evidence, values=np.clip(evidence.values, *CLIP[evidence.kind]))


def search(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> Alignment | None:
    """Return the best place on the search grid, or None where nothing correlates at all."""
    candidates = [
        candidate
        for orientation in orientations
        for scale in _scales(a, b, z_scale_range)
        for candidate in _peaks(a, b, orientation, scale)
    ]
    if not candidates:
        return None
    score, best = max(candidates, key=lambda candidate: candidate[0])
    z_middle = float(b.z_mm[[0, -1]].mean())
    others = [s for s, other in candidates if not _same_place(best, other, z_middle, a.radius_mm)]
    ratio = min(score / max(max(others, default=0.0), 1e-6), 100.0)
    return replace(best, ratio=ratio, confidence=abs(best.correlation) * (1 - 1 / ratio))


def _scales(a: Evidence, b: Evidence, z_scale_range: tuple[float, float]) -> Coordinates:
    """Return z scales so close that between two of them no end of the overlap is off by more than a row."""
    low, high = z_scale_range
    length_mm = min(float(np.ptp(a.z_mm)), float(np.ptp(b.z_mm)))
    n = 1 + int(np.ceil((high - low) * length_mm / (4 * SEARCH_DZ_MM)))
    return np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])


def _peaks(a: Evidence, b: Evidence, orientation: Orientation, scale: float) -> Iterator[tuple[float, Alignment]]:
    """Yield (score, alignment) of the two best, distinct places in one orientation at one scale.

    The score is |correlation|·√(overlap / largest overlap): by chance, correlations scatter with 1/√overlap.
    """
    mirrored, z_reversed = orientation
    turned = reoriented(b, mirrored=mirrored, z_reversed=z_reversed, z_scale=scale)
    grid_a, grid_b = _searchable(a), _searchable(turned)
    correlation, overlap = masked_correlation(grid_a.values, grid_a.valid, grid_b.values, grid_b.valid)
    most = float(overlap.max())
    if most < 1:
        return
    score = np.abs(correlation) * np.sqrt(overlap / most) * (overlap >= LEAST_OVERLAP * most)
    n_z, n_theta = score.shape
    for _ in range(2):
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if not score[row, column] > 0:
            return
        yield (
            float(score[row, column]),
            Alignment(
                theta_shift_rad=2 * np.pi * float(column) / n_theta,
                z_shift_mm=float(grid_a.z_mm[0] - grid_b.z_mm[0] + (row - grid_b.z_mm.size + 1) * SEARCH_DZ_MM),
                z_scale=float(scale),
                mirrored=mirrored,
                z_reversed=z_reversed,
                correlation=float(correlation[row, column]),
                overlap_mm2=float(overlap[row, column]) * SEARCH_DZ_MM * grid_a.column_mm,
            ),
        )
        rows = np.abs(np.arange(n_z) - row) * SEARCH_DZ_MM < DISTINCT_MM
        off = np.abs(np.arange(n_theta) - column)
        columns = np.minimum(off, n_theta - off) * grid_a.column_mm < DISTINCT_MM
        score[np.ix_(rows, columns)] = 0


def _searchable(evidence: Evidence) -> Evidence:
    n = max(1, int(np.floor(float(np.ptp(evidence.z_mm)) / SEARCH_DZ_MM)) + 1)
    grid = on_grid(evidence, evidence.z_mm[0] + SEARCH_DZ_MM * np.arange(n), SEARCH_COLUMNS)
    fine, slow = (blurred(grid, sigma_mm).values for sigma_mm in SEARCH_BAND_MM)
    return replace(grid, values=np.where(grid.valid, fine - slow, np.float32(0)))


def blurred(evidence: Evidence, sigma_mm: float) -> Evidence:
    """Return ``evidence`` smoothed by a Gaussian over its valid samples."""
    sigmas = sigma_mm / evidence.dz_mm, sigma_mm / evidence.column_mm
    weight = gaussian(evidence.valid.astype(np.float32), *sigmas)
    total = gaussian(np.where(evidence.valid, evidence.values, np.float32(0)), *sigmas)
    values: Image = np.divide(total, weight, out=np.zeros_like(total), where=evidence.valid)
    return replace(evidence, values=values)


def reoriented(evidence: Evidence, *, mirrored: bool, z_reversed: bool, z_scale: float) -> Evidence:
    """Return ``evidence`` at θ' = ±θ and z' = z_scale·(±z), rows ascending in z'."""
    n_theta = evidence.values.shape[1]
    rows = slice(None, None, -1 if z_reversed else 1)
    columns = slice(None, None, -1 if mirrored else 1)
    last_rad = evidence.theta0_rad + 2 * np.pi * (n_theta - 1) / n_theta
    return replace(
        evidence,
        values=evidence.values[rows, columns],
        valid=evidence.valid[rows, columns],
        z_mm=z_scale * (-evidence.z_mm[::-1] if z_reversed else evidence.z_mm),
        dz_mm=z_scale * evidence.dz_mm,
        theta0_rad=-last_rad if mirrored else evidence.theta0_rad,
    )


def _same_place(one: Alignment, other: Alignment, z_middle_mm: float, radius_mm: float) -> bool:
    if (one.mirrored, one.z_reversed) != (other.mirrored, other.z_reversed):
        return False
    off_rad = wrap_rad(one.theta_shift_rad - other.theta_shift_rad)
    off_mm = one.z_to_a(z_middle_mm) - other.z_to_a(z_middle_mm)
    return bool(abs(off_rad) * radius_mm < DISTINCT_MM and abs(off_mm) < DISTINCT_MM)
