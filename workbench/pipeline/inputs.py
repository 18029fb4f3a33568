"""Which bytes and which versions a result came from."""

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from endoct.base.doubt import Doubt

PACKAGES = (
    "endoct",
    "numpy",
    "scipy",
    "numba",
    "opencv-contrib-python-headless",
    "PyWavelets",
    "xarray",
    "zarr",
    "tifffile",
)


def doubt_of_inputs(a: Mapping[str, str], b: Mapping[str, str]) -> Doubt | None:
    """Return a doubt where two sides were made from the same files, sidecars left out.

    ``a`` and ``b`` are as :func:`~endoct.base.files.files.digests` has them.
    """
    of_a, of_b = ({digest for name, digest in each.items() if not name.endswith(".toml")} for each in (a, b))
    if not of_a or of_a != of_b:
        return None
    what = (
        "Both sides were made from the same files, so this is a recording compared with itself: how well they agree "
        "says nothing of two recordings."
    )
    return Doubt("compared-with-itself", what)


def json_text(value: object) -> str:
    """Return ``value`` as JSON that can be stored as UTF-8, whatever its texts: half characters become escapes."""
    return json.dumps(value, indent=1, ensure_ascii=False).encode("utf-8", "backslashreplace").decode("utf-8")


def versions(*also: str) -> dict[str, str]:
    """Return the versions of Python, of endoct, of the libraries that its figures depend on, and ``also`` of others."""
    by_name = {"python": platform.python_version()}
    for package in (*PACKAGES, *also):
        try:
            by_name[package] = version(package)
        except PackageNotFoundError:
            by_name[package] = "not installed"
    return by_name
