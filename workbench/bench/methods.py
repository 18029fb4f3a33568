"""Which tasks and methods are installed, and how they are loaded."""

from collections.abc import Sequence
from importlib.metadata import EntryPoints, entry_points

from endoct.stitching.errors import EndoctError
from endoct.stitching.registered import Function, entry_named, unknown_name
from endoct.workbench.bench.task import AnyTask, Task

GROUP = "endoct.bench"


def task_names() -> tuple[str, ...]:
    """Return the names of the installed tasks."""
    return tuple(sorted(entry.name for entry in entry_points(group=GROUP)))


def load_task(name: str) -> AnyTask:
    """Return the task ``name``. Raises :class:`EndoctError` for one that is not known or cannot be imported."""
    entry = entry_named(name, entry_points(group=GROUP), "task")
    try:
        task = entry.load()
    except (ImportError, AttributeError) as error:
        raise EndoctError(f"the task '{name}' cannot be imported", found=f"{entry.value}: {error}") from error
    if not isinstance(task, Task) or task.name != name:
        raise EndoctError(f"the entry point '{name}' ({entry.value}) is no task", expected=f"a Task named '{name}'")
    return task


def method_names(task: AnyTask) -> tuple[str, ...]:
    """Return the names of the methods for ``task``: first those that it provides itself, then the registered ones."""
    return *task.methods, *sorted({entry.name for entry in _registered(task)} - set(task.methods))


def check_names(task: AnyTask, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return ``wanted``, or all methods of ``task`` where none is. Raises :class:`EndoctError` for an unknown one."""
    known = method_names(task)
    if not known:
        raise EndoctError(f"no method is registered for '{task.name}'", remedy=f"register one under {_group(task)}")
    for name in wanted:
        if name not in known:
            unknown_name(name, known, _what(task))
    if len(set(wanted)) < len(wanted):
        raise EndoctError("a method is named twice", found=", ".join(wanted), expected="each once")
    return tuple(wanted) or known


def load_method(task: AnyTask, name: str) -> Function:
    """Import the method ``name`` of ``task``.

    Raises :class:`EndoctError` for one that is not known or is registered twice, and whatever its import raises.
    """
    method = task.methods.get(name) or entry_named(name, _registered(task), _what(task)).load()
    if not callable(method):
        raise EndoctError(f"the method '{name}' is no function", found=type(method).__name__)
    loaded: Function = method
    return loaded


def origin(task: AnyTask, name: str) -> str:
    """Return where a method comes from: its function and the version of the package that registers it."""
    if name in task.methods:
        return "endoct"
    entry = entry_named(name, _registered(task), _what(task))
    package = f" ({entry.dist.name} {entry.dist.version})" if entry.dist is not None else ""
    return f"{entry.value}{package}"


def module_of(task: AnyTask, name: str) -> str:
    """Return the module that a method is in, without importing it."""
    return "endoct" if name in task.methods else entry_named(name, _registered(task), _what(task)).module


def _group(task: AnyTask) -> str:
    return f"{GROUP}.{task.name}"


def _registered(task: AnyTask) -> EntryPoints:
    return entry_points(group=_group(task))


def _what(task: AnyTask) -> str:
    return f"method for '{task.name}'"
