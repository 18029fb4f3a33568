"""The result of a comparison: what ``result.json`` says.

It holds the alignment, what landmark pairs did to it and say of it, the scores, and the doubts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, InstanceOf, PlainSerializer, model_validator

from endoct.base.doubt import Doubt, as_doubt
from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.fusion.result.bounds import Bounds
from endoct.fusion.result.planes import CuttingPlane
from endoct.fusion.result.scores import (
    Budget,
    ByLi,
    Count,
    MaskScores,
    Number,
    Numbers,
    Overlap,
    PairScores,
    Part,
    Raters,
    Texts,
    WallSummary,
)

_Row = Annotated[tuple[Number, Number, Number], Field(strict=False)]
_Matrix = Annotated[tuple[_Row, _Row, _Row], Field(strict=False)]


class StoredBend(Part):
    """A :class:`~endoct.fusion.geometry.alignment.Bend` as it is stored."""

    z_mm: Numbers
    shift_mm: Numbers
    roll_rad: Numbers
    shift_error_mm: Numbers
    roll_error_rad: Numbers

    def to_bend(self) -> Bend:
        """Return the bend that was stored."""
        return Bend(**{field.name: getattr(self, field.name) for field in fields(Bend)})

    @model_validator(mode="after")
    def _is_a_bend(self) -> "StoredBend":
        try:
            self.to_bend()
        except EndoctError as error:
            raise ValueError(str(error)) from error
        return self


class StoredAlignment(Part):
    """An :class:`~endoct.fusion.geometry.alignment.Alignment` as it is stored; None where a value was not stored."""

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
    bend: StoredBend | None = None

    @classmethod
    def of(cls, alignment: Alignment | None) -> "StoredAlignment | None":
        """Return ``alignment`` as it is stored."""
        return None if alignment is None else cls(**asdict(alignment))

    def to_alignment(self) -> Alignment:
        """Return the alignment that was stored, with the defaults for what was not."""
        known = {field.name: getattr(self, field.name) for field in fields(Alignment)}
        known["bend"] = self.bend and self.bend.to_bend()
        return Alignment(**{name: value for name, value in known.items() if value is not None})


class StoredPlace(Part):
    """A place on the wall of one side, in the frame of its own panorama."""

    theta_rad: Number
    z_mm: Number


class PairDistance(Part):
    """How far B's place of a pair, moved into A's frame, lies off A's: signed by direction, and in all."""

    around_mm: Number
    along_mm: Number
    distance_mm: Number


class PlacedPair(Part):
    """A landmark pair with its distance under the automatic alignment and under the one that was used.

    Either distance is None where there is no such alignment.
    """

    name: str
    role: Literal["correct", "check"]
    a: StoredPlace
    b: StoredPlace
    sigma_mm: Number
    before: PairDistance | None
    after: PairDistance | None


class Distances(Part):
    """The median and the largest distance of several pairs; around and along the bore regardless of sign."""

    pairs: Count
    median_mm: Number
    max_mm: Number
    around_median_mm: Number
    around_max_mm: Number
    along_median_mm: Number
    along_max_mm: Number


class Moved(Part):
    """How far pairs moved B from the automatic alignment; ``around_mm`` and ``along_mm`` are in the pairs' middle."""

    around_mm: Number
    along_mm: Number
    turn_rad: Number
    z_scale: Number


class ByHand(Part):
    """What landmark pairs did to an alignment, and what they say of it.

    Attributes
    ----------
    corrected: whether pairs moved, or established, the alignment.
    automatic: the best alignment found without them.
    automatic_reason: why that was not accepted; None where it was.
    scale_share: how much of the scale along the bore is by the pairs, 0 to 1. The rest is what was known before them.
    orientation_by_pairs: whether handedness and direction are by the pairs.
    moved: None where nothing was moved, or there was nothing that could be.
    misfit: how far the correcting pairs lie apart once they have corrected, as a multiple of their ``sigma_mm``. None
        where they decide too little to say.
    pairs: every pair, in the order of the session.
    correct: what is left between the correcting pairs. It is no error of the alignment.
    check: the error of the alignment, by the pairs that had no part in it.
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


def _read(given: object) -> Doubt:
    try:
        return as_doubt(given)
    except EndoctError as error:  # pydantic collects ValueErrors only
        raise ValueError(str(error)) from error


StoredDoubt = Annotated[InstanceOf[Doubt], BeforeValidator(_read), PlainSerializer(Doubt.to_json)]
"""A doubt that a result's JSON holds as an object."""


def as_json(value: object) -> object:
    """Return the dumped ``value`` with lists for its tuples, as JSON read back has it."""
    if isinstance(value, dict):
        return {key: as_json(inner) for key, inner in value.items()}
    return [as_json(inner) for inner in value] if isinstance(value, list | tuple) else value


class Believable(Part):
    """What an alignment must reach to be believed."""

    confidence_at_least: Number
    chance_at_most: Number


class DecidedByDepth(Part):
    """Shares of a side's samples: where depth by parallax is ``known``, what it ``added`` to cells and ``dropped``."""

    known: Number
    added: Number
    dropped: Number


class Threshold(Part):
    """The evidence above which a sample is cell; ``value`` is None for a mask, which is taken as given.

    ``by_depth``: how much depth by parallax decided; None where it had no say.
    """

    value: Number | None = None
    unit: str | None = None
    of: str | None = None
    by_depth: DecidedByDepth | None = None


class StoredRemedy(Part):
    """The value of a sidecar's key at which two sides that did not align would."""

    side: str
    key: str
    agreeing: Number


class Bootstrap(Part):
    """How intervals were bootstrapped, and over what."""

    resamples: Count
    seed: Count
    level: Number
    over: str


class Result(Part):
    """What a comparison found. Where the sides are not aligned, nothing is scored, and ``reason`` says why.

    Attributes
    ----------
    sides: names of the two sides, A first.
    alignment: where B lies in A's frame.
    best_unbelieved: the best alignment there was, where none reached ``believed_if``.
    best_ruled_out: the one that would have reached it, in an orientation that sidecars rule out.
    remedies: what sidecars would have to state for the two to align, one or the other.
    jaccard, dice: of the two sides on the common grid. None where they are not aligned, or neither shows a cell.
    threshold: by side, what its cells were segmented by.
    polarity, polarity_from: by side, whether its cells are dark or bright, and how that is known. None where the
        question does not arise.
    planes: by side, those that cut the bore, such as fractures, in A's frame; left out where there are none.
    scores, budget: of the two sides; None where they are not aligned, or neither shows a cell.
    wall: of both sides joined; None where they are not aligned, or not one measures depth and the other sees light.
    bounds: what the truth would say of the cells of both, within what bounds; None where there is no ``wall`` of them.
    valid_fraction: share of the wall that both observed, over the ``overlap_mm`` of length that both cover.
    doubts: what speaks against the whole: the comparison first, then A, then B.
    notes: by side, what is to be known of some of its frames or rows; none repeats a doubt.
    by_hand: what landmark pairs did and say, where a session with some was given.
    truth: scores by the path of a mask given as truth, then by side.
    raters: how far several such masks agree.
    asked: what the command was asked for, as its request has it.
    versions, inputs, parameters, seconds: by package, path (a SHA-256 each), side (or "compare") and stage.
    """

    sides: Annotated[tuple[str, str], Field(strict=False)]
    aligned: bool
    reason: str | None = None
    alignment: StoredAlignment | None
    believed_if: Believable | None = None
    best_unbelieved: StoredAlignment | None = None
    best_ruled_out: StoredAlignment | None = None
    remedies: Annotated[tuple[StoredRemedy, ...], Field(strict=False)] = ()
    jaccard: Number | None
    dice: Number | None
    threshold: dict[str, Threshold] | None = None
    polarity: dict[str, str | None] | None = None
    polarity_from: dict[str, str | None] | None = None
    planes: dict[str, Annotated[tuple[CuttingPlane, ...], Field(strict=False)]] = Field(default_factory=dict)
    scores: PairScores | None = None
    budget: Budget | None = None
    wall: WallSummary | None = None
    bounds: Bounds | None = None
    bootstrap: Bootstrap | None = None
    valid_fraction: Number
    overlap_mm: Number | None = None
    doubts: Annotated[tuple[StoredDoubt, ...], Field(strict=False)] = ()
    by_hand: ByHand | None = None
    truth: dict[str, dict[str, MaskScores]] | None = None
    raters: Raters | None = None
    notes: dict[str, Texts] = Field(default_factory=dict)
    asked: dict[str, str | Texts] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    inputs: dict[str, str] = Field(default_factory=dict)
    parameters: dict[str, dict[str, object] | None] = Field(default_factory=dict)
    seconds: dict[str, Number] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _says_where(self) -> "Result":
        if self.aligned and self.alignment is None:
            raise ValueError("aligned, but not how")
        if self.parameters.get("compare", {}) is None:
            raise ValueError("no parameters of the comparison")
        return self

    def __repr__(self) -> str:
        a, b = self.sides
        scored = f"Jaccard index {self.jaccard:.3f}" if self.jaccard is not None else "nothing to score"
        return f"<Result of {a} and {b}: {scored if self.aligned else 'not aligned'}>"

    __str__ = __repr__

    @property
    def overlap(self) -> Overlap | None:
        """The overlap of the two sides on the common grid; None where they are not aligned."""
        if not self.aligned:
            return None
        known = {"jaccard": self.jaccard, "dice": self.dice}
        return Overlap(**known | (self.scores.grid.model_dump(exclude_unset=True) if self.scores else {}))

    @property
    def own_rows_jaccard(self) -> float | None:
        """The Jaccard index on B's own samples; None where there is nothing to score."""
        return self.scores.own_rows.jaccard if self.scores and self.scores.own_rows else None

    @property
    def by_li(self) -> ByLi | None:
        """The overlap by Li's threshold alone; None where there is none."""
        return self.scores.by_li if self.scores else None

    @property
    def forced(self) -> bool:
        """Whether the alignment was to be believed however little it stood out."""
        return bool((self.parameters.get("compare") or {}).get("force"))

    def completed(
        self,
        *,
        truth: Mapping[str, Mapping[str, MaskScores]],
        raters: Raters | None,
        notes: Mapping[str, Sequence[str]],
        versions: Mapping[str, str],
        inputs: Mapping[str, str],
        parameters: Mapping[str, Mapping[str, object]],
        seconds: Mapping[str, float],
    ) -> "Result":
        """Return the whole result: this one, with the scores against masks, where there are any, and how it was made.

        ``notes`` are those of the sides' panoramas; what the comparison noted joins them.
        """
        made = {
            "notes": {side: tuple(dict.fromkeys([*said, *self.notes.get(side, ())])) for side, said in notes.items()},
            "versions": versions,
            "inputs": inputs,
            "parameters": parameters,
            "seconds": seconds,
        }
        against = {name: part for name, part in (("truth", truth), ("raters", raters)) if part}
        return self.model_copy(update={**against, **made})

    def to_json(self) -> dict[str, object]:
        """Return the object that ``result.json`` holds, of lists, dicts, texts and numbers only."""
        return {key: as_json(value) for key, value in self.model_dump(exclude_unset=True, by_alias=True).items()}
