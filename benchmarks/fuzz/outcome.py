"""One case read under watch: how long, with how much memory, and how it ended."""

import contextlib
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType

from endoct.base.errors import EndoctError

MOST_BYTES = 1_000_000_000
"""A case that lifts the peak of resident memory by more is a finding."""
LONGEST_MESSAGE = 2000
WAITING = 0.02
"""A case that works for a smaller share of the time than this is waiting."""
MOST_WAIT = 6.0
READ, REFUSED = "read", "refused"

_UNSAFE = ("pickle.find_class", "os.system", "subprocess.Popen", "socket.connect", "os.remove", "os.rename")
_FORBIDDEN = ("/etc/passwd", "/dev/zero")


class TooLongError(BaseException):
    """The time is over; no reader catches it."""


@dataclass(frozen=True)
class Outcome:
    """``kind`` is "read", "refused" or what went wrong; ``where`` in endoct; ``message`` with its traceback."""

    kind: str
    where: str = ""
    message: str = ""

    @property
    def is_finding(self) -> bool:
        """Whether it is neither read nor refused in one line."""
        return self.kind not in (READ, REFUSED)


def outcome_of(read: Callable[[Path], object], path: Path, *, case: Path, seconds: float) -> Outcome:
    """Return how reading ``path``, which lies in the folder ``case``, ends."""
    _reset_peak()
    before = _peak_bytes()
    with warnings.catch_warnings(), _audited(case) as opened:
        warnings.simplefilter("ignore")
        try:
            with _time_limit(seconds):
                outcome = _read(read, path)
        except TooLongError as error:  # between the reading and the end of its limit
            outcome = _too_long(error)
    if opened and not outcome.is_finding:
        outcome = Outcome("reaches outside", message=opened[0])
    lifted = _peak_bytes() - before
    if lifted > MOST_BYTES and outcome.kind in (READ, REFUSED):
        return Outcome("much memory", outcome.where, f"{lifted / 1e9:.1f} GB; {outcome.kind}: {outcome.message}")
    return outcome


def _read(read: Callable[[Path], object], path: Path) -> Outcome:
    try:
        read(path)
    except EndoctError as error:
        return _refusal(error)
    except TooLongError as error:
        return _too_long(error)
    except BaseException as error:  # noqa: BLE001  whatever a library may raise is what is looked for
        message = "".join(traceback.format_exception(error, limit=-25))[-6000:]
        return Outcome(type(error).__name__, innermost(error.__traceback__), message)
    return Outcome(READ)


def _refusal(error: EndoctError) -> Outcome:
    where = innermost(error.__traceback__)
    try:
        text = str(error)
        text.encode()
    except Exception as second:  # noqa: BLE001
        return Outcome("message that cannot be printed", where, repr(second))
    if "\n" in text or not text.strip():
        return Outcome("message of several lines", where, text)
    if not text.isprintable():
        return Outcome("message that steers the terminal", where, text)
    if len(text) > LONGEST_MESSAGE:
        return Outcome("message too long", where, text[:500])
    return Outcome(REFUSED, where, text)


def _too_long(error: TooLongError) -> Outcome:
    frames = traceback.extract_tb(error.__traceback__)[:-1]  # without the signal's own
    lines = "".join(traceback.format_list(frames[-25:]))[-6000:]
    at = frames[-1]
    return Outcome("too long", innermost(error.__traceback__), f"{lines}{error}, in {Path(at.filename).name}:{at.name}")


def innermost(trace: TracebackType | None) -> str:
    """Return "module:function" of the innermost frame of endoct in a traceback."""
    where = ""
    while trace is not None:
        frame = trace.tb_frame
        module = str(frame.f_globals.get("__name__", ""))
        if module.startswith("endoct."):
            where = f"{module.removeprefix('endoct.')}:{frame.f_code.co_name}"
        trace = trace.tb_next
    return where


@contextlib.contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    begun, begun_cpu = time.monotonic(), time.process_time()
    idle = 0

    def over(_signal: int, _frame: FrameType | None) -> None:
        nonlocal idle
        wall, cpu = time.monotonic() - begun, time.process_time() - begun_cpu
        idle = idle + 1 if cpu < WAITING * wall else 0
        # others may be at work on the machine, or it stood still as a whole: what counts is this process's time, or
        # that it goes on waiting for nothing
        if cpu >= seconds or idle > 1 or wall > MOST_WAIT * seconds:
            raise TooLongError(f"after {wall:.0f} s, {cpu:.1f} s of them at work")

    before = signal.signal(signal.SIGALRM, over)
    # again each second: what was raised in a place that cannot raise (a destructor) is lost
    signal.setitimer(signal.ITIMER_REAL, seconds, min(seconds, 1.0))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


_watched: list[tuple[str, list[str]]] = []


@contextlib.contextmanager
def _audited(case: Path) -> Iterator[list[str]]:
    """Yield the list of what is opened outside of ``case``, and of what no reader does."""
    _hook()
    events: list[str] = []
    _watched.append((os.path.abspath(case), events))  # noqa: PTH100  links are not followed
    try:
        yield events
    finally:
        _watched.pop()


def _hook() -> None:
    if not getattr(sys, "_endoct_audit", False):
        setattr(sys, "_endoct_audit", True)  # noqa: B010  a hook stays for good, and so must this mark
        sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[object, ...]) -> None:
    if not _watched or (event != "open" and event not in _UNSAFE):
        return
    case, events = _watched[-1]
    if event in ("open", "os.remove", "os.rename"):
        place = arguments[0]
        if not isinstance(place, str | os.PathLike):
            return
        name = os.fspath(place)
        if isinstance(name, bytes):
            return
        whole = os.path.abspath(name)  # noqa: PTH100
        inside = whole == case or whole.startswith(case + os.sep)
        nearby = whole.startswith(str(Path(case).parent) + os.sep)
        outside = whole in _FORBIDDEN or nearby or ("/../" in name and not _loads_machine_code())
        if outside and not inside:
            events.append(f"{event} {name}")
    elif not _loads_machine_code():
        events.append(f"{event} {str(arguments)[:200]}")


def _loads_machine_code() -> bool:
    """Say whether numba is at work: at the first call of a loop it reads its own sources, and pickles beside ours."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).startswith("numba."):
            return True
        frame = frame.f_back
    return False


def _reset_peak() -> None:
    """Make the peak of resident memory what it is now, where the system can (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_bytes() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
