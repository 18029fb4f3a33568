"""What lies in a folder, where looking may fail."""

from contextlib import suppress
from pathlib import Path

from endoct.base.errors import EndoctError


def entries(folder: Path) -> list[Path]:
    """Return what lies in ``folder``, but for hidden files. Raises :class:`EndoctError` where it cannot be listed."""
    try:
        return [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise EndoctError(f"{folder} cannot be listed", found=error.strerror or str(error)) from error


def is_folder(path: Path) -> bool:
    """Say whether ``path`` is a folder, as far as it can be seen."""
    with suppress(OSError):
        return path.is_dir()
    return False


def exists(path: Path) -> bool:
    """Say whether there is anything at ``path``, as far as it can be seen."""
    with suppress(OSError):
        return path.exists()
    return False
