"""Outputs that appear whole or not at all, and replace nothing but what endoct wrote."""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

from endoct.base.errors import EndoctError, system_cause
from endoct.base.files.contents import Contents, differences, read_contents, remove_listed, seal, sync
from endoct.base.files.files import HELD_FOLDERS, State, state_of
from endoct.base.files.scratch import (
    NEW,
    REPLACED,
    clear_dead_scratch,
    exchange,
    keep_aside,
    put_new,
    remove_or_keep,
    scratch_next_to,
    uninterrupted,
)

OVERWRITE = "choose another output, or replace it with overwrite=True"
MOVE_AWAY = "move that away, or choose another output"

IsOurs = Callable[[Path], bool]
"""Says of a file whether endoct wrote it and nobody changed it since."""


def never(_: Path) -> bool:
    """Say that a file is not endoct's: for outputs that are folders."""
    return False


@dataclass(frozen=True)
class _Judged:
    """An older output that may go: its contents (None for a file), and the state of its files when it was judged."""

    contents: Contents | None
    state: State


@contextmanager
def new_output(
    path: Path, kind: str, *, overwrite: bool = False, inputs: Iterable[Path] = (), is_ours: IsOurs = never
) -> Iterator[Path]:
    """Yield a scratch path; what the caller makes there, a file or a folder, becomes ``path`` if all goes well.

    A folder is sealed with its ``kind`` and contents. An existing output is replaced only with ``overwrite``, and only
    where it is of that kind, holds nothing else and was not changed (a file: where ``is_ours``). At every moment the
    old or the new stands there. Where something else stands there in the end, that stays, and what was made is kept
    next to it. Raises :class:`EndoctError` as :func:`check_output` does, and where ``path`` cannot be written.
    """
    place = check_place(path, inputs)
    with suppress(OSError):  # what a run before this one had to leave, where it was killed
        clear_dead_scratch(place.parent, place.name)
    judged = _judged(place, kind, overwrite, is_ours)
    made_parents = [parent for parent in place.parents if not parent.exists()]
    try:
        with ExitStack() as stack:
            try:
                scratch = stack.enter_context(scratch_next_to(place))
                made = scratch / NEW / place.name
                made.parent.mkdir()
            except OSError as error:
                raise EndoctError(
                    f"{path} cannot be written", found=_cause(error), remedy="choose a folder you may write to"
                ) from error
            try:
                yield made
                seal(made, kind) if made.is_dir() else sync(made)
            except OSError as error:
                raise EndoctError(f"writing {path} failed", found=_cause(error)) from error
            _stand(made, place, scratch, judged)
    finally:
        for parent in made_parents:
            with suppress(OSError):  # not empty: something is there now
                parent.rmdir()


def output_if_any(
    output: Path | str | None, kind: str, *, overwrite: bool, inputs: Iterable[Path]
) -> AbstractContextManager[Path | None]:
    """Return the context of :func:`new_output`, or one that yields None without an ``output``."""
    if output is None:
        return nullcontext()
    return new_output(Path(output), kind, overwrite=overwrite, inputs=inputs)


def check_output(
    path: Path, kind: str, *, overwrite: bool = False, inputs: Iterable[Path] = (), is_ours: IsOurs = never
) -> Path:
    """Return where ``path`` leads, links resolved, if an output of that ``kind`` may be written there.

    Call it before any work is done. Raises :class:`EndoctError` where the path

    - is, contains or lies inside one of the ``inputs``;
    - is or contains the present folder or the user's home;
    - is a mount point or a link to nothing;
    - is there already, unless ``overwrite`` is set and it is what endoct wrote and nothing else.
    """
    place = check_place(path, inputs)
    _judged(place, kind, overwrite, is_ours)
    return place


def check_place(path: Path, inputs: Iterable[Path] = ()) -> Path:
    """Return where ``path`` leads, links resolved. Raises :class:`EndoctError` where no output may ever be.

    A path into a folder that is held open (:func:`~endoct.base.files.files.held_folder`) is returned as it is.
    """
    if path.is_symlink() and not path.exists():
        raise EndoctError(f"{path} is a link to nothing", found=str(path.readlink()), remedy=MOVE_AWAY)
    try:
        place = path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, a name that cannot be
        raise EndoctError(f"{path} cannot be written", found=str(error), remedy="choose another output") from error
    itself, above = _identity(place), _identities(place.parents)
    kept = [(Path.cwd(), "the present folder")]
    with suppress(RuntimeError):  # a user without a home
        kept.append((Path.home(), "your home folder"))
    for folder, what in kept:
        if itself and itself in _identities([folder, *folder.resolve().parents]):
            raise EndoctError(f"the output {path} is or contains {what}", remedy="name a new folder in it")
    for source in inputs:
        resolved = source.resolve()
        if place == resolved or (itself and itself in _identities([resolved, *resolved.parents])):
            raise EndoctError(f"the output {path} is or contains the input {source}", remedy="choose another output")
        if _identity(resolved) in above:
            raise EndoctError(f"the output {path} lies inside the input {source}", remedy="choose another output")
    if os.path.ismount(place):
        raise EndoctError(f"the output {path} is where a disk is mounted", remedy="name a new folder in it")
    return path if path.parent.parent == HELD_FOLDERS else place


def remove_output(path: Path, kind: str) -> None:
    """Remove an output of endoct's that holds nothing else and was not changed; leave anything else as it is."""
    with suppress(EndoctError, OSError):
        judged = _judged(path, kind, True, never)
        if judged is not None and judged.contents is not None:
            remove_listed(path, judged.contents)


def _judged(place: Path, kind: str, overwrite: bool, is_ours: IsOurs) -> _Judged | None:
    """Return what may be replaced, None where nothing is there; raise :class:`EndoctError` where it may not be."""
    if not place.exists():
        return None
    if not overwrite:
        raise EndoctError(f"{place} exists already", remedy=OVERWRITE)
    if place.is_dir():
        with suppress(OSError):  # of a part that was being written anew when its maker was killed
            clear_dead_scratch(place)
    state = state_of(place)
    if not place.is_dir():
        if not is_ours(place):
            raise EndoctError(f"{place} was not written by endoct, or changed since", remedy=MOVE_AWAY)
        return _Judged(None, state)
    contents = read_contents(place)
    if contents is None and next(place.iterdir(), None) is None:
        return _Judged(Contents(kind, {}), state)
    if contents is None:
        some = ", ".join(sorted(entry.name for entry in place.iterdir())[:3])
        raise EndoctError(f"{place} was not written by endoct", found=some, expected=f"a {kind}", remedy=MOVE_AWAY)
    if contents.kind != kind:
        raise EndoctError(
            f"{place} holds something else", found=f"a {contents.kind}", expected=f"a {kind}", remedy=MOVE_AWAY
        )
    different = differences(place, contents)
    if different.altered or different.added:
        raise EndoctError(
            f"{place} holds more than endoct wrote there",
            found=str(different),
            expected=f"nothing but the {kind} as it was written",
            remedy=MOVE_AWAY,
        )
    return _Judged(contents, state)


def _stand(made: Path, place: Path, scratch: Path, judged: _Judged | None) -> None:
    """Put ``made`` in its ``place``. If that fails, both stay: the old one there, and the new one next to it."""
    old = None
    try:
        with uninterrupted():
            if judged is None:
                put_new(made, place)
            else:
                old = _exchanged(made, place, scratch, judged)
    except (OSError, EndoctError) as error:
        try:
            kept = keep_aside(made, place)
        except OSError as also:
            raise EndoctError(f"{place} could neither be put in its place nor kept", found=_cause(also)) from error
        raise EndoctError(
            f"what was made could not become {place}, which stays as it is",
            found=_cause(error),
            remedy=f"the new one is kept in {kept}",
        ) from error
    try:
        sync(place.parent)
    except OSError as error:
        raise EndoctError(f"{place} stands, but may not be on the disk yet", found=_cause(error)) from error
    finally:
        kept_old = None if old is None or judged is None else remove_or_keep(old, place, judged.contents)
        if kept_old is not None:
            raise EndoctError(
                f"{place} was replaced, but not all of the old one could go",
                found="files that were added meanwhile, or may not be removed",
                remedy=f"they are kept in {kept_old}",
            )


def _exchanged(made: Path, place: Path, scratch: Path, judged: _Judged) -> Path:
    """Exchange the two and return where the old one lies; undo that where it is not what was judged."""
    aside = scratch / REPLACED / place.name
    aside.parent.mkdir()
    before = judged.state
    if _below(place, state_of(place)) != _below(place, before):
        raise EndoctError(f"{place} was changed meanwhile")
    old = exchange(made, place, aside)
    # what came out is looked at again: somebody may have come between looking and exchanging
    if _below(old, state_of(old)) != _below(place, before):
        back = exchange(old, place, scratch / "back")
        if back != made:
            back.rename(made)
        raise EndoctError(f"{place} was changed meanwhile")
    return old


def _below(root: Path, state: State) -> State:
    """Return a state by paths below ``root``; of a file alone without the time of its renaming."""
    return {os.path.relpath(name, root): of[:-1] for name, of in state.items()}


def _cause(error: Exception) -> str:
    return system_cause(error) if isinstance(error, OSError) else str(error)


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        of = path.stat()
    except OSError:
        return None
    return of.st_dev, of.st_ino


def _identities(paths: Iterable[Path]) -> set[tuple[int, int]]:
    return {identity for path in paths if (identity := _identity(path)) is not None}
