"""Slices and pictures whose headers and samples are drawn element by element, sound or contradicting each other.

What is right is known before anything is written: numbers are drawn, then stored in the bits, order, sign, colours and
coding that were drawn for them. Written by pydicom, coded by its RLE and by imagecodecs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from pydicom.config import disable_value_validation
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate, encapsulate_extended
from pydicom.pixels.encoders import RLELosslessEncoder
from pydicom.pixels.processing import convert_color_space

from benchmarks.ct_faults.writing import CT, ROOT
from benchmarks.fuzz.dicom_writer import CAPTURES

IMPLICIT, EXPLICIT, DEFLATED, BIG, RLE, JPEG, LOSSLESS, LS, J2K = (
    f"1.2.840.10008.1.2{end}" for end in ("", ".1", ".1.99", ".2", ".5", ".4.50", ".4.70", ".4.80", ".4.90")
)
AIR_HU = -1000
SHAPE = (5, 7)
OF_CT = ("rows", "columns", "left", "sign", "precision", "beyond", "picture", "cut", "part")
"""What contradicts what in a CT; one of these, or nothing."""
OF_PICTURES = ("frames", "jfif", "adobe", "subsampled", "planes", "table", "transform", "cut")


@dataclass(frozen=True, eq=False)
class Coded:
    """What was written to ``path``: the frames that are right, whether header and samples agree, and what was drawn."""

    path: Path
    truth: NDArray[Any]
    sound: bool
    lossy: bool
    said: str


def _dataset(frames: int, shape: tuple[int, ...], elements: Mapping[str, Any]) -> Dataset:
    made = Dataset()
    usual = {"SOPInstanceUID": f"{ROOT}.9.1", "PatientID": "0", "StudyInstanceUID": f"{ROOT}.2"}
    usual |= {"SeriesInstanceUID": f"{ROOT}.1", "FrameOfReferenceUID": f"{ROOT}.3", "InstanceNumber": 1}
    size = {"Rows": shape[0], "Columns": shape[1], "SamplesPerPixel": 1 if len(shape) == 2 else 3}
    size |= {"NumberOfFrames": frames} if frames > 1 else {}
    with disable_value_validation():
        for keyword, value in (usual | size | dict(elements)).items():
            if value is not None and keyword.startswith("PixelPadding"):  # US, whatever the sign of the samples
                made.add_new(keyword, "US", value)
            elif value is not None:
                setattr(made, keyword, value)
    return made


def _save(made: Dataset, path: Path, syntax: str, kind: str, meta: str = "whole") -> None:
    """Write a file; ``meta``: its meta header is whole, says nothing of the syntax, or is not there."""
    made.file_meta = FileMetaDataset()
    made.file_meta.TransferSyntaxUID = syntax
    made.file_meta.MediaStorageSOPClassUID, made.file_meta.MediaStorageSOPInstanceUID = made.SOPClassUID, ROOT
    made["PixelData"].VR = kind
    made["PixelData"].is_undefined_length = syntax not in (IMPLICIT, EXPLICIT, DEFLATED, BIG)
    with disable_value_validation():
        made.save_as(path, enforce_file_format=True)
    data = path.read_bytes()
    if meta == "none":
        path.write_bytes(data[144 + int.from_bytes(data[140:144], "little") :])
    elif meta == "no syntax":
        at = data.index(b"\x02\x00\x10\x00UI")
        end = at + 8 + int.from_bytes(data[at + 6 : at + 8], "little")
        length = int.from_bytes(data[140:144], "little") - (end - at)
        path.write_bytes(data[:140] + length.to_bytes(4, "little") + data[144:at] + data[end:])


def _plain(words: NDArray[Any], syntax: str, kind: str) -> bytes:
    data = words.astype(words.dtype.newbyteorder(">" if syntax == BIG else "<")).tobytes()
    data += bytes(len(data) % 2)
    if syntax == BIG and kind == "OW" and words.itemsize == 1:
        return np.frombuffer(data, "u2").byteswap().tobytes()
    return data


def _coded(words: NDArray[Any], syntax: str, bits: int, **how: Any) -> bytes:
    """Return one frame as its codec writes it, in ``bits``."""
    words = np.ascontiguousarray(words)
    if syntax == LS:
        return bytes(imagecodecs.jpegls_encode(words))
    if syntax == LOSSLESS:
        return bytes(imagecodecs.jpeg_encode(words, lossless=True, predictor=1, bitspersample=bits))
    if syntax == J2K:
        return bytes(
            imagecodecs.jpeg2k_encode(words, level=0, reversible=True, codecformat="j2k", bitspersample=bits, **how)
        )
    rows, columns, *samples = words.shape
    return bytes(
        RLELosslessEncoder.encode(
            words.tobytes(), index=0, rows=rows, columns=columns, samples_per_pixel=samples[0] if samples else 1,
            number_of_frames=1, bits_allocated=8 * words.itemsize, bits_stored=8 * words.itemsize,
            pixel_representation=0, planar_configuration=0,
            photometric_interpretation="RGB" if samples else "MONOCHROME2",
        )
    )  # fmt: skip


def _encapsulated(made: Dataset, frames: list[bytes], rng: Random) -> None:
    """Put coded frames into a dataset, in one fragment each or several, with a table of any kind."""
    table = rng.choice(("basic", "extended", "none"))
    if table == "extended":
        made.PixelData, made.ExtendedOffsetTable, made.ExtendedOffsetTableLengths = encapsulate_extended(frames)
    else:
        pieces = rng.choice((1, 3)) if table == "basic" or len(frames) == 1 else 1
        made.PixelData = encapsulate(frames, fragments_per_frame=pieces, has_bot=table == "basic")


def ct(folder: Path, rng: Random) -> Coded:
    """Write a CT of three slices."""
    noise = np.random.default_rng(rng.randrange(2**32))
    syntax = rng.choice((IMPLICIT, EXPLICIT, BIG, RLE, LOSSLESS, LS, J2K) * 4 + (DEFLATED,))
    plain, signed = syntax in (IMPLICIT, EXPLICIT, BIG, DEFLATED), rng.random() < 0.5
    allocated = 32 if plain and rng.random() < 0.1 else 16
    stored = rng.choice((12, 12, 13, 14, 16, 16))
    high = rng.choice((stored - 1, stored - 1, allocated - 1)) if plain or syntax == RLE else stored - 1
    fault = rng.choice(OF_CT) if rng.random() < 0.5 else ""
    slope = rng.choice((1, 1, 0.5))
    intercept = 0 if signed else -1024
    numbers = noise.integers(-1020 - intercept, 1000 - intercept, (3, *SHAPE))
    numbers[:, 2, 3] = 2000 - intercept
    truth = numbers * slope + intercept
    header: dict[str, Any] = {}
    if fault != "beyond" and rng.random() < 0.4:
        low = rng.choice((-2000, -1500)) if signed else rng.choice((0, 63536 if stored == 16 else 1))
        limit = low + rng.choice((0, 2))
        numbers[:, 0, :2], truth[:, 0, :2] = [low, limit], AIR_HU
        as_written = [end & 0xFFFF for end in (low, limit)]
        header["PixelPaddingValue"] = as_written[0]
        header["PixelPaddingRangeLimit"] = as_written[1] if limit > low else None
    spare, shift = allocated - stored, high + 1 - stored
    words = (numbers & ((1 << stored) - 1)) << shift
    fill = rng.choice(("zeros", "sign", "anything")) if plain or syntax == RLE else "zeros"
    if spare and not shift and fill != "zeros":
        over = noise.integers(0, 1 << min(spare, 16), words.shape) if fill == "anything" else -1 * (numbers < 0)
        words |= (over << stored) & ((1 << allocated) - 1)
    words = words.astype(f"u{allocated // 8}")
    coded, in_words = not plain and syntax != RLE, plain or syntax == RLE
    applies = {
        "left": in_words and stored < allocated and not shift,
        "sign": syntax == J2K,
        "precision": syntax in (LOSSLESS, J2K) and stored < 16,
        "beyond": coded and stored < 16,
        "picture": not plain,
    }
    fault = fault if applies.get(fault, True) else ""
    bits = rng.choice((stored, 16)) if syntax != LS else 16
    meta = rng.choice(("whole", "whole", "no syntax", "none")) if syntax in (IMPLICIT, EXPLICIT, BIG) else "whole"
    says_signed, stream_signed = signed, signed
    if fault == "sign":
        says_signed, stream_signed = not signed, signed
        if not signed or rng.random() < 0.5:
            says_signed, stream_signed = signed, not signed
    for k in range(3):
        made = _dataset(
            1, SHAPE, {
                "SOPClassUID": CT, "Modality": "CT", "PhotometricInterpretation": "MONOCHROME2",
                "InstanceNumber": k + 1, "ImagePositionPatient": [0, 0, k], "PixelSpacing": [1, 1],
                "ImageOrientationPatient": [1, 0, 0, 0, 1, 0], "BitsAllocated": allocated, "BitsStored": stored,
                "HighBit": high, "PixelRepresentation": int(says_signed), "RescaleSlope": slope,
                "RescaleIntercept": intercept, "SliceThickness": 1, **header,
            },
        )  # fmt: skip
        one = words[k]
        if fault == "rows":
            made.Rows += rng.choice((-1, 1))
        elif fault == "columns":
            made.Columns += rng.choice((-1, 1))
        elif fault == "part":
            made.InConcatenationNumber, made.InConcatenationTotalNumber = k + 1, 4
        if fault == "left":
            made.HighBit = allocated - 1
        if fault == "beyond":
            one, bits = one | np.uint16(1 << stored), 16
        if fault == "precision":
            bits, made.BitsStored, made.HighBit = stored, 16, 15
        if fault == "picture":
            one = one[:4]
        if plain:
            made.PixelData = _plain(one, syntax, "OW")
        else:
            if syntax == J2K and stream_signed:
                one = (one.astype(np.int16) << (16 - stored)) >> (16 - stored)
            elif syntax == J2K and fault == "sign":  # two's complements under a stream without a sign
                bits = stored
            _encapsulated(made, [_coded(one, syntax, bits)], rng)
        path = folder / f"{k}.dcm"
        _save(made, path, syntax, "OW" if plain else "OB", meta)
        if fault == "cut" and k == 1:
            data = path.read_bytes()
            path.write_bytes(data[: rng.randrange(len(data) // 2, len(data) - 1)])
    said = f"{syntax} {fault or 'sound'} {stored}/{allocated} high {high} bits {bits} signed {signed} {fill} {meta}"
    return Coded(folder, truth, not fault and syntax != DEFLATED, lossy=False, said=said)


def pictures(folder: Path, rng: Random) -> Coded:
    """Write a recording of two or three frames in colours."""
    noise = np.random.default_rng(rng.randrange(2**32))
    syntax = rng.choice((IMPLICIT, EXPLICIT, BIG, RLE, JPEG, JPEG, LOSSLESS, LS, J2K))
    plain, n = syntax in (IMPLICIT, EXPLICIT, BIG), rng.choice((2, 3))
    fault = rng.choice(OF_PICTURES) if rng.random() < 0.5 else ""
    of_jpeg = {"jfif": JPEG, "adobe": JPEG, "subsampled": JPEG}
    if (plain and fault == "table") or syntax != (of_jpeg | {"planes": RLE, "transform": J2K}).get(fault, syntax):
        fault = ""
    rows, columns = rng.choice(((5, 7), (6, 8), (16, 24))) if syntax != JPEG else (24, 32)
    y, x = np.mgrid[:rows, :columns]
    smooth = np.stack([np.stack([200 - 3 * y, 60 + 2 * x, 20 + 30 * k + 0 * y], -1) for k in range(n)])
    truth = smooth.astype(np.uint8) if syntax == JPEG else noise.integers(0, 256, smooth.shape, dtype=np.uint8)
    stored, header = truth, {"PhotometricInterpretation": "RGB", "PlanarConfiguration": 0}
    kind, frames = "OB", []
    if syntax == JPEG:
        in_ybr = rng.random() < 0.6
        header["PhotometricInterpretation"] = "YBR_FULL_422" if in_ybr else "RGB"
        if fault == "jfif":
            in_ybr, header["PhotometricInterpretation"] = True, "RGB"
        elif fault == "adobe":
            in_ybr, header["PhotometricInterpretation"] = False, "YBR_FULL_422"
        elif fault == "subsampled":
            in_ybr, header["PhotometricInterpretation"] = True, "RGB"
        how = {"colorspace": "RGB", "outcolorspace": "YCBCR" if in_ybr else "RGB", "level": 98}
        for frame in truth:
            coded = bytes(imagecodecs.jpeg8_encode(frame, subsampling="420" if fault == "subsampled" else None, **how))
            if fault == "subsampled" or (in_ybr and fault != "jfif" and rng.random() < 0.5):
                coded = coded[:2] + coded[4 + int.from_bytes(coded[4:6], "big") :]  # without its JFIF
            frames.append(coded)
    elif plain or syntax in (RLE, LOSSLESS, LS):
        header["PhotometricInterpretation"] = rng.choice(("RGB", "YBR_FULL")) if syntax != LOSSLESS else "RGB"
        if header["PhotometricInterpretation"] == "YBR_FULL":
            truth = convert_color_space(stored.copy(), "YBR_FULL", "RGB", per_frame=True)
    made = _dataset(n, (rows, columns, 3), {"SOPClassUID": CAPTURES, "Modality": "ES", "FrameTime": 40} | header)
    made.BitsAllocated, made.BitsStored, made.HighBit, made.PixelRepresentation = 8, 8, 7, 0
    if plain:
        kind = rng.choice(("OB", "OW"))
        if rng.random() < 0.5:
            made.PlanarConfiguration, stored = 1, np.moveaxis(stored, -1, 1)
        made.PixelData = _plain(np.ascontiguousarray(stored), syntax, kind)
    else:
        mct = rng.random() < 0.5
        if syntax == J2K:
            made.PhotometricInterpretation = "YBR_RCT" if mct else "RGB"
            if fault == "transform":
                made.PhotometricInterpretation, truth = ("YBR_FULL", stored) if mct else ("YBR_RCT", stored)
        how = {"mct": mct} if syntax == J2K else {}
        frames = frames or [_coded(frame, syntax, 8, **how) for frame in stored]
        if syntax == RLE:
            made.PlanarConfiguration = rng.choice((0, 1))
        if fault == "planes":
            frames = [_coded(frame[..., 0], syntax, 8) for frame in stored]
        _encapsulated(made, frames, rng)
        if fault == "table":
            halves = [part for frame in frames for part in (frame[:20], frame[20:])]
            made.PixelData = encapsulate(halves, has_bot=rng.random() < 0.5)
    if fault == "frames":
        made.NumberOfFrames = n + rng.choice((-1, 1))
    _save(made, folder / "a.dcm", syntax, kind)
    if fault == "cut":
        data = (folder / "a.dcm").read_bytes()
        (folder / "a.dcm").write_bytes(data[: rng.randrange(len(data) // 2, len(data) - 20)])
    said = f"{syntax} {fault or 'sound'} {made.PhotometricInterpretation} {rows}x{columns} {kind}"
    return Coded(folder / "a.dcm", truth, not fault, lossy=syntax == JPEG, said=said)


def is_right(frames: NDArray[Any], coded: Coded) -> bool:
    """Say whether frames are those that were drawn; what JPEG loses does not count, nor which end comes first."""
    if frames.shape != coded.truth.shape:
        return False
    if coded.lossy:
        return bool(np.abs(frames.astype(float) - coded.truth).mean() < 4)
    return math.isclose(float(np.abs(frames - coded.truth.astype(np.float64)).max()), 0)
