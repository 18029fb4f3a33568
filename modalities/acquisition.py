"""The sidecar ``acquisition.toml``: what the files themselves do not say about a recording."""

import difflib
import re
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from endoct.modalities.folders import exists, is_folder
from endoct.modalities.keys import abridged, check_kinds, expectation, field_at, table_model
from endoct.stitching.axial_scale import AxialScale
from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import read_small, text_of
from endoct.stitching.names import inside

SIDECAR_NAME = "acquisition.toml"

Travel = Literal["in", "out", "unknown"]
Handedness = Literal["same", "mirrored", "unknown"]
MOST_PLACE_MM = 1e4
"""No bore is longer."""
MOST_PLACES = 1_000_000
Place = Annotated[float, Field(ge=-MOST_PLACE_MM, le=MOST_PLACE_MM)]
LONGEST_KEY = 100
_COMMA_DECIMAL = re.compile(
    r"^[ \t]*([A-Za-z0-9_-]{1,100})[ \t]*=[ \t]*([-+]?[0-9]{1,20},[0-9]{1,20})(?![0-9,])", re.MULTILINE
)
"""A number as many countries write it, which TOML has not."""


@dataclass(frozen=True)
class OneOf:
    """Groups of keys of which a recording needs one, whole; ``why`` it does."""

    groups: tuple[tuple[str, ...], ...]
    why: str

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

    @property
    def axial_scale(self) -> AxialScale:
        """What the scale along the bore rests on; a plug-in that knows says more."""
        return AxialScale()


AnyModel = TypeVar("AnyModel", bound=BaseModel)


def sidecar_path(recording: Path) -> Path:
    """Return where the sidecar of ``recording`` (a folder or a file) lies: inside it, or next to it."""
    return (recording if is_folder(recording) else recording.parent) / SIDECAR_NAME


def read_keys(recording: Path) -> dict[str, Any]:
    """Return the keys of the recording's sidecar, its ``calibration`` file merged in; {} where there is none.

    Raises :class:`EndoctError` where a file is not TOML, or the calibration file is missing or not in that folder.
    """
    path = sidecar_path(recording)
    if not exists(path):
        return {}
    keys = read_toml(path)
    if isinstance(name := keys.get("calibration"), str):
        extra = read_toml(inside(path.parent, name, f"'calibration' in {path}"))
        if both := sorted(keys.keys() & extra.keys()):
            raise EndoctError(f"{', '.join(both)} stands in both {path} and {name}", remedy="keep it in one of them")
        keys |= extra
    return keys


def validate(model: type[AnyModel], keys: Mapping[str, Any], where: str, *, also: tuple[str, ...] = ()) -> AnyModel:
    """Return ``keys`` as a checked ``model``.

    ``where`` names the source for the message, ``also`` further keys to suggest from. Raises
    :class:`EndoctError` for the first key that is unknown (suggesting the nearest), missing, or has an
    impossible value.
    """
    _check_known(model, keys, where, also)
    check_kinds(model, keys, where)
    try:
        return model.model_validate(dict(keys))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        said = expectation(model, first)
        if not key:  # the keys do not fit each other
            raise EndoctError(f"{where}: {said}", remedy="correct the keys") from None
        missing = [e["loc"] for e in error.errors() if e["type"] == "missing" and field_at(model, e["loc"])]
        if missing:
            described, first_one = ", ".join(_described(model, place) for place in missing), _dotted(missing[0])
            raise EndoctError(
                f"{where} lacks {described}",
                remedy=f"add what is missing to {SIDECAR_NAME}, or give it with settings={{'{first_one}': VALUE}}",
            ) from None
        raise EndoctError(
            f"'{key}' in {where} cannot be used",
            found=abridged(first["input"]),
            expected=said,
        ) from None


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
