"""What a task of the bench is: cases with truth, a judge, and the signature of its methods; how both are loaded.

A method is one function with the signature its task states, registered under the entry-point group
``endoct.bench.TASK``; :func:`load_method` finds it. It gets what a case gives, never the truth. A task is one
:class:`Task` called ``TASK`` in a module registered under the group ``endoct.bench``.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeVar

import numpy as np

from endoct.base.entry_points import INSTALL, Function, entry_named, unknown_name
from endoct.base.errors import EndoctError
from endoct.synthetic.sample.ranges import Range as Range  # what a condition is drawn from

SUCCESS = "success"
"""The score that says, as 1.0 or 0.0, whether an answer will do; the table gives its share with an interval."""

OF_ONE = "Jaccard", "precision", "recall", "share"
"""What a score is begins with one of these where it lies between 0 and 1; where it may be negative, it has "minus"."""

Given = TypeVar("Given")
Truth = TypeVar("Truth")
Answer = TypeVar("Answer")
Conditions = Mapping[str, float | str]
"""Conditions that make a case hard, by name: numbers and words."""
GROUP = "endoct.bench"


@dataclass(frozen=True, eq=False)
class Case(Generic[Given, Truth]):
    """One problem to solve.

    Attributes
    ----------
    name: unique within a run, as "1003-2".
    given: what a method is called with; a tuple is spread over the method's arguments. Never changed by a method.
    truth: what only the judge gets.
    conditions: how hard the case is, by name: drawn numbers and words. Scores are plotted against them.
    scratch: holds the case's files, where it has some; the runner removes it after the last method.
    """

    name: str
    given: Given
    truth: Truth
    conditions: Conditions
    scratch: "TemporaryDirectory[str] | None" = None


class Declined(Exception):
    """Raised by a method, or by a judge on its behalf, to say "I do not know" and why.

    ``scores`` count where not to answer was right or wrong, as ``{"success": 1.0}`` for a pair from two bores.
    A case that was declined without scores did not succeed.
    """

    def __init__(self, reason: str, scores: Mapping[str, float] | None = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.scores = dict(scores or {})


class NotInstalled(Exception):
    """Raised by a method whose ``library`` is not installed: it is left out, and not ranked as one that fails.

    The reason names the ``remedy``; ``pip install`` unless the method knows another.
    """

    def __init__(self, library: str, remedy: str | None = None) -> None:
        self.library, self.remedy = library, remedy
        super().__init__(f"{library} is not installed; {remedy or f'pip install {library}'}")


@dataclass(frozen=True)
class Exchange(Generic[Given, Answer]):
    """How a case reaches a method that is a program, and how its answer returns: as files in two folders.

    Attributes
    ----------
    write: ``write(given, folder)`` writes what a method is called with, and nothing that leads to the truth.
    read: ``read(given, folder)`` returns the answer; raises where it is none.
    answer: ``answer(answer, folder)`` writes what a method in Python answered, so that ``read`` returns it.
    """

    write: Callable[[Given, Path], None]
    read: Callable[[Given, Path], Answer]
    answer: Callable[[Answer, Path], None]


@dataclass(frozen=True)
class Task(Generic[Given, Truth, Answer]):
    """A kind of problem.

    Attributes
    ----------
    name: as on the command line, and in the entry-point group ``endoct.bench.{name}`` of its methods.
    title: what the task is, in a line.
    signature: what a method is called with and must return, in prose with types, for people who write one.
    cases: ``cases(seed, index, ranges)`` makes a case that depends on its arguments alone, not on the machine or the
        order; ``ranges`` are those below, narrowed to what the user wants.
    judge: ``judge(case, answer)`` returns the scores. Must treat all methods alike. May raise :class:`Declined`; any
        other exception means that the answer is useless.
    ranges: the conditions that are drawn, and what from unless the user wants something else; see :func:`draw`.
    scores: name → what it is, with unit ("mean landmark error, px"), in the order to show them, see :data:`OF_ONE`.
        ``success`` needs no entry.
    optional: what else conditions may be drawn from, and further conditions, where the user wants them.
    own: the cases in one folder of the user's own data (laid out as a specimen, with truth), where that is possible.
    methods: methods that the task itself provides, in addition to those that are registered.
    against: the method from which the others' differences are taken, case by case, unless the user names one.
    exchange: how a method that is a program gets a case and answers, where it can.
    success: what the judge calls a success, in words that go on after "A success is".
    """

    name: str
    signature: str
    cases: Callable[[int, int, Mapping[str, Range]], Case[Given, Truth]]
    judge: Callable[[Case[Given, Truth], Answer], Mapping[str, float]]
    title: str = ""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    scores: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, Range] = field(default_factory=dict)
    own: Callable[[Path], Sequence[Case[Given, Truth]]] | None = None
    methods: Mapping[str, Callable[..., Answer]] = field(default_factory=dict)
    against: str | None = None
    exchange: Exchange[Given, Answer] | None = None
    success: str = ""


AnyTask = Task[Any, Any, Any]
"""A task to the machinery that runs it: only its judge and its methods know the types of cases and answers."""

AnyCase = Case[Any, Any]


def rng_of(seed: int, index: int, purpose: str) -> np.random.Generator:
    """Return a generator that depends on its arguments alone; one purpose's draws do not disturb another's."""
    digest = hashlib.sha256(purpose.encode()).digest()
    return np.random.default_rng([seed, index, int.from_bytes(digest[:8], "little")])


def draw(seed: int, index: int, ranges: Mapping[str, Range]) -> dict[str, float | str]:
    """Draw a value for every condition; narrowing one leaves the others as they were."""
    drawn: dict[str, float | str] = {}
    for name, range_ in ranges.items():
        share = float(rng_of(seed, index, f"condition {name}").random())
        words = [word for word in range_ if isinstance(word, str)]
        numbers = [float(value) for value in range_ if not isinstance(value, str)]
        drawn[name] = words[int(share * len(words))] if words else numbers[0] + share * (numbers[1] - numbers[0])
    return drawn


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
        raise EndoctError(
            f"no method is registered for '{task.name}'", remedy=f"register one under {GROUP}.{task.name}"
        )
    for name in wanted:
        if name not in known:
            unknown_name(name, known, _kind(task), remedy=INSTALL)
    if len(set(wanted)) < len(wanted):
        raise EndoctError("a method is named twice", found=", ".join(wanted), expected="each once")
    return tuple(wanted) or known


def load_method(task: AnyTask, name: str) -> Function:
    """Import and return the method ``name`` of ``task``.

    Raises :class:`EndoctError` for one that is not known or is registered twice, and whatever its import raises.
    """
    method = task.methods.get(name) or entry_named(name, _registered(task), _kind(task)).load()
    if not callable(method):
        raise EndoctError(f"the method '{name}' is no function", found=type(method).__name__)
    loaded: Function = method
    return loaded


def score_range(task: AnyTask, score: str) -> tuple[float, float]:
    """Return the least and the largest value that a score can have. Raises :class:`EndoctError` for an unknown one."""
    if score == SUCCESS:
        return 0.0, 1.0
    if score not in task.scores:
        unknown_name(score, (*task.scores, SUCCESS), f"score of '{task.name}'")
    about = task.scores[score]
    return (-math.inf if " minus " in about else 0.0), (1.0 if about.startswith(OF_ONE) else math.inf)


def origin(task: AnyTask, name: str) -> str:
    """Return where a method comes from: its function and the package that registers it; a program's command."""
    if name in task.methods:
        return str(getattr(task.methods[name], "command", "endoct"))
    entry = entry_named(name, _registered(task), _kind(task))
    package = f" ({entry.dist.name} {entry.dist.version})" if entry.dist is not None else ""
    return f"{entry.value}{package}"


def module_of(task: AnyTask, name: str) -> str:
    """Return the module that a method is in, without importing it."""
    return "endoct" if name in task.methods else entry_named(name, _registered(task), _kind(task)).module


def _registered(task: AnyTask) -> EntryPoints:
    return entry_points(group=f"{GROUP}.{task.name}")


def _kind(task: AnyTask) -> str:
    return f"method for '{task.name}'"
