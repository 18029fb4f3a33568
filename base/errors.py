"""What endoct raises for input it cannot use."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

_SHORT_WRITE = re.compile(r"(\d+) requested and (\d+) written")
LONGEST_CAUSE = 300
LONGEST_PATH = 1000


class EndoctError(Exception):
    """Input that cannot be used, described in one line: what, found, expected, remedy.

    ``what`` is the problem; ``found``, ``expected`` and ``remedy`` are phrases without a full stop,
    left out where there is nothing to say. ``str()`` gives the one line a user sees.
    """

    def __init__(self, what: str, *, found: str = "", expected: str = "", remedy: str = "") -> None:
        super().__init__(what, found, expected, remedy)
        self.what = what
        self.found = found
        self.expected = expected
        self.remedy = remedy

    def __str__(self) -> str:
        parts = [
            _short(self.what, LONGEST_PATH),  # it may name what a file, or a user, brings
            f"found {_short(self.found)}" if self.found else "",
            f"expected {self.expected}" if self.expected else "",
            self.remedy,
        ]
        return visible(" ".join("; ".join(part for part in parts if part).split()))

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.what, self.found, self.expected, self.remedy)


class NotSeen(EndoctError):
    """A recording that can be read, but does not show what is looked for in it."""


@contextmanager
def refusing(subject: str, *, expected: str = "", remedy: str = "") -> Iterator[None]:
    """Turn whatever a library raises about a file into one :class:`EndoctError` that names the cause.

    For the boundary where a file is handed to a library, which may raise anything on damaged or hostile bytes.
    Memory that runs out passes: it is not the file's fault alone.
    """
    try:
        yield
    except (EndoctError, MemoryError):
        raise
    except Exception as error:
        raise EndoctError(subject, found=cause_of(error), expected=expected, remedy=remedy) from error


def cause_of(error: BaseException) -> str:
    """Return what an exception of a library says, in one line, with its kind where it says little."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    text = " ".join((system_cause(error) if isinstance(error, OSError) else str(error)).split())[:LONGEST_CAUSE]
    return text if isinstance(error, OSError | ValueError) and text else f"{type(error).__name__}: {text}".rstrip(": ")


def system_cause(error: OSError) -> str:
    """Return the system's reason for an error; NumPy gives none where a disk is full, so that is said for it."""
    if short := _SHORT_WRITE.fullmatch(str(error)):
        return f"the disk took only {short[2]} of {short[1]} numbers: it is full, or a limit is reached"
    return error.strerror or str(error)


def _short(text: str, most: int = LONGEST_CAUSE) -> str:
    text = visible(" ".join(text.split()))  # what is written out grows
    return text if len(text) <= most else f"{text[:most]}…"


def some_of(names: Sequence[str], most: int = 3) -> str:
    """Return the first of ``names`` for a message, and how many more there are: "a.dcm, b.dcm, c.dcm and 4 more"."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def visible(text: str) -> str:
    """Return ``text`` with what would steer a terminal, or cannot be encoded, written out: ESC as ``\\x1b``."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii") for c in text)


def _rebuild(kind: type[EndoctError], problem: str, actual: str, expected: str, remedy: str) -> EndoctError:
    return kind(problem, found=actual, expected=expected, remedy=remedy)
