"""Which bytes and which versions a result came from."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from endoct.stitching.doubt import Doubt
from endoct.stitching.files import sha256_of

LISTED_FILES = 8
PACKAGES = ("endoct", "numpy", "scipy", "opencv-contrib-python-headless", "PyWavelets", "xarray", "zarr", "tifffile")


def digests(path: Path) -> dict[str, str]:
    """Return sha256 by path of a file, or of the files in a folder.

    Many files share one entry, ``folder/*``: the sha256 over their lines "name sha256" in order of name. Paths are
    as :func:`path_text` gives them.
    """
    if path.is_file():
        return {path_text(path): sha256_of(path)}
    files = sorted(f for f in path.rglob("*") if f.is_file() and not f.name.startswith("."))
    each = {f: sha256_of(f) for f in files}
    if len(each) <= LISTED_FILES:
        return {path_text(f): digest for f, digest in each.items()}
    lines = "".join(f"{path_text(f.relative_to(path).as_posix())} {digest}\n" for f, digest in each.items())
    return {path_text(path / "*"): hashlib.sha256(lines.encode()).hexdigest()}


def doubt_of_inputs(a: Mapping[str, str], b: Mapping[str, str]) -> Doubt | None:
    """Return a doubt where two sides were made from the same files, sidecars left out, as :func:`digests` has them."""
    of_a, of_b = ({digest for name, digest in each.items() if not name.endswith(".toml")} for each in (a, b))
    if not of_a or of_a != of_b:
        return None
    what = (
        "Both sides were made from the same files, so this is a recording compared with itself: how well they agree "
        "says nothing of two recordings."
    )
    return Doubt("compared-with-itself", what)


def path_text(path: Path | str) -> str:
    """Return a path as text that can be stored anywhere: bytes of a name that are no UTF-8 are written as ``\\xe9``."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def json_text(value: object) -> str:
    """Return ``value`` as JSON that can be stored as UTF-8, whatever its texts: half characters become escapes."""
    return json.dumps(value, indent=1, ensure_ascii=False).encode("utf-8", "backslashreplace").decode("utf-8")


def versions() -> dict[str, str]:
    """Return the versions of Python, of endoct and of the libraries that its figures depend on."""
    by_name = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            by_name[package] = version(package)
        except PackageNotFoundError:
            by_name[package] = "not installed"
    return by_name
