"""Unrolled images on disk: what looks like one, and the stream of its rows.

An image looks like one where its last column continues in its first, which a photograph's does not.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size, entries, exists, inside, is_folder
from endoct.modalities.acquisition import Acquisition, read_keys, sidecar_path
from endoct.modalities.contract import Channel, Frame, Preview, Sniff, inward_positions_mm
from endoct.modalities.reading.logs import is_log, read_log
from endoct.modalities.reading.recording import gives_frames, open_stack
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.unrolled.manifest import TABLE_SUFFIXES, UnrolledAcquisition
from endoct.modalities.unrolled.table import read_table

LEAST_COLUMNS, LEAST_ROWS = 32, 8
MOST_STEP = 1.5
"""From the last column to the first it is no farther than so many times the step between nine in ten neighbours. Four
real holes have 1.0 to 1.1, halves of them 2.2 to 9, and photographs 2 to 24."""
MOST_OPPOSITE = 0.6
"""Nor is it farther than this part of what columns half a turn apart differ by."""
ENDS_SHOW = 0.25
"""They have this part of the image's contrast, so that dark margins do not count."""
AROUND = 40
"""A row is shown with so many on either side."""


@dataclass(frozen=True, eq=False)
class Plane:
    """One file: ``values``, float32 (row, column), NaN where nothing is; ``picture``, as it is stored, perhaps in
    colour; ``z``, float64 (row,), what the first column of a table says, None where that is of the wall."""

    values: Image
    picture: NDArray[Any]
    z: Coordinates | None = None
    remarks: Remarks = NONE


def read_plane(
    path: Path, of: Literal["intensity", "depth"], *, z_column: bool = False, curve: str | None = None
) -> Plane:
    """Return what an image, a stack, a table or a ``curve`` of a log holds; pages of a stack follow each other along z.

    Of colours it is the green, as of an endoscope's frames. Raises :class:`EndoctError` where it cannot be read, or
    shows depth in colours, which have no scale.
    """
    if path.suffix.lower() in TABLE_SUFFIXES:
        table = read_table(path)
        z, table = (table[:, 0], table[:, 1:]) if z_column else (None, table)
        return Plane(table.astype(np.float32), table, z)
    if is_log(path):
        of_log, index = read_log(path, curve)
        return Plane(of_log.astype(np.float32), of_log, index)
    if curve is not None:
        raise EndoctError(f"{path} is no log", remedy=f"leave {of}_curve out")
    if z_column:
        raise EndoctError(
            f"{path} is no table, whose first column could say where rows lie",
            remedy="state row_pitch_mm or positions_mm in place of z_column_mm",
        )
    stack = open_stack(path)
    check_array_size((len(stack), *stack.frame_shape), stack.dtype.itemsize, f"{path}")
    # not by index: a float image may hold NaN where nothing was observed
    pages = [np.asarray(stack.reader(index)) for index in range(len(stack))]
    if any(page.shape[1:] != pages[0].shape[1:] for page in pages):
        raise EndoctError(f"the pages of {path} differ in width", expected="as many columns in each")
    stored = np.concatenate(pages)
    channels = stored.shape[2] if stored.ndim == 3 else 1
    picture = stored[..., :3] if channels > 2 else stored.reshape(*stored.shape[:2], -1)[..., 0]
    if channels > 2 and of == "depth" and (np.ptp(picture, axis=2) != 0).any():
        raise EndoctError(
            f"{path} shows depth in colours, which have no scale", remedy="export it as numbers or as a grey image"
        )
    with np.errstate(over="ignore"):
        values = (picture[..., 1] if channels > 2 else picture).astype(np.float32)
    if channels in (2, 4):
        values = np.where(stored[..., -1] == 0, np.float32(np.nan), values)
    return Plane(values, picture, remarks=stack.remarks)


@dataclass(frozen=True, eq=False)
class UnrolledImage:
    """An opened image; indexing gives a row, float32 (column, channel): intensity, then depth as stored, NaN where
    nothing was observed. ``metadata["around"]`` of a row is the picture about it."""

    acquisition: UnrolledAcquisition
    files: tuple[tuple[Literal["intensity", "depth"], Path], ...]

    @property
    def provides(self) -> frozenset[Channel]:
        """What this recording has, of what others may have."""
        return frozenset(of for of, _ in self.files)

    @property
    def remarks(self) -> Remarks:
        """What is to be said of the files."""
        return sum((plane.remarks for plane in self._planes), NONE)

    def __len__(self) -> int:
        return len(self._samples)

    def __getitem__(self, index: int) -> Frame:
        if not 0 <= index < len(self):
            raise IndexError(index)
        first = max(0, index - AROUND)
        metadata = {"around": self._picture[first : index + AROUND + 1], "first_row": first}
        return Frame(index, self._samples[index], float(self.z_mm[index]), metadata)

    @cached_property
    def z_mm(self) -> Coordinates:
        """Nominal place of every row, float64 (row,), mm, 0 nearest the mouth."""
        a = self.acquisition
        positions = a.positions_mm
        if a.z_column_mm is not None:
            z = self._planes[0].z
            z = np.zeros(0) if z is None else z[self._span("rows", z.size)]
            positions = tuple((a.z_column_mm * z).tolist())
        travel = a.travel
        z_mm = inward_positions_mm(len(self), pitch_mm=a.row_pitch_mm or 0.0, travel=travel, positions_mm=positions)
        if np.unique(z_mm).size != z_mm.size:
            raise EndoctError("two rows lie at one place", remedy="correct positions_mm, or the table's first column")
        return z_mm

    @cached_property
    def _planes(self) -> tuple[Plane, ...]:
        a = self.acquisition
        z_column, curves = a.z_column_mm is not None, {"intensity": a.intensity_curve, "depth": a.depth_curve}
        planes = tuple(read_plane(path, of, z_column=z_column, curve=curves[of]) for of, path in self.files)
        sizes = [plane.values.shape for plane in planes]
        if len(set(sizes)) > 1:
            raise EndoctError(
                "the images of intensity and depth differ in size",
                found=" and ".join(f"{rows} × {columns}" for rows, columns in sizes),
                expected="the same rows and columns in both",
            )
        if len({plane.z.tobytes() for plane in planes if plane.z is not None}) > 1:
            raise EndoctError("the tables of intensity and depth differ in where their rows lie")
        return planes

    @cached_property
    def _samples(self) -> Image:
        a, planes = self.acquisition, self._planes
        samples = np.stack([plane.values for plane in planes], axis=2)
        for value in a.invalid_values:
            samples[samples == np.float32(value)] = np.nan
        samples[~np.isfinite(samples)] = np.nan
        n_rows, n_columns = samples.shape[:2]
        if outside := [column for column in a.dead_columns if column >= n_columns]:
            raise _outside("dead_columns", outside[0], n_columns)
        samples[:, list(a.dead_columns)] = np.nan
        samples = samples[self._span("rows", n_rows), self._span("columns", n_columns)]
        if samples.shape[1] < LEAST_COLUMNS:
            raise EndoctError(
                "an unrolled image has too few columns around the bore",
                found=f"{samples.shape[1]}",
                expected=f"at least {LEAST_COLUMNS}, one turn from the first to the last",
            )
        samples.flags.writeable = False
        return samples

    @property
    def _picture(self) -> NDArray[Any]:
        picture = self._planes[0].picture
        return picture[self._span("rows", picture.shape[0]), self._span("columns", picture.shape[1])]

    def _span(self, key: Literal["rows", "columns"], n: int) -> slice:
        span: tuple[int, int] | None = getattr(self.acquisition, key)
        if span is None:
            return slice(0, n)
        if span[1] >= n:
            raise _outside(key, span[1], n)
        return slice(span[0], span[1] + 1)


def _outside(key: str, place: int, n: int) -> EndoctError:
    return EndoctError(f"'{key}' lies outside the image", found=f"{place}", expected=f"0 to {n - 1}")


def open_image(path: Path, acquisition: Acquisition) -> UnrolledImage:
    """Open the files that the sidecar of ``path`` names; ``path`` is one of them, or their folder.

    Raises :class:`EndoctError` where one is missing or cannot be read, or the sidecar is not of ``path``.
    """
    if not isinstance(acquisition, UnrolledAcquisition):
        raise EndoctError("an unrolled image needs a sidecar of its own", found=type(acquisition).__name__)
    if not exists(path):
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    files = _named(path, acquisition.intensity_file, acquisition.depth_file)
    if not is_folder(path) and all(file != path for _, file in files):
        raise EndoctError(
            f"the sidecar beside {path} is of other files",
            found=" and ".join(file.name for _, file in files),
            expected=path.name,
            remedy="name it as intensity_file or depth_file, or give it a folder and a sidecar of its own",
        )
    image = UnrolledImage(acquisition, files)
    _ = image.z_mm  # what does not fit is refused here, not at the first row
    return image


def _named(
    path: Path, intensity_file: object, depth_file: object
) -> tuple[tuple[Literal["intensity", "depth"], Path], ...]:
    folder = sidecar_path(path).parent
    named: tuple[tuple[Literal["intensity", "depth"], object], ...] = (
        ("intensity", intensity_file),
        ("depth", depth_file),
    )
    return tuple(
        (of, inside(folder, name, f"'{of}_file' in {sidecar_path(path)}")) for of, name in named if name is not None
    )


@np.errstate(over="ignore", invalid="ignore")  # of samples near the largest float
def sniff_image(path: Path) -> Sniff:
    """Claim what a sidecar names, and one image or table whose last column continues in its first."""
    try:
        keys = read_keys(path)
        files = _named(path, keys.get("intensity_file"), keys.get("depth_file"))
        file = files[0][1] if files else _only_file(path)
        if file is None:
            return Sniff(False, "it is no single image and no table")
        of = files[0][0] if files else "intensity"
        curve = keys.get(f"{of}_curve")
        named = curve if isinstance(curve, str) else None
        plane = read_plane(file, of, z_column=keys.get("z_column_mm") is not None, curve=named)
    except EndoctError as error:
        return Sniff(False, str(error))
    rows, columns = plane.values.shape
    size = f"{columns} columns around × {rows} rows along"
    preview = Preview(1, size, str(plane.picture.dtype), (plane.picture,), plane.remarks)
    if files:
        return Sniff(True, f"the sidecar names {file.name} as unrolled", "likely", preview)
    if columns < LEAST_COLUMNS or rows < LEAST_ROWS:
        return Sniff(False, f"its {rows} × {columns} samples are too few for an unrolled wall", preview=preview)
    if not _closes(plane.values):
        return Sniff(False, "its last column does not continue in its first, as in a full turn", preview=preview)
    return Sniff(True, "one image whose last column continues in its first, as in a full turn", "unsure", preview)


def _only_file(path: Path) -> Path | None:
    """Return the file at ``path``, or the only one of a kind that may be an unrolled image in that folder."""
    if is_folder(path):
        likely = [file for file in entries(path) if file.suffix.lower() in TABLE_SUFFIXES or gives_frames(file)]
        return likely[0] if len(likely) == 1 else None
    if path.suffix.lower() in TABLE_SUFFIXES:
        return path
    return path if is_log(path) or (gives_frames(path) and len(open_stack(path)) == 1) else None


def step_over_seam(values: Image) -> tuple[float, float]:
    """Return the step from the last column to the first, over that between neighbours, and over that to half a turn.

    ``values``: (row, column), NaN where nothing is. NaN where the seam is not seen, or nothing differs.
    """
    n = values.shape[1]
    unlike = np.abs(values[:, np.r_[0 : n - 1]] - values[:, 1:])
    seam, opposite = np.abs(values[:, 0] - values[:, -1]), np.abs(values - np.roll(values, n // 2, axis=1))
    seen = np.isfinite(unlike).any(axis=0)
    if not (seen.any() and np.isfinite(seam).any() and np.isfinite(opposite).any()):
        return float("nan"), float("nan")
    usual = float(np.quantile(np.nanmedian(unlike[:, seen], axis=0), 0.9))
    across, over = float(np.nanmedian(seam)), float(np.nanmedian(opposite))
    return across / usual if usual > 0 else float("nan"), across / over if over > 0 else float("nan")


def _closes(values: Image) -> bool:
    ends = values[:, [0, -1]]
    ends = ends[np.isfinite(ends).all(axis=1)]
    if len(ends) < LEAST_ROWS or min(ends.std(axis=0)) < ENDS_SHOW * float(np.nanstd(values)):
        return False
    of_step, of_opposite = step_over_seam(values)
    return of_step <= MOST_STEP and of_opposite <= MOST_OPPOSITE
