"""Errors of the disk as one line for the user."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from endoct.stitching.errors import EndoctError, system_cause


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
