"""How one side lies in the other's frame, and pairs of landmarks: one place of the wall on both sides."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError

Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
Orientation = tuple[bool, bool]
"""The way around that B lies in A's frame: (mirrored, z_reversed)."""
ALL_ORIENTATIONS: tuple[Orientation, ...] = ((False, False), (True, False), (False, True), (True, True))
Role = Literal["correct", "check"]
"""What a pair is for: to correct an alignment, or to check it. No pair can check what it has corrected."""
JUMP_WITHIN_MM, LEAST_JUMP_MM, LEAST_JUMP_RAD = 0.03, 0.12, 0.06
"""A bend steps where it changes by so much within so little of the bore, or goes back."""
USUAL_SIGMA_MM = 0.05
"""Standard error of a place that somebody points out, where nobody says better: the rim of a cell is as wide."""


@dataclass(frozen=True)
class Bend:
    """What a rigid alignment leaves along the bore: at z, B lies ``shift_mm`` farther along, turned by ``roll_rad``.

    All are tuples of one length. z is where the rigid part puts a place in A's frame. Both are linear in between, and
    constant beyond the ends. Two places close together are a step. ``z_mm`` ascend, and so do their sums with
    ``shift_mm``: no place of the wall is shown twice. The errors are standard errors.

    >>> bend = Bend((2.0, 4.0), (0.0, 0.2), (0.0, 0.1), (0.01, 0.01), (0.002, 0.002))
    >>> bent = Alignment(theta_shift_rad=0.5, z_shift_mm=1.0, bend=bend)
    >>> f"{bent.z_to_a(2.0):.2f} mm, {bent.theta_to_a(0.2, 2.0):.2f} rad, {bent.z_to_b(3.1):.2f} mm"
    '3.10 mm, 0.75 rad, 2.00 mm'
    """

    z_mm: tuple[float, ...]
    shift_mm: tuple[float, ...]
    roll_rad: tuple[float, ...]
    shift_error_mm: tuple[float, ...]
    roll_error_rad: tuple[float, ...]

    def __post_init__(self) -> None:
        parts = [np.asarray(part, np.float64) for part in astuple(self)]
        alike = {part.shape for part in parts} == {(len(self.z_mm),)} and len(self.z_mm) > 0
        ascends = alike and all((np.diff(one) > 0).all() for one in (parts[0], parts[0] + parts[1]))
        if not (ascends and np.isfinite(parts).all()):
            raise EndoctError(
                "the bend of an alignment is none",
                found=f"z_mm {self.z_mm[:4]}, shift_mm {self.shift_mm[:4]}",
                expected="equally many finite numbers of each kind; z_mm, and z_mm with shift_mm, in ascending order",
            )

    @property
    def steps(self) -> tuple[tuple[float, float, float], ...]:
        """Where it jumps, in A's frame, mm, and by how much: (at_mm, along_mm, roll_rad), the farthest along first."""
        (z_mm, along_mm, roll_rad) = (np.diff(part) for part in (self.z_mm, self.shift_mm, self.roll_rad))
        jumps = (z_mm <= JUMP_WITHIN_MM) | (-along_mm >= 0.8 * z_mm)
        jumps &= (np.abs(along_mm) >= LEAST_JUMP_MM) | (np.abs(roll_rad) >= LEAST_JUMP_RAD)
        order = np.flatnonzero(jumps)[np.argsort(-np.abs(along_mm[jumps]), kind="stable")]
        return tuple(
            (float(np.mean(self.z_mm[k : k + 2]) + np.mean(self.shift_mm[k : k + 2])), along_mm[k], roll_rad[k])
            for k in order.tolist()
        )

    def scaled(self, factor: float) -> "Bend":
        """Return it with every length times ``factor``."""
        lengths = (tuple(factor * mm for mm in part) for part in (self.z_mm, self.shift_mm, self.shift_error_mm))
        z_mm, shift_mm, error_mm = lengths
        return replace(self, z_mm=z_mm, shift_mm=shift_mm, shift_error_mm=error_mm)

    def at(self, values: tuple[float, ...], z_mm: Coordinates) -> Coordinates:
        """Return one kind of ``values`` at z, float64 of its shape."""
        return np.asarray(np.interp(z_mm, self.z_mm, values))


@dataclass(frozen=True)
class Alignment:
    """Maps side B into side A's frame: θ_A = θ_shift ± θ_B, z_A = z_shift + z_scale·(±z_B), and a ``bend``, if any.

    Attributes
    ----------
    mirrored, z_reversed: whether θ_B, or z_B, counts negative.
    confidence: |correlation|·(1 − 1/ratio).
    correlation: of the two sides' evidence for cells in place. Its sign says whether they agree or are each other's
        negative.
    ratio: how its score compares with the runner-up's anywhere else.
    chance: how likely a bore that does not match would reach that score (:mod:`endoct.fusion.registration.search`).
    overlap_mm2: the wall that both sides observed.
    uneven_rad: the largest smooth departure from a rigid turn: what uneven rotation and an off-axis probe leave in θ.
        It is estimated but left uncorrected.
    twist_rad_per_mm: a turn along A's z, likewise estimated but left uncorrected.
    covariance: of the error of (theta_shift_rad, z_shift_mm, z_scale), 3 × 3 in their units; None where it was not
        estimated.
    bend: how it departs from a rigid place along the bore; None where it does not.

    >>> b_in_a = Alignment(theta_shift_rad=0.5, z_shift_mm=-1.2, mirrored=True)
    >>> f"{b_in_a.theta_to_a(0.2):.2f} rad, {b_in_a.z_to_a(2.0):.2f} mm"
    '0.30 rad, 0.80 mm'
    >>> f"{b_in_a.inverse().theta_to_a(0.3):.2f} rad, {b_in_a.inverse().z_to_a(0.8):.2f} mm"
    '0.20 rad, 2.00 mm'
    """

    theta_shift_rad: float
    z_shift_mm: float
    z_scale: float = 1.0
    mirrored: bool = False
    z_reversed: bool = False
    confidence: float = 0.0
    correlation: float = 0.0
    ratio: float = 1.0
    chance: float = 1.0
    overlap_mm2: float = 0.0
    uneven_rad: float = 0.0
    twist_rad_per_mm: float = 0.0
    covariance: Covariance | None = None
    bend: Bend | None = None

    def __repr__(self) -> str:
        flips = "".join([", mirrored"] * self.mirrored + [", z reversed"] * self.z_reversed)
        return (
            f"<Alignment: θ shift {np.degrees(self.theta_shift_rad):.2f}°, z shift {self.z_shift_mm:.3f} mm, "
            f"z scale {self.z_scale:.4f}{flips}, confidence {self.confidence:.2f}{', bent' * (self.bend is not None)}>"
        )

    @property
    def rigid(self) -> "Alignment":
        """The alignment without its bend."""
        return replace(self, bend=None)

    @property
    def _sense(self) -> float:
        return -1.0 if self.mirrored else 1.0

    @property
    def _direction(self) -> float:
        return -1.0 if self.z_reversed else 1.0

    def theta_to_a(self, theta_b_rad: ArrayLike, z_b_mm: ArrayLike | None = None) -> Coordinates:
        """Return θ in A's frame, in [0, 2π), of θ in B's (any shape). A bent alignment needs z in B's frame, too."""
        turned = self.theta_shift_rad + self._sense * np.asarray(theta_b_rad, dtype=np.float64)
        return np.mod(turned + self.roll_rad(z_b_mm), 2 * np.pi)

    def theta_to_b(self, theta_a_rad: ArrayLike, z_a_mm: ArrayLike | None = None) -> Coordinates:
        """Return θ in B's frame, in [0, 2π), of θ in A's (any shape). A bent alignment needs z in A's frame, too."""
        roll_rad = self.roll_rad(None if z_a_mm is None or self.bend is None else self.z_to_b(z_a_mm))
        turned = np.asarray(theta_a_rad, dtype=np.float64) - self.theta_shift_rad - roll_rad
        return np.mod(self._sense * turned, 2 * np.pi)

    def roll_rad(self, z_b_mm: ArrayLike | None) -> Coordinates:
        """Return by how much more the bend turns places at z in B's frame (any shape), rad; 0 without a bend.

        Raises :class:`EndoctError` where the alignment is bent and no z is given.
        """
        if self.bend is None:
            return np.zeros(())
        if z_b_mm is None:
            raise EndoctError("a bent alignment turns θ by more at one z than at another", expected="z beside θ")
        return self.bend.at(self.bend.roll_rad, self.rigid.z_to_a(z_b_mm))

    def z_to_a(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return z in A's frame, mm, of z in B's (any shape)."""
        z_mm = np.asarray(self.z_shift_mm + self.z_scale * self._direction * np.asarray(z_b_mm, dtype=np.float64))
        return z_mm if self.bend is None else z_mm + self.bend.at(self.bend.shift_mm, z_mm)

    def z_to_b(self, z_a_mm: ArrayLike) -> Coordinates:
        """Return z in B's frame, mm, of z in A's (any shape)."""
        z_mm = np.asarray(z_a_mm, dtype=np.float64)
        if self.bend is not None:
            z_mm = z_mm - np.interp(z_mm, np.add(self.bend.z_mm, self.bend.shift_mm), self.bend.shift_mm)
        return np.asarray(self._direction * (z_mm - self.z_shift_mm) / self.z_scale)

    def inverse(self) -> "Alignment":
        """Return the alignment that maps A into B's frame."""
        direction, sense, scale = self._direction, self._sense, self.z_scale
        by_shift_and_scale = -direction / scale, direction * self.z_shift_mm / scale**2
        jacobian = np.array([[-sense, 0, 0], [0, *by_shift_and_scale], [0, 0, -1 / scale**2]])
        return replace(
            self,
            theta_shift_rad=float(np.mod(-sense * self.theta_shift_rad, 2 * np.pi)),
            z_shift_mm=-direction * self.z_shift_mm / scale,
            z_scale=1 / scale,
            twist_rad_per_mm=-sense * direction * self.twist_rad_per_mm,
            covariance=self.covariance and as_covariance(jacobian @ np.array(self.covariance) @ jacobian.T),
            bend=self.bend and self._bend_inverted(self.bend),
        )

    def _bend_inverted(self, bend: Bend) -> Bend:
        there_mm, order = self.rigid.z_to_b(np.add(bend.z_mm, bend.shift_mm)), slice(None, None, int(self._direction))

        def times(factor: float, values: tuple[float, ...]) -> tuple[float, ...]:
            return tuple((factor * np.array(values)).tolist()[order])

        return Bend(
            tuple(there_mm.tolist()[order]),
            times(-self._direction / self.z_scale, bend.shift_mm),
            times(-self._sense, bend.roll_rad),
            times(1 / self.z_scale, bend.shift_error_mm),
            bend.roll_error_rad[order],
        )

    def scaled(self, factor: float) -> "Alignment":
        """Return it with every length times ``factor``, in a bore as many times as wide."""
        if factor == 1:
            return self
        lengths = np.diag([1.0, factor, 1.0])
        return replace(
            self,
            z_shift_mm=factor * self.z_shift_mm,
            overlap_mm2=factor**2 * self.overlap_mm2,
            twist_rad_per_mm=self.twist_rad_per_mm / factor,
            covariance=self.covariance and as_covariance(lengths @ np.array(self.covariance) @ lengths),
            bend=self.bend and self.bend.scaled(factor),
        )

    def z_error_mm(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return the standard error of :meth:`z_to_a` at z in B's frame (any shape), mm, 0 where it is unknown."""
        along = self._direction * np.asarray(z_b_mm, dtype=np.float64)
        (_, (_, of_shift, common), (_, _, of_scale)) = self.covariance or as_covariance(np.zeros((3, 3)))
        error_mm = np.sqrt(np.maximum(of_shift + 2 * along * common + along**2 * of_scale, 0))
        if self.bend is None:
            return error_mm
        return np.hypot(error_mm, self.bend.at(self.bend.shift_error_mm, self.rigid.z_to_a(z_b_mm)))


def as_covariance(matrix: Coordinates) -> Covariance:
    """Return a 3 × 3 array as nested tuples of floats, made symmetric to the last bit."""
    (a, b, c), (_, d, e), (_, _, f) = ((matrix + matrix.T) / 2).tolist()
    return (a, b, c), (b, d, e), (c, e, f)


@dataclass(frozen=True)
class NotAligned:
    """No place stood out: the ``reason``, in a full sentence, and the ``best`` place there was.

    ``ruled_out`` would have been believed, but sidecars state another orientation.
    """

    reason: str
    best: Alignment | None = None
    ruled_out: Alignment | None = None


@dataclass(frozen=True)
class Remedy:
    """``key`` of the sidecar of ``side``, what it states, and the value at which both sides would agree."""

    side: str
    key: str
    stated: float
    agreeing: float

    @property
    def unit(self) -> str:
        """Unit of both values."""
        return "mm/s" if self.key.endswith("_mm_s") else "mm"

    def __str__(self) -> str:
        return f"{self.key} = {self.agreeing:.4g} of {self.side} ({self.stated:.4g} is stated)"


@dataclass(frozen=True)
class SearchOutcome:
    """Where a search, a method or pairs of landmarks lay B; else the ``best`` place, and the ``reason`` against it.

    ``ruled_out`` and ``remedies``: what sidecars would have to state otherwise, where the two would then align.
    """

    alignment: Alignment | None
    best: Alignment | None = None
    reason: str = ""
    ruled_out: Alignment | None = None
    remedies: tuple[Remedy, ...] = ()

    @classmethod
    def of(cls, answer: Alignment | NotAligned) -> "SearchOutcome":
        """Return what a search or a method answers."""
        if isinstance(answer, Alignment):
            return cls(answer)
        return cls(None, answer.best, answer.reason, answer.ruled_out)

    def scaled(self, factor: float) -> "SearchOutcome":
        """Return it with every length times ``factor``."""
        names = "alignment", "best", "ruled_out"
        return replace(self, **{name: (one := getattr(self, name)) and one.scaled(factor) for name in names})


@dataclass(frozen=True)
class Place:
    """A place on the wall of one side, in the frame of that side's own panorama: θ in [0, 2π), z in mm."""

    theta_rad: float
    z_mm: float


@dataclass(frozen=True)
class LandmarkPair:
    """One place of the wall on both sides, as somebody pointed it out, with its role and its name.

    ``sigma_mm`` is the standard error of the distance of the two, around the bore as along it.
    """

    a: Place
    b: Place
    role: Role = "correct"
    name: str = ""
    sigma_mm: float = USUAL_SIGMA_MM


def of_role(pairs: Sequence[LandmarkPair], role: Role) -> tuple[LandmarkPair, ...]:
    """Return the pairs of one role, in their order."""
    return tuple(pair for pair in pairs if pair.role == role)


def residuals_mm(pairs: Sequence[LandmarkPair], alignment: Alignment, radius_mm: float) -> Coordinates:
    """Return how far B's place of each pair, moved by ``alignment``, lies off A's: (around, along), (n, 2), mm.

    The distance around the bore is the shorter way on a cylinder of ``radius_mm``.
    """
    a, b = columns(pairs)
    turned = alignment.theta_to_a(b[:, 0], b[:, 1]) - a[:, 0]
    around_mm = radius_mm * (np.mod(turned + np.pi, 2 * np.pi) - np.pi)
    return np.stack([around_mm, alignment.z_to_a(b[:, 1]) - a[:, 1]], axis=1)


def columns(pairs: Sequence[LandmarkPair]) -> tuple[Coordinates, Coordinates]:
    """Return θ (rad) and z (mm) of the places on A, float64 (n, 2), and of those on B."""
    both = np.array([(p.a.theta_rad, p.a.z_mm, p.b.theta_rad, p.b.z_mm) for p in pairs], np.float64).reshape(-1, 4)
    return both[:, :2], both[:, 2:]
