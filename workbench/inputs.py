"""Which bytes and which versions a result came from."""

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

LISTED_FILES = 8
PACKAGES = ("endoct", "numpy", "scipy", "opencv-contrib-python-headless", "PyWavelets", "xarray", "zarr", "tifffile")


def digests(path: Path) -> dict[str, str]:
    """Return sha256 by path of a file, or of the files in a folder.

    Many files share one entry, ``folder/*``: the sha256 over their lines "name sha256" in order of name.
    """
    if path.is_file():
        return {str(path): _sha256(path)}
    files = sorted(f for f in path.rglob("*") if f.is_file() and not f.name.startswith("."))
    each = {str(f): _sha256(f) for f in files}
    if len(each) <= LISTED_FILES:
        return each
    lines = "".join(f"{Path(name).relative_to(path).as_posix()} {digest}\n" for name, digest in each.items())
    return {str(path / "*"): hashlib.sha256(lines.encode()).hexdigest()}


def versions() -> dict[str, str]:
    """Return the versions of Python, of endoct and of the libraries that its figures depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
