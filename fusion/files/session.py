"""Session files: what somebody pointed out on two sides by hand and noted there, and which sides these are."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import SMALL_BYTES, read_small
from endoct.fusion.geometry.alignment import USUAL_SIGMA_MM, LandmarkPair, Place, Role
from endoct.modalities.acquisition import MOST_PLACE_MM
from endoct.stitching.panorama import Panorama

NAME = "session.json"
"""The name of the session file in the folder of its comparison."""
MASKS = "masks"
"""The folder next to the session file in which the page saves masks."""
FORMAT: Literal["endoct-session-1"] = "endoct-session-1"
MOST_PAIRS = 1000
MOST_LETTERS = 200
"""Of the text of a note."""
WRITTEN_BY = "a file that the page of `endoct serve` wrote"

_Strict = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
_Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class Identity:
    """Which side this is: its ``name``, and the sha256 of its ``recording`` and of how that was ``read_as``.

    ``recording`` stands for the files without their sidecar, ``read_as`` for what the sidecar says. Places on the wall
    depend on it: on pitch, directions and origin.
    """

    name: str
    recording: str
    read_as: str


@dataclass(frozen=True)
class Note:
    """What somebody noted at a ``place`` of the wall, in the frame of the ``side`` on which it was pointed out."""

    side: Literal["a", "b"]
    place: Place
    text: str


def _becomes(kind: type[Any]) -> AfterValidator:
    """Have what was read by a model of the fields of ``kind`` be one."""
    return AfterValidator(lambda stored: kind(**dict(stored)))


class _Place(BaseModel):
    model_config = _Strict

    theta_rad: float = Field(ge=0, lt=2 * math.pi)
    z_mm: float = Field(ge=-MOST_PLACE_MM, le=MOST_PLACE_MM)


_OnWall = Annotated[_Place, _becomes(Place)]


class _Pair(BaseModel):
    model_config = _Strict

    a: _OnWall
    b: _OnWall
    role: Role = "correct"
    name: str = Field(default="", max_length=100)
    sigma_mm: float = Field(default=USUAL_SIGMA_MM, ge=1e-4, le=10)


def _line(text: str) -> str:
    if not text.isprintable() or not text.strip():
        raise PydanticCustomError("line", "one line of text without control characters")
    return text


class _Note(BaseModel):
    model_config = _Strict

    side: Literal["a", "b"]
    place: _OnWall
    text: Annotated[str, Field(max_length=MOST_LETTERS), AfterValidator(_line)]


class _Side(BaseModel):
    model_config = _Strict

    name: str = Field(min_length=1, max_length=100)
    recording: _Digest
    read_as: _Digest


_Identity = Annotated[_Side, _becomes(Identity)]


class _Placed(BaseModel):
    model_config = _Strict

    pairs: Annotated[tuple[Annotated[_Pair, _becomes(LandmarkPair)], ...], Field(strict=False, max_length=MOST_PAIRS)]
    notes: Annotated[tuple[Annotated[_Note, _becomes(Note)], ...], Field(strict=False, max_length=MOST_PAIRS)] = ()


class _File(_Placed):
    format: Literal["endoct-session-1"]
    sides: Annotated[tuple[_Identity, _Identity], Field(strict=False)]


@dataclass(frozen=True)
class Session:
    """Landmark pairs and notes, and the two sides on which they were placed, A first."""

    sides: tuple[Identity, Identity]
    pairs: tuple[LandmarkPair, ...] = ()
    notes: tuple[Note, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Return the object that a session file holds; without notes it is one for older versions, too."""
        return {
            "format": FORMAT,
            "sides": [vars(side) for side in self.sides],
            "pairs": [pair_json(pair) for pair in self.pairs],
            **({"notes": [note_json(note) for note in self.notes]} if self.notes else {}),
        }

    def to_bytes(self) -> bytes:
        """Return the bytes of the session's file."""
        return (json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(
            "utf-8", "backslashreplace"
        )


def pair_json(pair: LandmarkPair) -> dict[str, object]:
    """Return a pair as a session file holds it."""
    places = {side: vars(place) for side, place in (("a", pair.a), ("b", pair.b))}
    return {**places, "role": pair.role, "name": pair.name, "sigma_mm": pair.sigma_mm}


def note_json(note: Note) -> dict[str, object]:
    """Return a note as a session file holds it."""
    return {**vars(note), "place": vars(note.place)}


def identity_of(name: str, panorama: Panorama) -> Identity:
    """Return the identity of the side ``name``: by the recording that ``panorama`` was made from, else by its samples.

    A recording and a panorama that was stored of it have the same identity.
    """
    recorded = recorded_identity(name, panorama.provenance)
    if recorded is not None:
        return recorded
    content = hashlib.sha256(repr((panorama.grid, panorama.modality)).encode())
    for samples in (panorama.intensity, panorama.valid):
        content.update(samples.tobytes())
    return Identity(name, content.hexdigest(), _digest({}))


def recorded_identity(name: str, provenance: Mapping[str, Any]) -> Identity | None:
    """Return the identity of a side by its recording; None where its panorama does not name the recording."""
    inputs, acquisition = provenance.get("inputs"), provenance.get("acquisition")
    if not isinstance(inputs, Mapping) or not isinstance(acquisition, Mapping):
        return None
    files = sorted(str(digest) for path, digest in inputs.items() if not str(path).endswith(".toml"))
    return Identity(name, _digest(files), _digest(acquisition)) if files else None


def read_session(path: Path) -> Session:
    """Read a session file. Raises :class:`EndoctError` where it is none, larger than 1 MB, or holds nonsense."""
    return session_from(read_small(path, SMALL_BYTES), str(path))


def session_from(data: bytes, where: str) -> Session:
    """Return the session whose file holds ``data``. Raises :class:`EndoctError`, naming ``where``, for nonsense."""
    stored = object_from(data, where)
    if (found := stored.get("format")) != FORMAT:
        named = isinstance(found, str) and found.startswith("endoct-session-")
        raise EndoctError(
            f"{where} is no session file" if not named else f"{where} is a session file of another version of endoct",
            found=f"format {found!r:.80}" if "format" in stored else "no 'format'",
            expected=f"'{FORMAT}', {WRITTEN_BY}",
        )
    file = _checked(_File, stored, where)
    return Session(file.sides, file.pairs, file.notes)


def placed_from(stored: Mapping[str, Any], where: str) -> tuple[tuple[LandmarkPair, ...], tuple[Note, ...]]:
    """Return pairs and notes of an object ``{"pairs": […], "notes": […]}``, of which the latter may be left out.

    Raises :class:`EndoctError`, naming ``where``, for nonsense.
    """
    placed = _checked(_Placed, stored, where)
    return placed.pairs, placed.notes


def object_from(data: bytes, where: str) -> dict[str, Any]:
    """Return the JSON object in ``data``. Raises :class:`EndoctError`, naming ``where``, where there is none."""
    with refusing(f"{where} is no session file", expected=WRITTEN_BY):
        stored = json.loads(data)
    if not isinstance(stored, dict):
        raise EndoctError(f"{where} is no session file", found=type(stored).__name__, expected=WRITTEN_BY)
    return stored


def check_sides(session: Session, sides: Sequence[Identity], where: str) -> None:
    """Raise :class:`EndoctError` where ``session`` was made on other sides than these, A first."""
    if session.sides == tuple(sides):
        return
    of_session, here = ([side.name for side in each] for each in (session.sides, sides))
    remedy = "compare the recordings on which its landmarks were placed, or place them anew"
    if session.sides == tuple(reversed(sides)) or (of_session != here and of_session == here[::-1]):
        found, remedy = f"sides {' and '.join(here)}", f"name {of_session[0]} first"
    elif of_session != here:
        found = f"sides {' and '.join(here)}"
    else:
        pairs = list(zip(session.sides, sides, strict=True))
        others = [side.name for stored, side in pairs if stored.recording != side.recording]
        found = (
            f"another recording of {' and of '.join(others)}"
            if others
            else f"{' and '.join(s.name for o, s in pairs if o != s)} read by another sidecar or other settings of it"
        )
    raise EndoctError(
        f"the session {where} belongs to another comparison",
        found=found,
        expected=f"{' and '.join(of_session)} as they were then",
        remedy=remedy,
    )


def _checked(model: type[Any], stored: Mapping[str, Any], where: str) -> Any:
    try:
        return model.model_validate(stored)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part + 1 if isinstance(part, int) else part) for part in first["loc"]) or "the whole"
        said = str(first["msg"]).removeprefix("Input should be ")
        raise EndoctError(
            f"'{place}' in {where} cannot be used",
            found=f"{first['input']!r:.80}" if not isinstance(first["input"], dict | list) else "",
            expected=said[:1].lower() + said[1:],
            remedy=f"correct it, or take {WRITTEN_BY}",
        ) from None


def _digest(value: object) -> str:
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()
