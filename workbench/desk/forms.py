"""The forms by which the page runs commands, made from the signatures that the command line is made from.

What a form gives becomes the words of a command line, and nothing else: what the page can do, the command line can.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from docstring_parser import parse
from tyro.conf import Fixed, Positional, Suppress

from endoct.base.errors import EndoctError
from endoct.base.files.files import exists, leads_below

Command = Callable[..., Any]
FieldKind = Literal["text", "number", "choice", "switch", "path", "paths", "lines"]
LONGEST = 4000
"""Most characters of a value."""
MOST_LINES = 200
NOT_ASKED = ("json", "strict")
"""Options for scripts that read the outcome; the page reads it anyway."""
_WHOLE, _NUMBER = re.compile(r"-?\d{1,18}"), re.compile(r"-?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d{1,3})?")


@dataclass(frozen=True)
class FormField:
    """One argument of a command: ``flag`` is "" where it stands by its place, ``about`` says what it is.

    ``default`` is None where the command line has to be given a value, or has none unless it is.
    """

    name: str
    flag: str
    kind: FieldKind
    about: str
    required: bool
    choices: tuple[str, ...] = ()
    default: str | float | bool | None = None
    whole: bool = False
    hint: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the field for the page."""
        return {**vars(self), "choices": list(self.choices)}


@dataclass(frozen=True)
class Form:
    """A command of the page: ``title`` is the first line of its help."""

    command: str
    title: str
    fields: tuple[FormField, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the form for the page."""
        return {"command": self.command, "title": self.title, "fields": [field.to_json() for field in self.fields]}


def form_of(name: str, command: Command) -> Form:
    """Return the form of the command ``name``, a function or a request that tyro reads."""
    hints = get_type_hints(command, include_extras=True)
    abouts = _abouts(command)
    fields = []
    for key, parameter in inspect.signature(command).parameters.items():
        hint = hints[key]
        markers = hint.__metadata__ if get_origin(hint) is Annotated else ()
        if key in NOT_ASKED or Fixed in markers or Suppress in markers:
            continue
        required = parameter.default is inspect.Parameter.empty
        fields.append(
            _field(key, hint, markers, None if required else parameter.default, abouts.get(key, ""), required)
        )
    return Form(name, (parse(command.__doc__ or "").short_description or name).rstrip("."), tuple(fields))


def arguments_of(form: Form, values: Mapping[str, object], folder: Path) -> tuple[str, ...]:
    """Return the words of the command line that ``values`` of the form's fields stand for, run in ``folder``.

    Paths are those below ``folder``. Raises :class:`EndoctError` for a field that the form does not have, a missing
    value, one of another kind, and a path out of the folder.
    """
    known = {field.name: field for field in form.fields}
    for name in values:
        if name not in known:
            raise EndoctError(f"`endoct {form.command}` has no '{str(name)[:40]}'", expected=", ".join(known))
    placed: list[str] = []
    named: list[str] = []
    for each in form.fields:
        words = [*_words(each, values.get(each.name), folder)]
        if each.required and not words:
            raise EndoctError(f"`endoct {form.command}` needs '{each.name}'", expected=each.about)
        (named if each.flag else placed).extend(words)
    return (form.command, *placed, *named)


def path_within(folder: Path, text: str) -> str:
    """Return ``text`` if it is a path below ``folder``, as words of a command line run there have it.

    Raises :class:`EndoctError` where it leads elsewhere, by itself or by a link.
    """
    outside = Path(text).is_absolute() or ".." in Path(text).parts or not text.strip()
    if outside or not leads_below(folder, folder / text):
        raise EndoctError(
            f"'{text[:80]}' is no path in the folder that is open",
            expected=f"one below {folder}",
            remedy="open a folder that holds it",
        )
    return f"./{text}" if text.startswith("-") else text


def _abouts(command: Command) -> dict[str, str]:
    """Return what the docstrings say of every argument; a request inherits what those before it say."""
    classes = reversed(command.__mro__) if isinstance(command, type) else (command,)
    return {each.arg_name: each.description or "" for class_ in classes for each in parse(class_.__doc__ or "").params}


def _field(name: str, hint: Any, markers: tuple[Any, ...], default: object, about: str, required: bool) -> FormField:
    plain = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    options = [word for word in (getattr(marker, "name", None) for marker in markers) if isinstance(word, str)]
    metavars = [word for word in (getattr(marker, "metavar", None) for marker in markers) if word]
    flag = "" if Positional in markers else "--" + (options[-1] if options else name).replace("_", "-")
    kinds = [kind for kind in _members(plain) if kind is not NoneType]
    choices = tuple(str(word) for kind in kinds if get_origin(kind) is Literal for word in get_args(kind))
    kind = _kind(kinds[0], choices)
    said = default if isinstance(default, str | int | float | bool) else None
    example = metavars[-1] if metavars else ""
    return FormField(name, flag, kind, " ".join(about.split()), required, choices, said, int in kinds, example)


def _members(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _kind(hint: Any, choices: tuple[str, ...]) -> FieldKind:
    if choices:
        return "choice"
    if get_origin(hint) is tuple:
        return "paths" if issubclass(get_args(hint)[0], Path) else "lines"
    if hint is bool:
        return "switch"
    if hint in (int, float):
        return "number"
    return "path" if issubclass(hint, Path) else "text"


def _words(field: FormField, value: object, folder: Path) -> Iterator[str]:
    """Yield the words for one value; none where it is empty, or what the command takes anyway."""
    if value in (None, "", [], False) or (value == field.default and not isinstance(value, bool)):
        return
    if field.kind == "switch":
        _check(field, value, isinstance(value, bool))
        yield field.flag
        return
    several = field.kind in ("paths", "lines")
    texts = _lines(field, value) if several else [_text(field, value)]
    # a file, where a field takes that or a word
    is_file = field.hint.startswith("FILE|") and texts != [field.hint.removeprefix("FILE|")]
    if field.kind in ("path", "paths") or is_file:
        texts = [path_within(folder, text) for text in texts]
    if field.kind == "lines":
        for stated in filter(None, (text.partition("=")[2] for text in texts)):
            if "/" in stated or exists(folder / stated):  # the value of a setting may be a file
                path_within(folder, stated)
    if not field.flag:
        yield from texts
    elif field.kind == "paths":
        yield from (field.flag, *texts)
    else:
        yield from (f"{field.flag}={text}" for text in texts)


def _lines(field: FormField, value: object) -> list[str]:
    lines = [line for line in value if isinstance(line, str)] if isinstance(value, list) else []
    _check(field, value, isinstance(value, list) and len(lines) == len(value) <= MOST_LINES)
    return [_text(field, line) for line in lines if line.strip()]


def _text(field: FormField, value: object) -> str:
    text = value.strip() if isinstance(value, str) else f"{value:.15g}" if isinstance(value, float) else str(value)
    fits = isinstance(value, str | int | float) and not isinstance(value, bool) and len(text) <= LONGEST
    fits = fits and text.isprintable()
    if field.kind == "choice":
        fits = fits and text in field.choices
    if field.kind == "number":
        fits = fits and (_WHOLE if field.whole else _NUMBER).fullmatch(text) is not None
    if not field.flag and field.kind == "text":
        fits = fits and not text.startswith("-")
    _check(field, value, fits)
    return text


def _check(field: FormField, value: object, fits: bool) -> None:
    """Raise :class:`EndoctError` unless a value ``fits`` its field."""
    if fits:
        return
    expected = {"choice": f"one of {', '.join(field.choices)}", "number": "a number", "switch": "true or false"}
    raise EndoctError(
        f"'{field.name}' cannot be used",
        found=repr(value)[:80],
        expected=expected.get(field.kind, "a text of one line" if field.kind in ("text", "path") else "lines of text"),
    )
