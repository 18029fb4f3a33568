"""Image logs of boreholes: LAS 2 and DLIS (RP66 V1), read by lasio and dlisio, which the extra ``logs`` installs.

A row is a depth, by the log's index and its unit. In DLIS an image is a channel of many samples; in LAS it is a curve
for each direction: AMP[1] …, AMP_01 … or AMP00 …. A LAS states its null value, a DLIS does not. LiDAR's .las begin
otherwise. A log of several images needs the name of one. Where the first direction points, and which way they run, no
log says in a way that holds for all tools.
"""

import io
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.compute.worker_process import worker_process
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular, read_small, state_of
from endoct.modalities.reading.format import Files, Format, Frames, Stated

MOST_BYTES = 500_000_000
LEAST_DIRECTIONS = 32
LONGEST_NAME = 80
UNITS_MM = {
    "m": 1000.0, "meter": 1000.0, "metre": 1000.0, "cm": 10.0, "mm": 1.0, "ft": 304.8, "f": 304.8, "feet": 304.8,
    "in": 25.4, "0.1 in": 2.54, "0.1in": 2.54, ".1in": 2.54,
}  # fmt: skip
_DIRECTION = re.compile(r"(.*?)[\[:_(]?(\d+)[\])]?")


def is_log(path: Path) -> bool:
    """Say whether a file begins as a LAS or a DLIS does."""
    try:
        begin = _begin(path)
    except (EndoctError, OSError):
        return False
    return _is_dlis(begin) or _is_las(begin)


def _begin(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(4000) or b""  # None of a file of the system that has nothing to give yet


def read_log(path: Path, curve: str | None = None) -> tuple[Coordinates, Coordinates]:
    """Return the image ``curve`` of a log, the only one where None, and its index in the log's own unit.

    They are float64 (row, direction), NaN where the log has its null, and (row,). Raises :class:`EndoctError` where the
    library is missing, the log cannot be read, or there is no such image, or another one besides.
    """
    images, index, _ = _read(path, tuple(state_of(path).values()))
    named = [values for name, values in images if curve in (None, name)]
    if len(named) != 1:
        names = ", ".join(f"{name[:40]} ({values.shape[1]})" for name, values in images[:8])
        raise EndoctError(
            f"{path} has {'no image' if not images else 'several images' if len(named) > 1 else 'no such image'}",
            found=names or f"no curve of at least {LEAST_DIRECTIONS} directions",
            expected="one" if curve is None else f"'{curve[:40]}'",
            remedy="name one by intensity_curve or depth_curve" if images else "look at what the log holds",
        )
    if index.shape != (len(named[0]),) or not index.size or not np.isfinite(index).all():
        raise EndoctError(f"{path} does not say where its rows lie", expected="one finite depth for each")
    return named[0], index


@lru_cache(maxsize=1)  # what states, looks and reads asks for the same
def _read(path: Path, _state: object) -> tuple[list[tuple[str, Coordinates]], Coordinates, str]:
    try:
        with refusing(f"{path} cannot be read as a log"):
            return _read_dlis_apart(path) if _is_dlis(_begin(path)) else _read_las(path)
    except EndoctError as error:
        if not isinstance(error.__cause__, ImportError):
            raise
        raise EndoctError(
            f"{path} needs a library that is not installed",
            found=f"no {error.__cause__.name}",
            remedy="pip install 'endoct[logs]'",
        ) from error


def _is_las(begin: bytes) -> bool:
    lines = (line.strip() for line in begin.removeprefix(b"\xef\xbb\xbf").splitlines())
    return next((line for line in lines if line and not line.startswith(b"#")), b"")[:2].upper() == b"~V"


def _is_dlis(begin: bytes) -> bool:
    return begin[4:9] == b"V1.00" and begin[9:15] == b"RECORD"


def _read_las(path: Path) -> tuple[list[tuple[str, Coordinates]], Coordinates, str]:
    import lasio

    # not by path: a text in its place could be an address, which lasio fetches
    log = lasio.read(io.StringIO(read_small(path, MOST_BYTES).decode("utf-8", "replace")), mnemonic_case="preserve")
    if not log.curves:
        raise EndoctError(f"{path} has no curves")
    by_name: dict[str, list[tuple[int, Any]]] = {}
    for curve in log.curves[1:]:
        if match := _DIRECTION.fullmatch(curve.mnemonic[:LONGEST_NAME]):
            by_name.setdefault(match[1], []).append((int(match[2]), curve.data))
    images = []
    for name, curves in by_name.items():
        if len(curves) < LEAST_DIRECTIONS:
            continue
        numbers = [number for number, _ in curves]
        if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
            raise EndoctError(f"the curves {name[:40]} of {path} do not count their directions one by one")
        check_array_size((len(curves), len(curves[0][1])), 8, f"{path}")
        images.append((name, np.array([values for _, values in curves], np.float64).T))
    index = np.array(log.curves[0].data, np.float64)
    if "NULL" in log.well:
        index[index == log.well["NULL"].value] = np.nan  # lasio leaves those of the index
    return images, index, str(log.curves[0].unit)


def _read_dlis_apart(path: Path) -> tuple[list[tuple[str, Coordinates]], Coordinates, str]:
    """Return what :func:`_read_dlis` does, in a process of its own: one damaged file in thousands ends dlisio's."""
    import dlisio  # noqa: F401 - where it is missing, that is to be said here

    with worker_process() as apart:
        try:
            return apart.call(_read_dlis, path).result()
        except EndoctError as error:
            if f"{path}" in error.what:
                raise
            raise EndoctError(f"{path} cannot be read as a log", found="dlisio ended over it") from error


def _read_dlis(path: Path) -> tuple[list[tuple[str, Coordinates]], Coordinates, str]:
    from dlisio import dlis

    images: list[tuple[str, Coordinates]] = []
    of_image, index, unit = None, np.zeros(0), ""
    with dlis.load(str(path)) as files:
        for frame in (frame for file in files for frame in file.frames):
            wide = [one for one in frame.channels if len(one.dimension) == 1 and one.dimension[0] >= LEAST_DIRECTIONS]
            if not wide:
                continue
            if of_image is not None:
                raise EndoctError(f"{path} has images in several frames", remedy="export one of them to a file")
            if frame.index_type is None:
                raise EndoctError(f"{path} does not say where its rows lie", found="no index")
            check_array_size((sum(int(np.prod(one.dimension)) for one in frame.channels),), 8, f"{path}")
            of_image = frame
            index, unit = np.asarray(frame.channels[0].curves(), np.float64), str(frame.channels[0].units)
            images = [(one.name, np.asarray(one.curves(), np.float64)) for one in wide]
    return images, index, unit


def _states(files: Files) -> Stated:
    _, _, unit = _read(files[0], tuple(state_of(files[0]).values()))
    unit_mm = UNITS_MM.get(" ".join(unit.lower().split()))
    return Stated({"modality": "unrolled"} | ({} if unit_mm is None else {"z_column_mm": unit_mm}), files[0].name)


def _open(files: Files) -> Frames:
    raise EndoctError(f"{files[0]} is an image log, which holds no frames", remedy='state modality = "unrolled"')


LOGS = Format("an image log (LAS or DLIS)", is_log, _open, _states)
