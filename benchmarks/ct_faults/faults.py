"""Faults of CT volumes as people have them, each drawn at random in its place and size.

Each function writes one volume with a fault into a folder, and returns its path. What is said of a fault after that is
in :mod:`benchmarks.ct_faults.trial`.
"""

import gzip
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import nibabel
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.ct_faults.drawn import Drawn, named_slices
from benchmarks.ct_faults.writing import (
    ROOT,
    SECONDARY,
    enhanced,
    metaimage_header,
    nifti,
    nrrd_header,
    save,
    write_metaimage,
    write_nrrd,
    write_series,
    write_slice,
)

Written = tuple[Path, Drawn]
"""Where it lies, and what a right reading of it is."""
Write = Callable[[Path, Drawn, Random], Written]
Slices = list[dict[str, Any]]
NONE_NUMBERS = ("nan", "inf", "-inf", "1e400")


def _series(change: Callable[[Slices, Drawn, Random], Slices | None]) -> Write:
    """Return what writes a series whose slices were changed."""

    def write(folder: Path, volume: Drawn, rng: Random) -> Written:
        slices = named_slices(volume)
        return write_series(folder / "series", change(slices, volume, rng) or slices), volume

    return write


def _frames(change: Callable[[Slices, Drawn, Random], Slices | None]) -> Write:
    """Return what writes an enhanced CT whose slices were changed."""

    def write(folder: Path, volume: Drawn, rng: Random) -> Written:
        slices = named_slices(volume)
        save(enhanced(change(slices, volume, rng) or slices), folder / "enhanced.dcm")
        return folder / "enhanced.dcm", volume

    return write


def missing(slices: Slices, volume: Drawn, rng: Random) -> Slices:
    first = rng.randint(1, len(slices) - 3)
    return slices[:first] + slices[first + rng.randint(1, len(slices) - 2 - first) :]


def two_spacings(slices: Slices, volume: Drawn, rng: Random) -> None:
    first, factor = rng.randint(2, len(slices) - 2), rng.choice((0.5, 0.9, 1.1, 1.5, 2.0, 3.0))
    for k, one in enumerate(slices[first:], first):
        one["ImagePositionPatient"] = volume.position(first - 1 + (k - first + 1) * factor).tolist()


def moved(slices: Slices, volume: Drawn, rng: Random) -> None:
    one, direction = rng.choice(slices), np.array([rng.gauss(0, 1) for _ in range(3)])
    by = 10 ** rng.uniform(-1.4, 1) * direction / np.linalg.norm(direction)
    one["ImagePositionPatient"] = (np.array(one["ImagePositionPatient"]) + by).tolist()


def turned(slices: Slices, volume: Drawn, rng: Random) -> None:
    one = rng.choice(slices)
    turn = Rotation.from_rotvec([rng.gauss(0, 1) for _ in range(3)], degrees=False)
    turn = Rotation.from_rotvec(turn.as_rotvec() / turn.magnitude() * math.radians(10 ** rng.uniform(-0.3, 1.9)))
    one["ImageOrientationPatient"] = [*turn.apply(volume.row), *turn.apply(volume.column)]


def other_pixels(slices: Slices, volume: Drawn, rng: Random) -> None:
    factor = rng.choice((0.5, 0.97, 1.02, 2.0))
    rng.choice(slices)["PixelSpacing"] = [factor * one for one in volume.spacing]


def other_size(slices: Slices, volume: Drawn, rng: Random) -> None:
    one = rng.choice(slices)
    one["values"] = one["values"][: rng.randint(3, 8), : rng.randint(3, 8)]


def copied_file(slices: Slices, volume: Drawn, rng: Random) -> Slices:
    return [*slices, rng.choice(slices) | {"name": "copy.dcm"}]


def copied_voxels(slices: Slices, volume: Drawn, rng: Random) -> None:
    one, other = rng.sample(slices, 2)
    one["values"] = other["values"]


def swapped(slices: Slices, volume: Drawn, rng: Random) -> None:
    one, other = rng.sample(slices, 2)
    key = "ImagePositionPatient"
    one[key], other[key] = other[key], one[key]


def scout(slices: Slices, volume: Drawn, rng: Random) -> Slices:
    values = slices[0]["values"] if rng.random() < 0.5 else np.zeros((20, 11), np.int16)
    image_type = rng.choice((["ORIGINAL", "PRIMARY", "LOCALIZER"], None))
    place = volume.place(rng.uniform(-9, 9), rng.uniform(-30, 30), 0).tolist()
    axes = [*volume.row, *-volume.normal]
    return [
        slices[0] | {"name": "IM.dcm", "values": values, "ImageType": image_type, "ImagePositionPatient": place,
                     "ImageOrientationPatient": axes, "InstanceNumber": rng.choice((0, 1, 99))},
        *slices,
    ]  # fmt: skip


def second_volume(slices: Slices, volume: Drawn, rng: Random) -> Slices:
    by = rng.choice((0.0, 0.5, 0.5, 0.3, len(slices) + 1.5, -len(slices) / 2))
    numbered = rng.choice((0, len(slices)))
    kernel = rng.choice((None, "H60s"))
    more = [
        one
        | {"name": f"B{k}.dcm", "values": one["values"] // 2 - 500, "InstanceNumber": k + 1 + numbered,
           "ImagePositionPatient": volume.position(k + by).tolist(), "ConvolutionKernel": kernel}
        for k, one in enumerate(slices)
    ]  # fmt: skip
    return [*slices, *more]


def _tilted(folder: Path, volume: Drawn, rng: Random) -> Written:
    """A tilted gantry, which the header calls so, or not."""
    angle = rng.choice((-1, 1)) * rng.uniform(1, 28)
    tilted = replace(volume, aside=volume.between * math.tan(math.radians(angle)))
    stated = rng.choice((f"{angle:.4f}", f"{-angle:.4f}", None))
    slices = [one | {"GantryDetectorTilt": stated} for one in named_slices(tilted)]
    return write_series(folder / "series", slices), tilted


def lacking(slices: Slices, volume: Drawn, rng: Random) -> None:
    key = rng.choice(("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "RescaleIntercept"))
    for one in slices if rng.random() < 0.5 and key != "RescaleIntercept" else [rng.choice(slices)]:
        one[key] = None


def no_numbers(slices: Slices, volume: Drawn, rng: Random) -> None:
    one, key = rng.choice(slices), rng.choice(("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing"))
    values = [f"{value:.8g}" for value in one[key]]
    values[rng.randrange(len(values))] = rng.choice(
        ("nan", "inf", "-1e9") if key != "PixelSpacing" else ("nan", "0", "-0.4")
    )
    one[key] = values


def other_series(slices: Slices, volume: Drawn, rng: Random) -> None:
    key = rng.choice(("SeriesInstanceUID", "FrameOfReferenceUID", "StudyInstanceUID"))
    for one in rng.sample(slices, rng.randint(1, len(slices) // 2)):
        one[key] = f"{ROOT}.77"


def meaning(slices: Slices, volume: Drawn, rng: Random) -> None:
    kind = rng.choice(("PALETTE COLOR", "RGB", "slope", "slope of 0", "intercept"))
    for one in slices if rng.random() < 0.5 and kind != "intercept" else [rng.choice(slices)]:
        if kind in ("PALETTE COLOR", "RGB"):
            one["PhotometricInterpretation"] = kind
        else:
            one |= {
                "slope": {"RescaleSlope": "nan"},
                "slope of 0": {"RescaleSlope": 0},
                "intercept": {"RescaleIntercept": 300},
            }[kind]


def _file_damaged(folder: Path, volume: Drawn, rng: Random) -> Written:
    series = write_series(folder / "series", named_slices(volume))
    path = rng.choice(sorted(series.iterdir()))
    kind = rng.choice(("empty", "cut", "cut", "cut", "link", "pipe", "noise"))
    data = path.read_bytes()
    if kind == "cut":
        path.write_bytes(data[: rng.randrange(1, len(data) - 1)])
    elif kind == "noise":
        path.write_bytes(rng.randbytes(len(data)))
    elif kind == "empty":
        path.write_bytes(b"")
    else:
        path.unlink()
        path.symlink_to("nowhere.dcm") if kind == "link" else os.mkfifo(path)
    return series, volume


def _secondary_capture(folder: Path, volume: Drawn, rng: Random) -> Written:
    elements = {"values": volume.voxels[0], "SOPClassUID": SECONDARY, "NumberOfFrames": len(volume.voxels)}
    write_slice(folder / "a.dcm", 1, elements | {"PixelData": volume.voxels.astype("<i2").tobytes()})
    return folder / "a.dcm", volume


def _value_shift(folder: Path, volume: Drawn, rng: Random) -> Written:
    """Values shifted by some 1000, or inverted, in any container."""
    kind = rng.choice((1000, 1024, -1000, -1024, 400, "inverted"))
    values = volume.voxels.astype(np.int32)
    changed = (-values if kind == "inverted" else values + int(kind)).astype(np.int16)
    return rng.choice(list(SOUND.values()))(folder, replace(volume, voxels=changed), rng)[0], volume


NIFTI_KINDS = (
    "no codes", "units", "qform apart", "nan", "zero row", "pixdim", "shear", "time", "offset", "cut", "bits",
)  # fmt: skip


def _nifti_fault(folder: Path, volume: Drawn, rng: Random) -> Written:
    path, image = folder / rng.choice(("ct.nii", "ct.nii.gz")), nifti(volume)
    kind = rng.choice(NIFTI_KINDS)
    if kind == "qform apart":
        other = image.get_sform()
        other[rng.randrange(3), 3] += rng.choice((-1, 1)) * 10 ** rng.uniform(-1.5, 2)
        image.set_qform(other, 1)
    elif kind == "shear":
        matrix, at = image.get_sform(), rng.randrange(3)
        matrix[:3, at] += 0.2 * matrix[:3, (at + 1) % 3]
        image.set_sform(matrix, 1)
    elif kind == "time":
        image = nibabel.Nifti1Image(np.stack([volume.voxels.transpose()] * 2, -1), image.affine, image.header)
    nibabel.save(image, path)
    if kind in ("cut", "bits"):
        _damage(path, rng, 360, cut=kind == "cut" or path.suffix != ".gz")
    else:
        _edit_nifti(path, kind, rng)
    return path, volume


def _edit_nifti(path: Path, kind: str, rng: Random) -> None:
    """Change fields of a header as it lies in the file."""
    whole = path.read_bytes()
    packed = path.suffix == ".gz"
    content = gzip.decompress(whole) if packed else whole
    header: Any = nibabel.Nifti1Header(content[:348], check=False)
    if kind == "no codes":
        header["sform_code"] = header["qform_code"] = 0
    elif kind == "units":
        header["xyzt_units"] = rng.choice((1, 3, 4, 7))
    elif kind == "nan":
        key = rng.choice(("quatern_b", "quatern_c", "qoffset_x", "srow_x", "srow_z"))
        header[key] = float(rng.choice(NONE_NUMBERS[:3]))
        header["sform_code" if key.startswith("q") else "qform_code"] = rng.choice((0, 1))
    elif kind == "zero row":
        header[rng.choice(("srow_x", "srow_y", "srow_z"))] = 0
        header["qform_code"] = rng.choice((0, 1))
    elif kind == "pixdim":
        header["pixdim"][rng.randint(1, 3)] *= rng.choice((0, 0.5, 1.2, 2, -3))
        header["qform_code"] = rng.choice((0, 1))
    elif kind == "shear":
        header["qform_code"] = rng.choice((0, 1))
    elif kind == "offset":
        header["vox_offset"] = rng.choice((0, 348, 354, 384, 500))
    changed = header.binaryblock + content[348:]
    path.write_bytes(gzip.compress(changed) if packed else changed)


def _nrrd_fault(folder: Path, volume: Drawn, rng: Random) -> Written:
    header = nrrd_header(volume)
    data = volume.voxels.astype("<i2").tobytes()
    kind = rng.choice(
        (
            "no space",
            "no origin",
            "no directions",
            "none",
            "units",
            "zero",
            "nan",
            "shear",
            "cut",
            "data",
            "type",
            "endian",
        )
    )
    directions = header["space directions"].split()
    if kind in ("no space", "no origin", "no directions"):
        del header[{"no space": "space", "no origin": "space origin", "no directions": "space directions"}[kind]]
        if kind == "no space":
            header = {"type": header.pop("type"), "dimension": header.pop("dimension"), "space dimension": "3"} | header
        if kind == "no directions":
            header["spacings"] = "0.3 0.3 0.3"
    elif kind in ("none", "zero", "nan"):
        vector = {"none": "none", "zero": "(0,0,0)", "nan": "(nan,0,1)"}[kind]
        directions[rng.randrange(3)] = vector
        header["space directions"] = " ".join(directions)
    elif kind == "units":
        header["space units"] = rng.choice(
            ('"um" "um" "um"', '"furlong" "furlong" "furlong"', '"mm" "um" "mm"', '"m" "m" "m"')
        )
    elif kind == "shear":
        steps = volume.to_lps[:3, :3].T.copy()
        at = rng.randrange(3)
        steps[at] += 0.2 * steps[(at + 1) % 3]
        header["space directions"] = " ".join("(" + ",".join(f"{x:.12g}" for x in step) + ")" for step in steps)
    elif kind == "cut":
        data = data[: rng.randrange(len(data))]
    elif kind == "data":
        (folder / "below").mkdir()
        (folder / "below" / "x.raw").write_bytes(data)
        header |= {
            "encoding": "raw",
            "data file": rng.choice(("below/x.raw", "/etc/passwd", "../x.raw", "LIST", "x%03d.raw 1 9 1")),
        }
    elif kind == "type":
        header["type"] = rng.choice(("char", "float", "block", "uchar", "int"))
    elif kind == "endian":
        header |= {"endian": "middle"}
    return write_nrrd(folder / "ct.nrrd", header, data), volume


def _metaimage_fault(folder: Path, volume: Drawn, rng: Random) -> Written:
    header, data = metaimage_header(volume), volume.voxels.astype("<i2").tobytes()
    kind = rng.choice(
        ("no spacing", "no offset", "no matrix", "dimensions", "zero", "nan", "cut", "type", "file", "units", "twice")
    )
    if kind.startswith("no "):
        del header[{"spacing": "ElementSpacing", "offset": "Offset", "matrix": "TransformMatrix"}[kind[3:]]]
    elif kind == "dimensions":
        header["NDims"] = rng.choice(("2", "4", "11", "999", "-1", "x"))
    elif kind == "zero":
        key = rng.choice(("TransformMatrix", "ElementSpacing"))
        header[key] = " ".join(["0"] * 3 + header[key].split()[3:])
    elif kind == "nan":
        key = rng.choice(("TransformMatrix", "ElementSpacing", "Offset"))
        values = header[key].split()
        values[rng.randrange(len(values))] = rng.choice(NONE_NUMBERS)
        header[key] = " ".join(values)
    elif kind == "cut":
        data = data[: rng.randrange(len(data))]
    elif kind == "type":
        header["ElementType"] = rng.choice(("MET_UCHAR", "MET_FLOAT", "MET_STRING", "MET_SHORT_ARRAY"))
    elif kind == "file":
        header["ElementDataFile"] = rng.choice(("/etc/passwd", "../x.raw", "LIST", "x%03d.raw 1 9 1", ""))
    elif kind == "units":
        header = {"DistanceUnits": rng.choice(("um", "furlong", "m"))} | header
    elif kind == "twice":
        header = {"offset": "0 0 0"} | header
    return write_metaimage(folder / "ct.mha", header, data), volume


def _damage(path: Path, rng: Random, least: int, *, cut: bool) -> None:
    data = bytearray(path.read_bytes())
    if cut:
        del data[rng.randrange(min(least, len(data) - 1), len(data)) :]
    else:
        data[rng.randrange(20, len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def _sound_series(folder: Path, volume: Drawn, rng: Random) -> Written:
    slices = named_slices(volume)
    for one, name in zip(slices, rng.sample(range(1000), len(slices)), strict=True):
        one["name"] = f"{name}"
    return write_series(folder / "series", slices), volume


def _sound_enhanced(folder: Path, volume: Drawn, rng: Random) -> Written:
    save(enhanced(named_slices(volume)), folder / "enhanced.dcm")
    return folder / "enhanced.dcm", volume


def _sound_nifti(folder: Path, volume: Drawn, rng: Random) -> Written:
    path = folder / rng.choice(("ct.nii", "ct.nii.gz"))
    nibabel.save(nifti(volume), path)
    return path, volume


def _sound_nrrd(folder: Path, volume: Drawn, rng: Random) -> Written:
    return write_nrrd(folder / "ct.nrrd", nrrd_header(volume), volume.voxels.astype("<i2").tobytes()), volume


def _sound_metaimage(folder: Path, volume: Drawn, rng: Random) -> Written:
    return write_metaimage(folder / "ct.mha", metaimage_header(volume), volume.voxels.astype("<i2").tobytes()), volume


SOUND: Mapping[str, Write] = {
    "dicom": _sound_series,
    "enhanced": _sound_enhanced,
    "nifti": _sound_nifti,
    "nrrd": _sound_nrrd,
    "metaimage": _sound_metaimage,
}
FAULTS: Mapping[str, Write] = {
    "missing slices": _series(missing),
    "two spacings": _series(two_spacings),
    "a slice moved": _series(moved),
    "a slice turned": _series(turned),
    "another pixel spacing": _series(other_pixels),
    "another size": _series(other_size),
    "a file copied": _series(copied_file),
    "voxels copied": _series(copied_voxels),
    "slices swapped": _series(swapped),
    "a scout": _series(scout),
    "a second volume": _series(second_volume),
    "a tilted gantry": _tilted,
    "something lacking": _series(lacking),
    "no numbers": _series(no_numbers),
    "another series": _series(other_series),
    "another meaning": _series(meaning),
    "a file damaged": _file_damaged,
    "frames missing": _frames(missing),
    "frames of two spacings": _frames(two_spacings),
    "a frame moved": _frames(moved),
    "frames twice": _frames(copied_file),
    "secondary capture": _secondary_capture,
    "values shifted": _value_shift,
    "NIfTI": _nifti_fault,
    "NRRD": _nrrd_fault,
    "MetaImage": _metaimage_fault,
}
