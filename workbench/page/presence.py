"""Whether what a page shows still lies in its folder, which may be replaced or deleted while the page is open.

An output is known by the digest of its small files, which say what it holds. The page names that digest whenever it
asks for anything, so that it never gets what belongs to another output.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.contents import output_digest, small_files
from endoct.base.files.files import held_folder

if TYPE_CHECKING:  # whoever writes a page serves none
    from starlette.requests import Request
    from starlette.responses import Response

    Answer = Callable[[Request], Response]

NAMED = "of"
"""The part of an address that says which output is meant, by its digest."""

State = tuple[tuple[int, ...], ...]


class Gone(EndoctError):
    """The output that a page shows was replaced or deleted."""


class Origin:
    """The output in ``folder`` as it was when this was made; ``digest`` is what it is known by."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._state = _state_of(folder)
        self._is_gone = False
        self.digest = output_digest(folder)

    def check_present(self) -> None:
        """Raise :class:`Gone` where something else lies in the folder by now, or did when it was last looked at."""
        if not self._is_gone and (state := _state_of(self.folder)) != self._state:
            self._is_gone, self._state = output_digest(self.folder) != self.digest, state
        if self._is_gone:
            raise gone(self.folder)

    @contextmanager
    def held(self) -> Iterator[Path]:
        """Yield a path to the output's own folder, which leads there also if that is moved away meanwhile.

        Raises :class:`Gone` where it does not lie there.
        """
        self.check_present()
        folder = self.folder
        try:
            with held_folder(self.folder) as folder:
                if output_digest(folder) != self.digest:
                    raise gone(self.folder)
                yield folder
        except Gone:
            raise
        except EndoctError as error:
            self.check_present()
            raise type(error)(
                error.what.replace(str(folder), str(self.folder)),
                found=error.found,
                expected=error.expected,
                remedy=error.remedy.replace(str(folder), str(self.folder)),
            ) from error

    def check_named(self, request: "Request") -> None:
        """Raise :class:`Gone` where a request names another output than this."""
        if request.query_params.get(NAMED, self.digest) != self.digest:
            raise gone(self.folder)


def gone(folder: Path) -> Gone:
    """Return the error that says that a page's output is gone."""
    return Gone(
        f"{folder} was replaced or deleted since this page was opened", remedy="load the page anew to see what is there"
    )


def concerning(origin: Origin) -> "Callable[[Answer], Answer]":
    """Have a function that answers requests answer from ``origin`` or, raising :class:`Gone`, not at all."""

    def decorate(answer: "Answer") -> "Answer":
        @functools.wraps(answer)
        def checked(request: "Request") -> "Response":
            origin.check_named(request)
            try:
                response = answer(request)
            except (EndoctError, OSError):
                origin.check_present()  # rather than what is amiss with what lies there now
                raise
            origin.check_present()  # after reading: what was read may be another's
            return response

        return checked

    return decorate


def _state_of(folder: Path) -> State:
    """Return numbers that change with the folder or any of its small files; cheaper than the digest."""
    found = []
    for path in (folder, *small_files(folder)):
        try:
            of = path.stat()
        except OSError:
            continue
        is_folder = path == folder  # whose times and size change with what is saved in it
        found.append((of.st_dev, of.st_ino, *(() if is_folder else (of.st_size, of.st_mtime_ns, of.st_ctime_ns))))
    return tuple(found)
