"""A CT or a segmentation of one, read by SimpleITK: its voxels, and where in the patient they lie.

Coordinates here are LPS as DICOM's: mm to the patient's left, to the back, to the head. A file may use another
convention for its own numbers (NIfTI: RAS); :attr:`CtVolume.coordinates` says which.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.trajectory import Point, Trajectory, as_point
from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import read_start
from endoct.stitching.limits import check_array_size

Convention = Literal["ras", "lps"]
SIGNS: dict[Convention, tuple[float, float, float]] = {"lps": (1.0, 1.0, 1.0), "ras": (-1.0, -1.0, 1.0)}
"""By what x, y and z of LPS are multiplied to have those of a convention."""
SUFFIXES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
EXPECTED = f"a file {', '.join(SUFFIXES)}, or a folder with one DICOM series"
NRRD_SPACES: dict[str, Convention] = {
    "left-posterior-superior": "lps",
    "lps": "lps",
    "right-anterior-superior": "ras",
    "ras": "ras",
}
NRRD_HEADER_BYTES = 64_000
LEAST_HU = -500.0
"""A volume that holds less than that has Hounsfield units."""
MOST_LABELS = 64
LABEL_SIGMA_VOXELS = 0.6
"""Blur of a segmentation: takes its steps, leaves septa of one voxel."""
MOST_APART_VOXELS = 0.1
MOST_SHEAR = 1e-3
"""Cosine between two axes of voxels that counts as a right angle."""


@dataclass(frozen=True, eq=False)
class CtVolume:
    """Voxels (k, j, i) of any number type; voxel [k, j, i] lies at ``origin_mm`` + (k, j, i) · ``steps_mm``, LPS.

    ``coordinates``: what x, y and z mean in that file, or None where it does not say.
    """

    voxels: NDArray[Any]
    origin_mm: Coordinates
    steps_mm: Coordinates
    coordinates: Convention | None


def read_ct(path: Path, stated: Convention | None = None) -> CtVolume:
    """Return the volume in a file or in a folder of DICOM.

    A file that does not say what its coordinates mean is taken to use those that are ``stated``. Raises
    :class:`EndoctError` for what is no such volume, a sheared one, one that needs too much memory, and where
    SimpleITK is not installed.
    """
    if not path.exists():
        raise EndoctError(f"{path} cannot be read", found="no such file", expected=EXPECTED, remedy="check the path")
    itk = _simple_itk()
    image = _series(itk, path) if path.is_dir() else _file(itk, path)
    directions = np.array(image.GetDirection()).reshape(3, 3)  # a column for each axis of voxels: i, j, k
    across = directions.T @ directions - np.eye(3)
    if not np.all(np.isfinite(directions)) or np.abs(across).max() > MOST_SHEAR:
        raise EndoctError(
            f"the voxels of {path} do not lie at right angles",
            found=f"axes with a cosine of {np.abs(across).max():.3g} between them",
            remedy="resample it, as 3D Slicer's Resample Scalar Volume does",
        )
    spacing = np.array(image.GetSpacing())
    origin, steps = np.array(image.GetOrigin()), (directions * spacing).T
    _check_nifti(path, image, origin, steps)
    coordinates = "lps" if path.is_dir() else _convention(path)
    if coordinates is None and stated is not None:
        origin, steps = origin * SIGNS[stated], steps * SIGNS[stated]
    return CtVolume(itk.GetArrayFromImage(image), origin, steps[::-1].copy(), coordinates)


def part_around(ct: CtVolume, places_mm: Coordinates, margin_mm: float) -> CtVolume:
    """Return the part of a volume that holds places (n, 3) LPS, and ``margin_mm`` more, as far as it reaches.

    It has no voxels where the places lie farther away than that.
    """
    index = (places_mm - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)
    margin = margin_mm / np.linalg.norm(ct.steps_mm, axis=1)
    first = np.clip(np.floor(index.min(axis=0) - margin), 0, ct.voxels.shape).astype(int)
    end = np.clip(np.ceil(index.max(axis=0) + margin) + 1, first, ct.voxels.shape).astype(int)
    voxels = ct.voxels[tuple(slice(a, b) for a, b in zip(first, end, strict=True))]
    return CtVolume(voxels, ct.origin_mm + first @ ct.steps_mm, ct.steps_mm, ct.coordinates)


def holds_labels(ct: CtVolume, name: str, remedy: str) -> bool:
    """Whether a volume, called ``name``, holds labels, 0 for air, and not Hounsfield units.

    Raises :class:`EndoctError` with ``remedy`` where that cannot be told.
    """
    least = float(ct.voxels.min())
    if least < LEAST_HU:
        return False
    if least >= 0 and np.issubdtype(ct.voxels.dtype, np.integer) and len(np.unique(ct.voxels)) <= MOST_LABELS:
        return True
    raise EndoctError(
        f"{name} may hold Hounsfield units, or labels",
        found=f"values from {least:g} to {float(ct.voxels.max()):g}",
        expected=f"less than {LEAST_HU:g} somewhere, or at most {MOST_LABELS} whole numbers from 0 on",
        remedy=remedy,
    )


def meaning_of(ct: CtVolume, stated: Convention | None, name: str) -> Convention:
    """Return what coordinates in a volume, called ``name``, mean: what is ``stated``, else what its file says.

    Raises :class:`EndoctError` where neither does.
    """
    meaning = stated or ct.coordinates
    if meaning is None:
        raise EndoctError(
            f"{name} does not say whether its coordinates are RAS or LPS",
            expected="a 'space' of right-anterior-superior or left-posterior-superior",
            remedy="state --coordinates ras or --coordinates lps",
        )
    return meaning


def in_world(place_mm: Point, coordinates: Convention) -> Point:
    """Return a place of LPS in ``coordinates``, or one of these in LPS: the same signs both ways."""
    return as_point(np.array(SIGNS[coordinates]) * place_mm)


def check_within(ct: CtVolume, line: Trajectory, coordinates: Convention, name: str) -> None:
    """Raise :class:`EndoctError` where an end of ``line`` lies outside a volume, called ``name``.

    It gives the numbers in ``coordinates``.
    """
    size = np.array(ct.voxels.shape)
    for end, place in (("entry", line.entry_mm), ("target", line.target_mm)):
        index = (np.array(place) - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)
        if np.all(index >= -0.5) and np.all(index <= size - 0.5):
            continue
        corners = np.stack([ct.origin_mm, ct.origin_mm + (size - 1.0) @ ct.steps_mm]) * SIGNS[coordinates]
        extent = ", ".join(f"{low:.1f} … {high:.1f}" for low, high in np.sort(corners, axis=0).T)
        raise EndoctError(
            f"the {end} lies outside {name}",
            found=", ".join(f"{value:g}" for value in in_world(place, coordinates)),
            expected=f"within {extent} mm ({coordinates.upper()})",
            remedy="check the numbers, and --coordinates",
        )


def _check_nifti(path: Path, image: Any, origin: Coordinates, steps: Coordinates) -> None:
    """Refuse a NIfTI of which ``sform`` and ``qform`` are not both where SimpleITK puts the voxels.

    It passes over a sheared one, and where a file says two things of its place it is not for us to choose.
    """
    stated = {kind for kind in ("sform", "qform") if _nifti_number(image, f"{kind}_code") > 0}
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * (np.array(image.GetSize()) - 1.0)
    places = (corners @ steps + origin) * SIGNS["ras"]
    apart = 0.0
    if "sform" in stated:
        rows = np.array([[float(text) for text in image.GetMetaData(f"srow_{axis}").split()] for axis in "xyz"])
        apart = float(np.abs(corners @ rows[:, :3].T + rows[:, 3] - places).max())
    if "qform" in stated:
        from scipy.spatial.transform import Rotation  # takes a while to load

        vector = np.array([_nifti_number(image, f"quatern_{axis}") for axis in "bcd"])
        turn = Rotation.from_quat([*vector, np.sqrt(max(0.0, 1 - vector @ vector))]).as_matrix()
        at = np.array([_nifti_number(image, f"qoffset_{axis}") for axis in "xyz"])
        qform = (corners * np.linalg.norm(steps, axis=1)) @ turn.T + at
        apart = max(apart, float(np.abs(qform - places).max()))
    if apart > MOST_APART_VOXELS * float(np.linalg.norm(steps, axis=1).min()):
        raise EndoctError(
            f"{path} does not say where its voxels lie",
            found=f"sform and qform {apart:.3g} mm apart, or sheared",
            expected="the same place in both",
            remedy="resample it, or give it one of them only",
        )


def _nifti_number(image: Any, key: str) -> float:
    return float(image.GetMetaData(key)) if image.HasMetaDataKey(key) else 0.0


def _simple_itk() -> Any:
    try:
        import SimpleITK as sitk
    except ImportError:
        raise EndoctError(
            "a CT can only be read where SimpleITK is installed", remedy="pip install 'endoct[ct]'"
        ) from None
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    return sitk


def _file(itk: Any, path: Path) -> Any:
    if not path.name.lower().endswith(SUFFIXES):
        raise EndoctError(f"{path} is no volume", found=path.suffix or "no suffix", expected=EXPECTED)
    reader = itk.ImageFileReader()
    reader.SetFileName(str(path))
    with refusing(f"{path} cannot be read", expected=EXPECTED):
        reader.ReadImageInformation()
        if reader.GetDimension() != 3 or reader.GetNumberOfComponents() != 1:
            found = f"{reader.GetDimension()} dimensions, {reader.GetNumberOfComponents()} numbers a voxel"
            raise EndoctError(f"{path} is no volume", found=found, expected="3 dimensions, a number a voxel")
        check_array_size(reader.GetSize(), _itemsize(itk, reader.GetPixelID()), str(path))
        return reader.Execute()


def _itemsize(itk: Any, pixel: int) -> int:
    text = itk.GetPixelIDValueAsString(pixel)
    return next((bits // 8 for bits in (64, 32, 16, 8) if str(bits) in text), 8)


def _series(itk: Any, folder: Path) -> Any:
    reader = itk.ImageSeriesReader()
    with refusing(f"{folder} cannot be read", expected=EXPECTED):
        series = reader.GetGDCMSeriesIDs(str(folder))
        if len(series) != 1:
            raise EndoctError(
                f"{folder} is no volume",
                found=f"{len(series)} DICOM series" if series else "no DICOM",
                expected="one DICOM series in a folder",
                remedy="put the series into a folder of its own" if series else "",
            )
        names = reader.GetGDCMSeriesFileNames(str(folder), series[0])
        first = itk.ImageFileReader()
        first.SetFileName(names[0])
        first.ReadImageInformation()
        check_array_size((*first.GetSize()[:2], len(names)), _itemsize(itk, first.GetPixelID()), str(folder))
        reader.SetFileNames(names)
        return reader.Execute()


def _convention(path: Path) -> Convention | None:
    """Return what the numbers of a file's own coordinates mean: as its format says, or its ``space`` field.

    SimpleITK turns RAS into LPS and says no more which it was, so the field is looked up in the header.
    """
    name = path.name.lower()
    if name.endswith((".nii", ".nii.gz")):
        return "ras"
    if not name.endswith((".nrrd", ".nhdr")):
        return "lps"
    header = read_start(path, NRRD_HEADER_BYTES).split(b"\n\n")[0].decode("ascii", "replace")
    fields = (line.partition(":")[::2] for line in header.splitlines() if not line.startswith("#"))
    space = next((value.strip().lower() for field, value in fields if field.strip().lower() == "space"), "")
    return NRRD_SPACES.get(space)
