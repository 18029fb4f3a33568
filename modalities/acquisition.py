"""The sidecar ``acquisition.toml``: what the files themselves do not say about a recording.

The values of its keys are checked for their kind; a message names those that cannot be used.
"""

import difflib
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

from annotated_types import Ge, Gt, Interval, Le, Lt
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists, inside, is_folder, read_small, text_of
from endoct.stitching.panorama import AxialScale

LARGEST_WHOLE = 2**64
SETTINGS = "the settings"
"""This is the place of keys that are given for one run, as by ``--set``."""
UNITS = {
    "_mm_s": "mm/s",
    "_mm2": "mm²",
    "_per_mm": "per mm",
    "_per_count": "a count",
    "_mm": "mm",
    "_px": "px",
    "_rad": "rad",
    "_deg": "degrees",
    "_hz": "Hz",
}
SIDECAR_NAME = "acquisition.toml"
Travel = Literal["in", "out", "unknown"]
Handedness = Literal["same", "mirrored", "unknown"]
MOST_PLACE_MM = 1e4
"""No bore is longer than this."""
MOST_PLACES = 1_000_000
MOST_STATED = 100
Place = Annotated[float, Field(ge=-MOST_PLACE_MM, le=MOST_PLACE_MM)]
LONGEST_KEY = 100
_COMMA_DECIMAL = re.compile(
    r"^[ \t]*([A-Za-z0-9_-]{1,100})[ \t]*=[ \t]*([-+]?[0-9]{1,20},[0-9]{1,20})(?![0-9,])", re.MULTILINE
)
"""Many countries write numbers like this, and TOML does not."""
AnyModel = TypeVar("AnyModel", bound=BaseModel)


def unit_of(key: str) -> str:
    """Return the unit that a key has by its name, empty where it has none."""
    return next((unit for end, unit in UNITS.items() if key.endswith(end)), "")


def table_model(field: FieldInfo) -> type[BaseModel] | None:
    """Return the model of a key that is a table, None where it is none."""
    return next((kind for kind in _kinds(field.annotation) if issubclass(kind, BaseModel)), None)


def field_at(model: type[BaseModel], place: Iterable[Any]) -> FieldInfo | None:
    """Return the field at ``place``: a key, or a key and keys of the tables within."""
    field: FieldInfo | None = None
    within: type[BaseModel] | None = model
    for part in place:
        field = within.model_fields.get(part) if within is not None and isinstance(part, str) else None
        within = table_model(field) if field is not None else None
    return field


def check_kinds(model: type[BaseModel], keys: Mapping[str, Any], where: str, inside: str = "") -> None:
    """Raise :class:`EndoctError` for a text or true and false where ``model`` has a number, and for absurd numbers.

    A library that checks types takes ``true`` for 1 and ``"2"`` for 2, where somebody made a mistake.
    """
    for name, value in keys.items():
        if (field := model.model_fields.get(name)) is None:
            continue
        kinds = set(_kinds(field.annotation))
        if isinstance(value, Mapping) and (table := table_model(field)) is not None:
            check_kinds(table, value, where, f"{inside}{name}.")
        if not kinds & {int, float}:
            continue
        for one in value if isinstance(value, list | tuple) else [value]:
            wrong = isinstance(one, bool | str) and type(one) not in kinds
            if wrong or (isinstance(one, int) and abs(one) > LARGEST_WHOLE):
                comma = isinstance(one, str) and re.fullmatch(r"[-+]?[0-9]{1,20},[0-9]{1,20}", one.strip())
                raise EndoctError(
                    f"'{inside}{name}' in {where} cannot be used",
                    found=abridged(one),
                    expected="a valid number",
                    remedy=f"write it with a point: {comma[0].replace(',', '.')}" if comma else "",
                )


def expectation(model: type[BaseModel], error: Mapping[str, Any]) -> str:
    """Return what pydantic expected, with both bounds and the unit where a number is out of its range."""
    said = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    if not str(error["type"]).startswith(("greater_than", "less_than")):
        return said
    unit = unit_of(_name(error))
    low, high = field_limits(model, error["loc"])
    if low is not None and high is not None:
        said = f"{low:g} to {high:g}"
    return f"{said} {unit}".strip()


def abridged(value: object) -> str:
    """Return a value for a message, cut short."""
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        return f"a number of {int(value.bit_length() * 0.30103) + 1} digits"
    try:
        return repr(value)[:80]
    except (ValueError, RecursionError):
        return f"a {type(value).__name__} that cannot be shown"


def _name(error: Mapping[str, Any]) -> str:
    return next((part for part in reversed(error["loc"]) if isinstance(part, str)), "")


def field_limits(model: type[BaseModel], place: Iterable[Any]) -> tuple[Any, Any]:
    """Return the least and the largest value of the field at ``place``, as :func:`field_at` has it, or None."""
    low: Any = None
    high: Any = None
    within: type[BaseModel] | None = model
    for part in place:
        field = within.model_fields.get(part) if within is not None and isinstance(part, str) else None
        if field is None:
            continue
        within = table_model(field)
        for limit in _limits(field):
            low = limit.ge if isinstance(limit, Ge | Interval) and limit.ge is not None else low
            low = limit.gt if isinstance(limit, Gt | Interval) and limit.gt is not None else low
            high = limit.le if isinstance(limit, Le | Interval) and limit.le is not None else high
            high = limit.lt if isinstance(limit, Lt | Interval) and limit.lt is not None else high
    return low, high


def _limits(field: FieldInfo) -> list[Any]:
    found = list(field.metadata)
    waiting = [field.annotation]
    while waiting:
        for argument in get_args(waiting.pop()):
            if isinstance(argument, FieldInfo):
                found += argument.metadata
            waiting.append(argument)
    return found


def _kinds(annotation: Any) -> Iterable[type]:
    """Yield the classes that an annotation is made of: of ``tuple[float, ...] | None``, float and NoneType."""
    arguments = get_args(annotation)
    if not arguments:
        yield annotation if isinstance(annotation, type) else type(annotation)
    for argument in arguments:
        yield from _kinds(argument)


@dataclass(frozen=True)
class OneOf:
    """Groups of keys of which a recording needs one, whole; ``why`` it does."""

    groups: tuple[tuple[str, ...], ...]
    why: str

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of all groups."""
        return tuple(key for group in self.groups for key in group)

    def is_met(self, keys: Collection[str]) -> bool:
        """Say whether ``keys`` hold a whole group."""
        return any(all(key in keys for key in group) for group in self.groups)

    def __str__(self) -> str:
        """Return the groups in words, as "a, b, or c with d and e"."""
        each = [" with ".join([group[0], *filter(None, [" and ".join(group[1:])])]) for group in self.groups]
        return f"one of {', '.join(each[:-1])}, or {each[-1]}"


class Acquisition(BaseModel):
    """Keys that every modality's sidecar has; a plug-in derives its own model and adds keys.

    Each field's ``description`` says what it is and why it matters; ``endoct info --write-sidecar`` prints
    it. A key that is not known is left out, never set to zero. ``alternatives`` are keys none of which is required,
    though a recording needs one or another.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)
    alternatives: ClassVar[tuple[OneOf, ...]] = ()

    modality: str = Field(description="the plug-in that reads this recording")
    bore_diameter_mm: float = Field(ge=0.1, le=100, description="nominal diameter of the drill hole; sets mm along θ")
    travel: Travel = Field(default="unknown", description="which way the instrument moved: in, out or unknown")
    positions_mm: tuple[Place, ...] | None = Field(
        default=None, max_length=MOST_PLACES, description="travel position of every frame, beats the nominal pitch"
    )
    theta_origin_rad: float = Field(
        default=0.0, ge=-1000, le=1000, description="θ of the first A-scan or of the image's +x axis"
    )
    calibration: str | None = Field(default=None, description="a TOML file next to this one with further keys")
    standard_errors: Mapping[str, Annotated[float, Field(ge=0, le=1e6)]] | None = Field(
        default=None, max_length=MOST_STATED, description="a table: standard errors of keys, as a calibration has them"
    )

    @property
    def axial_scale(self) -> AxialScale:
        """What the scale along the bore rests on; a plug-in that knows says more."""
        return AxialScale()

    @classmethod
    def measures(cls, keys: Mapping[str, Any], n_frames: int, shape: tuple[int, ...]) -> dict[str, str]:  # noqa: ARG003
        """Return how large a recording is in physical units, in words by what was measured, as far as ``keys`` say it.

        These may be incomplete, and need not be checked. ``shape``: that of a frame as its files hold it.
        """
        return {}


def positive(keys: Mapping[str, Any], *names: str) -> tuple[float, ...] | None:
    """Return the values of ``names``, None unless all of them are numbers above zero."""
    values = [keys.get(name) for name in names]
    known = [
        float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool) and 0 < v < LARGEST_WHOLE
    ]
    return tuple(known) if len(known) == len(names) else None


def sidecar_path(recording: Path) -> Path:
    """Return where the sidecar of ``recording`` (a folder or a file) lies: inside it, or next to it."""
    return (recording if is_folder(recording) else recording.parent) / SIDECAR_NAME


def read_keys(recording: Path) -> dict[str, Any]:
    """Return the keys of the recording's sidecar, its ``calibration`` file merged in; {} where there is none.

    Raises :class:`EndoctError` where a file is not TOML, or the calibration file is missing or not in that folder.
    """
    path = sidecar_path(recording)
    keys = read_toml(path) if exists(path) else {}
    return {**keys, **cited_keys(path, keys)}


def cited_keys(sidecar: Path, keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of the calibration next to ``sidecar`` that its ``keys`` cite; {} where they cite none.

    Raises :class:`EndoctError` where it cannot be read, or a key stands in both.
    """
    if not isinstance(name := keys.get("calibration"), str):
        return {}
    cited = read_toml(inside(sidecar.parent, name, f"'calibration' in {sidecar}"))
    if both := sorted(keys.keys() & cited.keys()):
        raise EndoctError(f"{', '.join(both)} stands in both {sidecar} and {name}", remedy="keep it in one of them")
    return cited


def validate(
    model: type[AnyModel],
    keys: Mapping[str, Any],
    where: str,
    *,
    also: tuple[str, ...] = (),
    settings: Collection[str] = (),
) -> AnyModel:
    """Return ``keys`` as a checked ``model``.

    ``where`` names the source for the message, ``also`` further keys to suggest from. Those of ``settings`` ("key", or
    "table.key") were given in place of the source's. Raises :class:`EndoctError` for the first key that is unknown
    (suggesting the nearest), missing, or has an impossible value.
    """
    _check_known(model, keys, where, also)
    given = {name.partition(".")[0] for name in settings}
    for place, own in ((SETTINGS, given), (where, keys.keys() - given)):
        check_kinds(model, {name: value for name, value in keys.items() if name in own}, place)
    try:
        return model.model_validate(dict(keys))
    except ValidationError as error:
        first = error.errors()[0]
        if not first["loc"]:  # the keys do not fit each other
            raise EndoctError(f"{where}: {expectation(model, first)}", remedy="correct the keys") from None
        missing = [e["loc"] for e in error.errors() if e["type"] == "missing" and field_at(model, e["loc"])]
        if missing:
            described, first_one = ", ".join(_described(model, place) for place in missing), _dotted(missing[0])
            raise EndoctError(
                f"{where} lacks {described}",
                remedy=f"add what is missing to {SIDECAR_NAME}, or give it with settings={{'{first_one}': VALUE}}",
            ) from None
        raise _unusable(model, first, SETTINGS if first["loc"][0] in given else where) from None


def check_values(model: type[BaseModel], keys: Mapping[str, Any], where: str) -> None:
    """Raise :class:`EndoctError` as :func:`validate` does, but not for keys that are missing or do not fit others."""
    _check_known(model, keys, where)
    check_kinds(model, keys, where)
    try:
        model.model_validate(dict(keys))
    except ValidationError as error:
        for each in error.errors():
            if each["type"] != "missing" and each["loc"]:
                raise _unusable(model, each, where) from None


def _unusable(model: type[BaseModel], error: Mapping[str, Any], where: str) -> EndoctError:
    key, found = ".".join(map(str, error["loc"])), abridged(error["input"])
    return EndoctError(f"'{key}' in {where} cannot be used", found=found, expected=expectation(model, error))


def overridden(keys: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``keys`` with ``overrides`` in their place; "table.key" replaces one key of a table."""
    result = dict(keys)
    for name, value in overrides.items():
        table, dot, key = name.partition(".")
        within = result.get(table)
        result[table] = {**(within if isinstance(within, Mapping) else {}), key: value} if dot else value
    return result


def _check_known(
    model: type[BaseModel], keys: Mapping[str, Any], where: str, also: tuple[str, ...] = (), inside: str = ""
) -> None:
    known = [f"{inside}{key}" for key in (*model.model_fields, *also)]
    for key, value in keys.items():
        name = f"{inside}{key}"
        if key not in model.model_fields:
            # comparing takes long for what is no word
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5) if len(name) <= LONGEST_KEY else []
            raise EndoctError(
                f"unknown key '{name[:LONGEST_KEY]}' in {where}",
                expected=f"'{near[0]}'" if near else f"one of {', '.join(known)}",
                remedy="correct the spelling or remove the key",
            )
        table = table_model(model.model_fields[key])
        if table is not None and isinstance(value, Mapping):
            _check_known(table, value, where, inside=f"{name}.")


def _described(model: type[BaseModel], place: tuple[int | str, ...]) -> str:
    field = field_at(model, place)
    return f"'{_dotted(place)}'" + (f" ({field.description})" if field is not None and field.description else "")


def _dotted(place: tuple[int | str, ...]) -> str:
    return ".".join(map(str, place))


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file of at most 1 MB. Raises :class:`EndoctError` where it cannot be read."""
    data = read_small(path)
    with refusing(f"{path} is not valid TOML"):
        text = text_of(data)
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            if (comma := _COMMA_DECIMAL.search(text)) is None:
                raise
            line = text.count("\n", 0, comma.start()) + 1
            raise EndoctError(
                f"{path} is not valid TOML",
                found=f"{comma[0].strip()} in line {line}",
                remedy=f"write numbers with a point: {comma[1]} = {comma[2].replace(',', '.')}",
            ) from error
