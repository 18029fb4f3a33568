"""What ends a command: one line for the user, and its exit status.

One line says that input cannot be used, that memory ran out, that the system refuses, or that the disk failed.
"""

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from endoct.base.errors import EndoctError, cause_of, system_cause, visible

_SHORT_OF_MEMORY = ("(-4:Insufficient memory)", "can't start new thread")
"""What OpenCV and Python say in errors of another kind, which may come as text from another process."""


_FLAGS = (
    (re.compile(r"\b(overwrite|volume)=True\b"), r"--\1"),
    (re.compile(r"\b(modality|side|to|device)='([\w-]+)'"), r"--\1 \2"),
    (re.compile(r"\bmodality_([ab])='(\w+)'"), r"--modality-\1 \2"),
    (re.compile(r"\bsettings=\{'(\w+)': (\w+)\}"), r"--set \1=\2"),
    (re.compile(r"\bsettings_([ab])=\{'(\w+)': (\w+)\}"), r"--set-\1 \2=\3"),
)
"""How what a remedy names as arguments of a Python function is written on the command line."""
DONE, UNUSABLE_INPUT, WRONG_USAGE, NOT_ALIGNED, INTERRUPTED = 0, 1, 2, 3, 130
DOUBTED = NOT_ALIGNED
"""The status with ``--strict`` where all is done, but there is a doubt."""
UNTOLD = 3
"""The status of `pose` where all is done, but the place of the bore remains unknown."""


def in_one_line(error: BaseException) -> str | None:
    """Return the line that the command line prints for an error, None where it is a fault of endoct's own."""
    if isinstance(error, EndoctError):
        refused = with_flags(error)
    elif isinstance(error, MemoryError) or any(words in str(error) for words in _SHORT_OF_MEMORY):
        lines = [line for line in str(error).splitlines() if line.strip()]
        refused = EndoctError(
            "memory ran out",
            found=lines[-1].strip() if lines else "",  # of the trace from another process, the error itself
            remedy="end other programs, use fewer --workers where there are some, or take a computer with more",
        )
    elif isinstance(error, RecursionError):
        remedy = "look into its sidecar and the other texts that belong to it"
        refused = EndoctError("something in the input is nested too deeply", remedy=remedy)
    elif isinstance(error, UnicodeEncodeError):
        refused = EndoctError(
            "a text cannot be written",
            found=repr(error.object[error.start : error.end]),
            expected="characters that Unicode has",
            remedy="look for it in the names of the files, and rename them",
        )
    elif isinstance(error, OSError):
        refused = EndoctError(
            f"{error.filename} cannot be used" if error.filename else "the system refused to read or write",
            found=cause_of(error),
            remedy="see whether you may read and write there, and whether the disk is full",
        )
    else:
        return None
    return str(refused)


def with_flags(error: EndoctError) -> EndoctError:
    """Return the error with ``overwrite=True`` and other arguments of Python functions in its remedy as flags."""
    remedy = error.remedy
    for argument, flag in _FLAGS:
        remedy = argument.sub(flag, remedy)
    return type(error)(error.what, found=error.found, expected=error.expected, remedy=remedy)


def tame_libraries() -> None:
    """Have warnings, and what libraries log, show what would steer a terminal: they quote files and their names."""
    if isinstance(logging.lastResort, logging.Handler):
        logging.lastResort.setFormatter(_VisibleFormatter())
    warnings.formatwarning = _warning_text


class _VisibleFormatter(logging.Formatter):
    """Lines of a message as they are, and what is in them made visible."""

    def format(self, record: logging.LogRecord) -> str:
        return visible_lines(super().format(record))


def _warning_text(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    del filename, lineno, line  # of the library, which the user of a command cannot change
    return f"endoct: {category.__name__}: {visible(str(message))}\n"


def visible_lines(text: str) -> str:
    """Return ``text`` with its lines as they are, and what is in them made visible."""
    return "\n".join(line if line.isprintable() else visible(line) for line in text.split("\n"))


@contextmanager
def refusing_disk_errors(folder: Path) -> Iterator[None]:
    """Turn whatever goes wrong in writing to ``folder`` into one :class:`EndoctError`."""
    try:
        yield
    except OSError as error:
        raise EndoctError(
            f"{folder} cannot be written",
            found=system_cause(error),
            remedy="mend that and start again with the same arguments; what is finished is kept",
        ) from error
