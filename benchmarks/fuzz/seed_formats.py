"""Sound recordings as consoles, cameras and microscopes write them: DICOM, LightLab's TIFF, OME-TIFF, OME-Zarr."""

import io
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz.dicom_writer import CAPTURES, ENDOSCOPE, VIDEO_ENDOSCOPE, ivoct, pixels, write
from benchmarks.fuzz.seed_recordings import noise, video
from benchmarks.fuzz.trees import Seed, read_tree

JPEG_LS, H264 = "1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.102"
DEFLATED = "1.2.840.10008.1.2.1.99"


def dicom_seeds() -> Iterator[Seed]:
    """Yield recordings of a catheter and of an endoscope in DICOM."""
    for name, made in _dicom().items():
        with tempfile.TemporaryDirectory() as scratch:
            for number, (one, syntax) in enumerate(made):
                write(one, Path(scratch) / f"{number}.dcm", syntax)
            target = "" if len(made) > 1 else "0.dcm"
            yield Seed(name, target, read_tree(Path(scratch)), refused="deflated" in name)


def _dicom() -> dict[str, list[tuple[Any, str]]]:
    from pydicom.encaps import encapsulate
    from pydicom.uid import ExplicitVRLittleEndian, ImplicitVRLittleEndian

    plain = ExplicitVRLittleEndian
    bscans = noise(3, 12, 10, dtype="u2")
    said = [{"distance": 0.2, "place": 30.0 * k, "offset": k - 1, "seam": k, "padded": 2} for k in range(3)]
    rates = {"ALineRate": 1000.0, "CatheterRotationalRate": 100.0, "RangingDepth": 0.05}
    table = np.rint(np.exp(np.arange(256) / 30)).astype(np.uint16)
    full = ivoct(bscans, per_frame=said, OCTZOffsetApplied="NO", to_linear=table, **rates)
    motor = ivoct(
        noise(4, 12, 10), IVUSAcquisition="MOTORIZED", IVUSPullbackRate=20.0, CatheterRotationalRate=100.0,
        IVUSPullbackStartFrameNumber=2, IVUSPullbackStopFrameNumber=4, PixelIntensityRelationship="LIN",
    )  # fmt: skip
    each = [(ivoct(bscans[k : k + 1], InstanceNumber=k + 1, SliceLocation=0.2 * k), plain) for k in range(3)]
    round_ = ivoct(noise(2, 16, 16), sop_class="1.2.840.10008.5.1.4.1.1.14.1", RangingDepth=0.08)
    listed = _captured(noise(2, 8, 8) % 16, "PALETTE COLOR")
    for name in ("Red", "Green", "Blue"):
        setattr(listed, f"{name}PaletteColorLookupTableDescriptor", [16, 0, 16])
        setattr(listed, f"{name}PaletteColorLookupTableData", np.arange(16, dtype="<u2").tobytes())
    return {
        "ivoct": [(full, plain)],
        "ivoct motorised": [(motor, ImplicitVRLittleEndian)],
        "ivoct of a frame each": each,
        "ivoct for presentation": [(round_, plain)],
        "endoscope": [(_captured(noise(2, 8, 8, 3), "RGB", ENDOSCOPE, FrameTime=40.0), plain)],
        "endoscope ybr": [(_captured(noise(2, 8, 8, 3), "YBR_FULL", FrameTimeVector=[0, 40]), plain)],
        "endoscope palette": [(listed, plain)],
        "endoscope inverted": [(_captured(noise(2, 8, 8, dtype="u2"), "MONOCHROME1"), plain)],
        "endoscope deflated": [(_captured(noise(2, 8, 8, 3), "RGB", ENDOSCOPE, FrameTime=40.0), DEFLATED)],
        "endoscope rle": [(_compressed(), "1.2.840.10008.1.2.5")],
        "endoscope jpeg-ls": [(_encapsulated(encapsulate(_jpeg_ls())), JPEG_LS)],
        "endoscope fragments": [(_encapsulated(encapsulate(_jpeg_ls(), fragments_per_frame=2)), JPEG_LS)],
        "endoscope video": [(_filmed(), H264)],
    }


def _captured(frames: NDArray[Any], photometric: str, sop_class: str = CAPTURES, **header: Any) -> Any:
    made = pixels(frames, photometric)
    for keyword, value in ({"SOPClassUID": sop_class, "SOPInstanceUID": "1.2.3", "Modality": "ES"} | header).items():
        setattr(made, keyword, value)
    return made


def _compressed() -> Any:
    made = _captured(noise(2, 8, 8, 3), "RGB")
    with tempfile.TemporaryDirectory() as scratch:
        write(made, Path(scratch) / "a.dcm")
    made.compress("1.2.840.10008.1.2.5", generate_instance_uid=False)
    return made


def _jpeg_ls() -> list[bytes]:
    import imagecodecs

    return [io.BytesIO(imagecodecs.jpegls_encode(noise(8, 8, seed=k))).getvalue() for k in range(2)]


def _encapsulated(data: bytes) -> Any:
    made = _captured(noise(2, 8, 8), "MONOCHROME2")
    made.PixelData = data
    made["PixelData"].is_undefined_length = True
    return made


def _filmed() -> Any:
    from pydicom.encaps import encapsulate

    data = video("mp4", "mpeg4", "yuv420p")
    made = _captured(noise(1, 32, 32, 3), "YBR_PARTIAL_420", VIDEO_ENDOSCOPE, CineRate=25)
    made.NumberOfFrames = 4
    made.PixelData = encapsulate([data + bytes(len(data) % 2)], fragments_per_frame=3)
    made["PixelData"].is_undefined_length = True
    return made


def microscope_seeds() -> Iterator[Seed]:
    """Yield LightLab's TIFF, OME-TIFF and OME-Zarr."""
    import tifffile

    stack = noise(3, 8, 10, dtype="u2")
    for name, file, options in (
        ("lightlab", "a.oct", {"metadata": None}),
        ("ome", "a.ome.tif", {"ome": True, "metadata": {"axes": "ZYX", "PhysicalSizeZ": 200.0, "PhysicalSizeY": 5.0}}),
        ("ome in time", "a.tif", {"ome": True, "metadata": {"axes": "TYX", "TimeIncrement": 0.04}}),
        ("ome by hand", "a.tif", {"metadata": None, "description": _xml()}),
    ):
        buffer = io.BytesIO()
        tifffile.imwrite(buffer, stack, photometric="minisblack", **options)  # type: ignore[arg-type]
        yield Seed(name, file, {file: buffer.getvalue()})
    for zarr_format in (2, 3):
        for chunks, more in (((1, 8, 10), {}), ((2, 4, 5), {})):
            with tempfile.TemporaryDirectory() as scratch:
                _write_zarr(Path(scratch) / "a.zarr", stack, zarr_format, chunks, **more)
                yield Seed(f"ome-zarr {zarr_format} {chunks}", "a.zarr", read_tree(Path(scratch)))


def _xml() -> bytes:
    planes = "".join(f'<TiffData FirstZ="{k}" IFD="{2 - k}" PlaneCount="1"/>' for k in range(3))
    return (
        '<?xml version="1.0"?><OME UUID="urn:uuid:1"><Image><Pixels DimensionOrder="XYZCT" SizeX="10" SizeY="8" '
        f'SizeZ="3" SizeC="1" SizeT="1" Type="uint16" PhysicalSizeZ="0.2" PhysicalSizeZUnit="mm">{planes}'
        "</Pixels></Image></OME>"
    ).encode()


def _write_zarr(path: Path, stack: NDArray[Any], zarr_format: int, chunks: tuple[int, ...], **options: Any) -> None:
    import zarr

    group = zarr.open_group(path, mode="w", zarr_format=2 if zarr_format == 2 else 3)
    made = group.create_array("0", shape=stack.shape, dtype=stack.dtype, chunks=chunks, **options)
    made[...] = stack
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    scale = [{"type": "scale", "scale": [200.0, 5.0, 5.0]}]
    listed = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}], "version": "0.4"}]
    group.attrs.update(
        {"multiscales": listed} if zarr_format == 2 else {"ome": {"version": "0.5", "multiscales": listed}}
    )
