"""``result.json`` of a comparison, read back: what the report takes from it must be what it should be."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from endoct.stitching.contents import check_intact
from endoct.stitching.errors import EndoctError
from endoct.stitching.json_values import read_object
from endoct.stitching.names import plain_name

MOST_BYTES = 16_000_000
"""They take some twenty times that in memory at worst; a result has some ten kilobytes."""
DEEPEST = 20
EXPECTED = "a folder written by `endoct compare`"

Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Interval = Annotated[list[Number], Field(min_length=2, max_length=2)]


class _Part(BaseModel):
    """A part of ``result.json``; what is not named here may stand in it too."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow")


class _Alignment(_Part):
    theta_shift_rad: Number
    z_shift_mm: Number
    z_scale: Number
    mirrored: bool
    z_reversed: bool
    confidence: Number
    correlation: Number | None = None
    ratio: Number | None = None
    uneven_rad: Number | None = None


class _Threshold(_Part):
    value: Number | None = None
    unit: str | None = None
    of: str | None = None


class _Overlap(_Part):
    jaccard: Number | None = None
    dice: Number | None = None
    jaccard_interval: Interval | None = None


class _OwnRows(_Overlap):
    rows_of: str
    jaccard: Number | None


class _Boundary(_Part):
    mean_mm: Number | None = None
    mean_interval_mm: Interval | None = None
    p95_mm: Number | None = None
    within_share: Number | None = None
    within_interval: Interval | None = None
    tolerance_mm: Number


class _Cells(_Part):
    of_reference: Count
    of_other: Count
    matched: Count | None = None
    precision: Number | None = None
    precision_interval: Interval | None = None
    recall: Number | None = None
    recall_interval: Interval | None = None
    quality: Number | None = None
    quality_interval: Interval | None = None


class _Limits(_Part):
    bias: Number
    low: Number
    high: Number
    pairs: Count


class _Line(_Part):
    per_mm: Number
    per_mm_error: Number


class _Drift(_Part):
    length_mm: Number
    z_mm: _Line
    arc_mm: _Line


class _Stratum(_Part):
    low: Number | None = Field(alias="from")
    to: Number | None
    sites: Count
    jaccard: Number | None
    jaccard_interval: Interval | None


class _Strata(_Part):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    diameter_mm: list[_Stratum] = []
    depth_mm: list[_Stratum] = []
    contrast: list[_Stratum] = []


class _Card(_Overlap):
    boundary: _Boundary | None = None
    cells: _Cells | None = None
    area_mm2: _Limits | None = None
    depth_mm: _Limits | None = None
    drift: _Drift | None = None
    strata: _Strata | None = None


class _Scored(_Card):
    jaccard: Number | None


class _Scores(_Card):
    grid: _Overlap = _Overlap()
    own_rows: _OwnRows | None = None


class _Pairwise(_Part):
    jaccard: Number | None
    dice: Number | None
    boundary_mean_mm: Number | None
    boundary_p95_mm: Number | None
    boundary_within_share: Number | None


class _Pair(_Pairwise):
    first: list[str]
    second: list[str]


class _Pairs(_Pairwise):
    pairs: Count


class _Consensus(_Part):
    method: str
    sides: dict[str, _Scored]


class _Raters(_Part):
    pairs: list[_Pair]
    within: _Pairs | None = None
    between: _Pairs | None = None
    consensus: dict[str, _Consensus]

    @model_validator(mode="after")
    def _has_majority(self) -> "_Raters":
        if "majority" not in self.consensus:
            raise ValueError("no majority")
        return self


class _BudgetPart(_Part):
    share: Number
    interval: Interval | None


class _BudgetParts(_Part):
    alignment: _BudgetPart
    sampling: _BudgetPart
    visibility: _BudgetPart
    segmentation: _BudgetPart


class _NotVisible(_Part):
    cells: Count
    area_mm2: Number


class _Budget(_Part):
    one_minus_jaccard: Number
    parts: _BudgetParts
    alignment_known: bool
    not_visible: dict[str, _NotVisible]
    not_covered: dict[str, Number]


class _Twist(_Part):
    jaccard_without: Number | None = None
    jaccard_with: Number | None = None


class _Result(_Part):
    sides: Annotated[list[str], Field(min_length=2, max_length=2)]
    aligned: bool
    reason: str | None = None
    alignment: _Alignment | None
    best_unbelieved: dict[str, Any] | None = None
    jaccard: Number | None
    dice: Number | None
    threshold: dict[str, _Threshold] | None = None
    polarity: dict[str, str | None] | None = None
    scores: _Scores | None = None
    budget: _Budget | None = None
    twist: _Twist | None = None
    truth: dict[str, dict[str, _Scored]] | None = None
    raters: _Raters | None = None
    valid_fraction: Number
    overlap_mm: Number | None = None
    notes: dict[str, list[str]] = {}
    versions: dict[str, str] = {}
    inputs: dict[str, str] = {}
    seconds: dict[str, Number] = {}
    parameters: dict[str, dict[str, Any] | None] = {}

    @model_validator(mode="after")
    def _says_where(self) -> "_Result":
        if self.aligned and self.alignment is None:
            raise ValueError("aligned, but not how")
        if self.parameters.get("compare", {}) is None:
            raise ValueError("no parameters of the comparison")
        return self


def stored_result(folder: Path) -> dict[str, Any]:
    """Return what ``folder/result.json`` holds, whatever that is.

    Raises :class:`EndoctError` where it is missing, not as it was written, larger than 16 MB, no JSON object, or nested
    more than 20 deep.
    """
    try:
        check_intact(folder, lambda name: name == "result.json")
        result = read_object(folder / "result.json", MOST_BYTES)
    except EndoctError as error:
        raise EndoctError(f"{folder} is no comparison", found=error.found or error.what, expected=EXPECTED) from error
    if any(depth > DEEPEST for depth in _depths(result)):
        raise EndoctError(f"{folder} is no comparison", found="a result nested too deeply", expected=EXPECTED)
    return result


def read_result(folder: Path) -> dict[str, Any]:
    """Return what ``folder/result.json`` holds.

    Raises :class:`EndoctError` as :func:`stored_result`, and where something in it that a report shows is not of its
    kind.
    """
    result = stored_result(folder)
    try:
        _Result.model_validate(result)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise EndoctError(
            f"result.json in {folder} cannot be used", found=f"{where}: {first['msg']}"[:300], expected=EXPECTED
        ) from error
    for name in result["sides"]:
        plain_name(name, f"a side in {folder}")
    return result


def _depths(value: object) -> Iterator[int]:
    """Yield how deep every container in ``value`` lies."""
    below: list[tuple[object, int]] = [(value, 1)]
    while below:
        inner, depth = below.pop()
        if isinstance(inner, dict | list):
            yield depth
            below += [(one, depth + 1) for one in (inner.values() if isinstance(inner, dict) else inner)]
