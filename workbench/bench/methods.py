"""Which tasks and methods are installed, and how they are loaded."""

import difflib
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from endoct.stitching.errors import EndoctError
from endoct.workbench.bench.task import Task

GROUP = "endoct.bench"
Method = Callable[..., Any]


def task_names() -> tuple[str, ...]:
    """Return the names of the installed tasks."""
    return tuple(sorted(entry.name for entry in entry_points(group=GROUP)))


def load_task(name: str) -> Task:
    """Return the task ``name``. Raises :class:`EndoctError` for one that is not known or cannot be imported."""
    entry = _entry(name, entry_points(group=GROUP), "task")
    try:
        task = entry.load()
    except (ImportError, AttributeError) as error:
        raise EndoctError(f"the task '{name}' cannot be imported", found=f"{entry.value}: {error}") from error
    if not isinstance(task, Task) or task.name != name:
        raise EndoctError(f"the entry point '{name}' ({entry.value}) is no task", expected=f"a Task named '{name}'")
    return task


def method_names(task: str) -> tuple[str, ...]:
    """Return the names of the methods that are registered for ``task``, in order of the alphabet."""
    return tuple(sorted({entry.name for entry in entry_points(group=f"{GROUP}.{task}")}))


def check_names(task: str, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return ``wanted``, or all methods of ``task`` where none is. Raises :class:`EndoctError` for an unknown one."""
    entries = entry_points(group=f"{GROUP}.{task}")
    if not wanted:
        wanted = method_names(task)
    for name in wanted:
        _entry(name, entries, f"method for '{task}'")
    if not wanted:
        raise EndoctError(f"no method is registered for '{task}'", remedy=f"register one under {GROUP}.{task}")
    if len(set(wanted)) < len(wanted):
        raise EndoctError("a method is named twice", found=", ".join(wanted), expected="each once")
    return tuple(wanted)


def load_method(task: str, name: str) -> Method:
    """Import the method ``name`` of ``task``.

    Raises :class:`EndoctError` for one that is not known or is registered twice, and whatever its import raises.
    """
    method = _entry(name, entry_points(group=f"{GROUP}.{task}"), f"method for '{task}'").load()
    if not callable(method):
        raise EndoctError(f"the method '{name}' is no function", found=type(method).__name__)
    loaded: Method = method
    return loaded


def _entry(name: str, entries: Iterable[EntryPoint], what: str) -> EntryPoint:
    by_name: dict[str, set[str]] = {}
    for entry in entries:
        by_name.setdefault(entry.name, set()).add(entry.value)
    values = by_name.get(name, set())
    if not values:
        nearest = difflib.get_close_matches(name, by_name, 1, cutoff=0.4)
        raise EndoctError(
            f"unknown {what}: '{name}'",
            expected=f"'{nearest[0]}'" if nearest else f"one of {', '.join(sorted(by_name))}",
        )
    if len(values) > 1:
        raise EndoctError(
            f"two packages register '{name}' as a {what}",
            found=" and ".join(sorted(values)),
            remedy="rename one, or uninstall its package",
        )
    return next(entry for entry in entries if entry.name == name)
