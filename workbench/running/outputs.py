"""Outputs: their kinds by name, what they state of how they were made, and the text of their JSON."""

import json
import platform
from importlib.metadata import PackageNotFoundError, version

PANORAMA = "panorama"
COMPARISON = "comparison"
FIGURES = "figures"
REPORT = "report"
SPECIMEN = "specimen"
SUMMARY = "summary"
BENCH_RESULTS = "bench results"
SUBMISSION = "submission"
BOARD = "board"
DATA_SET, DATA_SET_FILE = "data set", "dataset.json"
EXPORT = "export"
SIDECAR = "sidecar"
THUMBNAIL = "thumbnail"
POSE = "pose"
CALIBRATION = "calibration"
TUBE = "tube to print"
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
"""Every output states the versions of these."""


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
