"""Functions that packages register under a name, as entry points: endoct's own and strangers' alike.

Methods of the research bench are such functions: whoever processes a recording or compares two can choose one of them
by its name.
"""

import difflib
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import NoReturn

from endoct.base.errors import EndoctError, cause_of

Function = Callable[..., object]

OURS = "endoct"
"""The name of our own method of a task; what is used unless another is chosen."""
INSTALL = "where it is new, install its package again"
"""The remedy for a name that nobody registered: entry points are read from what is installed."""


def entry_named(name: str, entries: EntryPoints, kind: str) -> EntryPoint:
    """Return the one of ``entries`` called ``name``; ``kind`` says what it is to be, as "task".

    Raises :class:`EndoctError` where there is none, or two packages register different ones.
    """
    values = {entry.value for entry in entries if entry.name == name}
    if not values:
        unknown_name(name, sorted({entry.name for entry in entries}), kind, remedy=INSTALL)
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


def answer_by(task: str, name: str, *given: object, setting: str) -> object:
    """Return what the method ``name`` of a ``task`` of the bench answers to what it is ``given``.

    ``setting`` is the one that chose it. Raises :class:`EndoctError` where there is no such method, or it raises
    anything.
    """
    method = load_function(f"endoct.bench.{task}", name, f"{task} method")
    try:
        return method(*given)
    except EndoctError:
        raise
    except Exception as error:  # a stranger's function may raise anything
        raise EndoctError(
            f"the {task} method '{name}' gives no answer",
            found=cause_of(error),
            remedy=f"choose another one, or leave {setting} out",
        ) from error


def unknown_name(name: str, known: Sequence[str], kind: str, remedy: str = "") -> NoReturn:
    """Raise the :class:`EndoctError` of a ``name`` that nobody registered, with the nearest of the ``known`` ones."""
    nearest = difflib.get_close_matches(name, known, 1, cutoff=0.4)
    raise EndoctError(
        f"unknown {kind}: '{name}'",
        expected=f"'{nearest[0]}'" if nearest else f"one of {', '.join(known)}",
        remedy=remedy,
    )
