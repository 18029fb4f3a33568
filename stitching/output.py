"""Outputs that appear whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from endoct.stitching.errors import EndoctError


@contextmanager
def new_output(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a scratch path beside ``path``; on success it is renamed to ``path``, else removed.

    The scratch path does not exist yet: the caller makes a file or a folder there. Raises
    :class:`EndoctError` where ``path`` exists and ``overwrite`` is not set, or cannot be written.
    """
    path = Path(os.path.abspath(path))  # noqa: PTH100 - resolve() would replace a link by what it points to
    refuse_existing(path, overwrite)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise EndoctError(
            f"{path} cannot be written",
            found=error.strerror or str(error),
            remedy="choose a folder you may write to",
        ) from error
    try:
        try:
            yield scratch / path.name
        except OSError as error:
            raise EndoctError(f"writing {path} failed", found=error.strerror or str(error)) from error
        refuse_existing(path, overwrite)  # somebody else may have written it meanwhile
        if path.exists():
            path.rename(scratch / "replaced")
        (scratch / path.name).rename(path)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def refuse_existing(path: Path, overwrite: bool) -> None:
    """Raise :class:`EndoctError` where ``path`` exists and ``overwrite`` is not set, before work is put into it."""
    if path.exists() and not overwrite:
        raise EndoctError(f"{path} exists already", remedy="choose another output, or say --overwrite")
