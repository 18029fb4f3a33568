"""Files that were dropped on the page of a folder: each appears whole at its place, or not at all."""

import os
from collections.abc import AsyncIterable
from pathlib import Path

from starlette.concurrency import run_in_threadpool

from endoct.base.errors import EndoctError
from endoct.base.files.files import inside
from endoct.base.files.scratch import put_new, scratch_next_to

MOST_PARTS = 12
"""Of a path: as deep as folders are looked through, and more."""


async def take_file(folder: Path, name: str, content: AsyncIterable[bytes]) -> None:
    """Write ``content`` to the file ``name`` below ``folder``, with the folders that are missing.

    Raises :class:`EndoctError` where something lies there already, the path leads elsewhere or is hidden, and where it
    cannot be written.
    """
    place = inside(folder, name, "a dropped file")
    parts = Path(name).parts
    if (
        any(part.startswith(".") for part in parts)
        or len(parts) > MOST_PARTS
        or any(ord(letter) < 32 for letter in name)
    ):
        raise EndoctError("a dropped file cannot be taken", found=name[:80], expected="a plain name, no hidden file")
    if not place.parent.resolve().is_relative_to(folder.resolve()):
        raise EndoctError("a dropped file would leave the folder by a link", found=name[:80])
    if place.exists() or place.is_symlink():
        raise _taken(place)
    try:
        await run_in_threadpool(place.parent.mkdir, parents=True, exist_ok=True)
        with scratch_next_to(place) as scratch, (scratch / "file").open("wb") as file:
            async for part in content:
                await run_in_threadpool(file.write, part)
            file.flush()
            os.fsync(file.fileno())
            file.close()
            put_new(scratch / "file", place)
    except FileExistsError as error:
        raise _taken(place) from error
    except OSError as error:
        raise EndoctError(f"{place} cannot be written", found=error.strerror or str(error)) from error


def _taken(place: Path) -> EndoctError:
    return EndoctError(f"{place} exists already", remedy="rename what you dropped, or move that away")
