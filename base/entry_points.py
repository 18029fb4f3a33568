"""Functions that packages register under a name, as entry points: endoct's own and strangers' alike."""

import difflib
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import NoReturn

from endoct.base.errors import EndoctError

Function = Callable[..., object]


def entry_named(name: str, entries: EntryPoints, kind: str) -> EntryPoint:
    """Return the one of ``entries`` called ``name``; ``kind`` says what it is to be, as "task".

    Raises :class:`EndoctError` where there is none, or two packages register different ones.
    """
    values = {entry.value for entry in entries if entry.name == name}
    if not values:
        unknown_name(name, sorted({entry.name for entry in entries}), kind)
    if len(values) > 1:
        raise EndoctError(
            f"two packages register '{name}' as a {kind}",
            found=" and ".join(sorted(values)),
            remedy="rename one, or uninstall its package",
        )
    return next(entry for entry in entries if entry.name == name)


def load_function(group: str, name: str, kind: str) -> Function:
    """Return the function that is registered in ``group`` under ``name``.

    Raises :class:`EndoctError` where there is none, or what is registered cannot be imported or is no function.
    """
    entry = entry_named(name, entry_points(group=group), kind)
    try:
        function = entry.load()
    except (ImportError, AttributeError) as error:
        raise EndoctError(f"the {kind} '{name}' cannot be imported", found=f"{entry.value}: {error}") from error
    if not callable(function):
        raise EndoctError(f"the {kind} '{name}' is no function", found=type(function).__name__)
    loaded: Function = function
    return loaded


def unknown_name(name: str, known: Sequence[str], kind: str) -> NoReturn:
    """Raise the :class:`EndoctError` of a ``name`` that nobody registered, with the nearest of the ``known`` ones."""
    nearest = difflib.get_close_matches(name, known, 1, cutoff=0.4)
    raise EndoctError(
        f"unknown {kind}: '{name}'", expected=f"'{nearest[0]}'" if nearest else f"one of {', '.join(known)}"
    )
