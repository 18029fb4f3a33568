"""What was done by hand to the alignment of a comparison, what landmark pairs say of it, and its JSON."""

from dataclasses import asdict, fields
from typing import Annotated, Literal

from pydantic import Field

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result.part import Count, Number, Part

_Row = Annotated[tuple[Number, Number, Number], Field(strict=False)]
_Matrix = Annotated[tuple[_Row, _Row, _Row], Field(strict=False)]


class StoredAlignment(Part):
    """An :class:`~endoct.fusion.geometry.alignment.Alignment` as it is stored; None for what was not stored."""

    theta_shift_rad: Number
    z_shift_mm: Number
    z_scale: Number
    mirrored: bool
    z_reversed: bool
    confidence: Number
    correlation: Number | None = None
    ratio: Number | None = None
    chance: Number | None = None
    overlap_mm2: Number | None = None
    uneven_rad: Number | None = None
    twist_rad_per_mm: Number | None = None
    covariance: _Matrix | None = None

    @classmethod
    def of(cls, alignment: Alignment | None) -> "StoredAlignment | None":
        """Return ``alignment`` as it is stored."""
        return None if alignment is None else cls(**asdict(alignment))

    def to_alignment(self) -> Alignment:
        """Return the alignment that was stored; what was not stored is as of one that nobody measured."""
        known = {field.name: getattr(self, field.name) for field in fields(Alignment)}
        return Alignment(**{name: value for name, value in known.items() if value is not None})


class StoredPlace(Part):
    """A place on the wall of one side, in the frame of its own panorama."""

    theta_rad: Number
    z_mm: Number


class PairDistance(Part):
    """By how much B's place of a pair, moved into A's frame, lies off A's: signed, and in all."""

    around_mm: Number
    along_mm: Number
    distance_mm: Number


class PlacedPair(Part):
    """A landmark pair with its distance under the automatic alignment and under the one that was used.

    None where there is no such alignment.
    """

    name: str
    role: Literal["correct", "check"]
    a: StoredPlace
    b: StoredPlace
    sigma_mm: Number
    before: PairDistance | None
    after: PairDistance | None


class Distances(Part):
    """Medians and largest of the distances of several pairs; around and along the bore regardless of sign."""

    pairs: Count
    median_mm: Number
    max_mm: Number
    around_median_mm: Number
    around_max_mm: Number
    along_median_mm: Number
    along_max_mm: Number


class Moved(Part):
    """By how much pairs moved B against the automatic alignment; ``around_mm`` and ``along_mm`` amid the pairs."""

    around_mm: Number
    along_mm: Number
    turn_rad: Number
    z_scale: Number


class ByHand(Part):
    """What landmark pairs did to an alignment, and what they say of it.

    Attributes
    ----------
    corrected: whether pairs moved, or established, the alignment.
    automatic: the best alignment found without them; ``automatic_reason`` says why it was not accepted, where it was
        not.
    scale_share: how much of the scale along the bore is theirs, 0 to 1; the rest is what was known before them.
    orientation_by_pairs: whether handedness and direction are theirs.
    moved: None where nothing was moved, or there was nothing that could be.
    misfit: how many times as far as their ``sigma_mm`` says the correcting pairs lie apart once they have corrected;
        None where they decide too little to say.
    pairs: every pair, in the order of the session.
    correct: what is left between the correcting pairs, which is no error of the alignment; ``check``: its error, by the
        pairs that had no part in it.
    """

    corrected: bool
    automatic: StoredAlignment | None
    automatic_reason: str | None = None
    scale_share: Number = 0.0
    orientation_by_pairs: bool = False
    moved: Moved | None = None
    misfit: Number | None = None
    pairs: Annotated[tuple[PlacedPair, ...], Field(strict=False)]
    correct: Distances | None = None
    check: Distances | None = None
