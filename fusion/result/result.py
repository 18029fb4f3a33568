"""The result of a comparison: what ``result.json`` says, with its doubts, also those of older versions."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import BeforeValidator, Field, InstanceOf, PlainSerializer, model_validator

from endoct.base.doubt import Doubt, as_doubt, without_doubts
from endoct.base.errors import EndoctError
from endoct.fusion.result.by_hand import ByHand, StoredAlignment
from endoct.fusion.result.part import Count, Flags, Number, Numbers, Part, Texts, as_json
from endoct.fusion.result.scores import Budget, MaskScores, Overlap, PairScores, Raters


def _read(given: object) -> Doubt:
    try:
        return as_doubt(given)
    except EndoctError as error:  # pydantic collects ValueErrors only
        raise ValueError(str(error)) from error


StoredDoubt = Annotated[InstanceOf[Doubt], BeforeValidator(_read), PlainSerializer(Doubt.to_json)]
"""A doubt that a result's JSON holds as an object."""


def with_doubts_as_list(stored: Mapping[str, object]) -> Mapping[str, object]:
    """Return the object of a ``result.json`` with one list of doubts.

    Older versions wrote sentences by side, which their notes repeated. What is of neither form is left as it is.
    """
    by_side = stored.get("doubts")
    if not isinstance(by_side, Mapping) or not all(_is_texts(said) for said in by_side.values()):
        return stored
    doubts = tuple(_read(text).of_side(str(side)) for side, said in by_side.items() for text in said)
    notes = stored.get("notes")
    if isinstance(notes, Mapping) and all(_is_texts(said) for said in notes.values()):
        notes = {side: without_doubts(tuple(said), doubts) for side, said in notes.items()}
    return {**stored, "doubts": doubts} | ({} if notes is None else {"notes": notes})


def _is_texts(said: object) -> bool:
    return isinstance(said, list | tuple) and all(isinstance(text, str) for text in said)


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
    """The evidence above which a sample is cell; ``value`` None for a mask, which is taken as given.

    ``by_depth``: how much depth by parallax decided, None where it was not asked.
    """

    value: Number | None = None
    unit: str | None = None
    of: str | None = None
    by_depth: DecidedByDepth | None = None


class Bootstrap(Part):
    """How intervals were bootstrapped, and over what."""

    resamples: Count
    seed: Count
    level: Number
    over: str


class CorrectedTwist(Part):
    """By how much every row of B was turned to where it fits A best, and the Jaccard index without and with that."""

    note: str | None = None
    z_mm: Numbers = ()
    twist_rad: Numbers = ()
    known: Flags = ()
    jaccard_without: Number | None = None
    jaccard_with: Number | None = None


class Result(Part):
    """What a comparison found. Where the sides are not aligned, nothing is scored, and ``reason`` says why.

    Attributes
    ----------
    sides: names of the two sides, A first.
    alignment: where B lies in A's frame; ``best_unbelieved`` the best there was where none reached ``believed_if``.
    jaccard, dice: of the two sides on the common grid.
    threshold, polarity, polarity_from: by side: what its cells were segmented by, whether they are dark or bright, and
        how that is known; None where the question does not arise.
    scores, budget: of the two sides; None where they are not aligned, or neither shows a cell.
    valid_fraction: share of the wall that both observed, over the ``overlap_mm`` of length that both cover.
    doubts: what speaks against the whole: the comparison first, then A, then B. Results of older versions had sentences
        by side; they are read as doubts without a code of their own.
    notes: by side, what is to be known of some of its frames or rows; none repeats a doubt.
    twist: where it was asked for to correct it.
    by_hand: where a session with landmark pairs was given.
    truth: by the path of a mask given as truth, then by side; ``raters`` where there were several such masks.
    versions, inputs, parameters, seconds: by package, path (sha256), side (or "compare") and stage.
    """

    sides: Annotated[tuple[str, str], Field(strict=False)]
    aligned: bool
    reason: str | None = None
    alignment: StoredAlignment | None
    believed_if: Believable | None = None
    best_unbelieved: StoredAlignment | None = None
    jaccard: Number | None
    dice: Number | None
    threshold: dict[str, Threshold] | None = None
    polarity: dict[str, str | None] | None = None
    polarity_from: dict[str, str | None] | None = None
    scores: PairScores | None = None
    budget: Budget | None = None
    bootstrap: Bootstrap | None = None
    valid_fraction: Number
    overlap_mm: Number | None = None
    doubts: Annotated[tuple[StoredDoubt, ...], Field(strict=False)] = ()
    twist: CorrectedTwist | None = None
    by_hand: ByHand | None = None
    truth: dict[str, dict[str, MaskScores]] | None = None
    raters: Raters | None = None
    notes: dict[str, Texts] = Field(default_factory=dict)
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
        """Return the whole result: this with the scores against masks, where there are any, and how it was made.

        ``notes`` are what the sides' panoramas note; what the comparison noted joins them.
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

    @classmethod
    def from_json(cls, stored: Mapping[str, object]) -> "Result":
        """Return the result that the object ``stored`` of a ``result.json`` holds.

        Raises ``ValueError`` (pydantic's) where something is missing, not of its kind, or a number beyond 10¹².
        """
        return cls.model_validate(with_doubts_as_list(stored))
