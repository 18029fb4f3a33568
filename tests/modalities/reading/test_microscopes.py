"""LightLab's TIFF, OME-TIFF and OME-Zarr: the frames that were written, and the sizes that their files state."""

import json
import os
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import zarr
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import read_drawing
from endoct.modalities.reading.numbering import spacing_of
from endoct.modalities.reading.recording import ImageStack, open_stack, stated_by
from endoct.modalities.recognition import recognise

STACK = np.random.default_rng(2).integers(0, 60_000, (6, 40, 56), dtype=np.uint16)


def read(path: Path) -> NDArray[Any]:
    stack = open_stack(path)
    return np.stack([stack[k] for k in range(len(stack))])


def refusal(path: Path) -> str:
    with pytest.raises(EndoctError) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def codes(stack: ImageStack) -> set[str]:
    return {doubt.code for doubt in stack.remarks.doubts}


def test_rows_of_lightlab_are_ascans(tmp_path: Path) -> None:
    path = tmp_path / "pullback.oct"
    tifffile.imwrite(path, STACK, photometric="minisblack", metadata=None)
    np.testing.assert_array_equal(read(path), STACK.transpose(0, 2, 1))
    np.testing.assert_array_equal(read(tmp_path), STACK.transpose(0, 2, 1))
    assert stated_by(tmp_path).keys == {"modality": "oct", "intensity": "linear"}
    assert recognise(tmp_path).manifest.name == "oct"
    assert "taken for LightLab's" in " ".join(open_stack(path).remarks.notes)


def test_another_tiff_named_oct_is_read_as_it_lies(tmp_path: Path) -> None:
    path = tmp_path / "pullback.oct"
    tifffile.imwrite(path, STACK.astype(np.uint8), photometric="minisblack")
    np.testing.assert_array_equal(read(path), STACK.astype(np.uint8))
    assert stated_by(path).keys == {}
    tifffile.imwrite(tmp_path / "other.tif", STACK, photometric="minisblack")
    np.testing.assert_array_equal(read(tmp_path / "other.tif"), STACK)


def ome(path: Path, stack: NDArray[Any] = STACK, **metadata: Any) -> Path:
    tifffile.imwrite(path, stack, ome=True, photometric="minisblack", metadata=metadata)
    return path


@pytest.mark.parametrize(
    ("axes", "metadata", "keys"),
    [
        (
            "ZYX",
            {"PhysicalSizeZ": 0.2, "PhysicalSizeZUnit": "mm", "PhysicalSizeY": 5.1},  # µm where nothing else is said
            {"axial_pixel_mm": 0.0051, "pullback_pitch_mm": 0.2, "feed_pitch_mm": 0.2},
        ),
        ("TYX", {"TimeIncrement": 40.0, "TimeIncrementUnit": "ms"}, {"frame_rate_hz": 25.0}),
        ("ZYX", {"PhysicalSizeZ": 1.0, "PhysicalSizeZUnit": "pixel"}, {}),
        ("ZYX", {}, {}),
    ],
)
def test_sizes_in_ome_xml_are_keys(axes: str, metadata: dict[str, Any], keys: dict[str, float], tmp_path: Path) -> None:
    path = ome(tmp_path / "a.ome.tif", axes=axes, **metadata)
    with tifffile.TiffFile(path) as independent:
        np.testing.assert_array_equal(read(path), independent.series[0].asarray())
    np.testing.assert_array_equal(read(tmp_path), STACK)
    for place in (path, tmp_path):
        assert stated_by(place).keys == pytest.approx(keys)
    assert stated_by(path).by == "the OME-XML of a.ome.tif"
    assert ("in air" in " ".join(open_stack(path).remarks.notes)) == ("axial_pixel_mm" in keys)


def test_channels_alone_may_be_frames_and_are_doubted(tmp_path: Path) -> None:
    path = ome(tmp_path / "a.tif", axes="CYX")
    np.testing.assert_array_equal(read(path), STACK)
    assert codes(open_stack(path)) == {"frames-as-channels"}
    assert "wrong dimensions" in refusal(ome(tmp_path / "b.tif", STACK.reshape(2, 3, 40, 56), axes="CZYX"))
    assert "wrong dimensions" in refusal(ome(tmp_path / "c.tif", STACK.reshape(2, 3, 40, 56), axes="TZYX"))


XML = """<?xml version="1.0" encoding="UTF-8"?>{before}
<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:1">
<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="{order}" Type="uint16" SizeX="56" SizeY="40" SizeC="1"
 SizeZ="{n}" SizeT="1" PhysicalSizeZ="{pitch}" PhysicalSizeZUnit="{unit}">{data}</Pixels></Image>{more}</OME>"""


def described(path: Path, data: str = "", **values: Any) -> Path:
    said = {"before": "", "order": "XYZCT", "n": 6, "pitch": "200", "unit": "µm", "data": data, "more": ""} | values
    xml = XML.format(**said).encode()
    tifffile.imwrite(path, STACK, photometric="minisblack", metadata=None, description=xml)
    return path


def test_planes_lie_where_the_description_has_them(tmp_path: Path) -> None:
    turned = "".join(f'<TiffData FirstZ="{k}" IFD="{5 - k}" PlaneCount="1"/>' for k in range(6))
    path = described(tmp_path / "a.tif", turned)
    np.testing.assert_array_equal(read(path), STACK[::-1])
    assert stated_by(path).keys["pullback_pitch_mm"] == pytest.approx(0.2)
    np.testing.assert_array_equal(read(described(tmp_path / "b.tif", "<TiffData/>")), STACK)
    np.testing.assert_array_equal(
        read(described(tmp_path / "c.tif", '<TiffData IFD="2" PlaneCount="3"/>', n=3)), STACK[2:5]
    )
    own = '<TiffData IFD="0" PlaneCount="6"><UUID FileName="renamed.tif">urn:uuid:1</UUID></TiffData>'
    np.testing.assert_array_equal(read(described(tmp_path / "d.tif", own)), STACK)
    pickled = pickle.loads(pickle.dumps(open_stack(path)))
    np.testing.assert_array_equal(pickled[2], STACK[3])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"data": '<TiffData IFD="0"><UUID FileName="/etc/passwd">urn:uuid:2</UUID></TiffData>'},
            "another file, '/etc/",
        ),
        ({"data": '<TiffData IFD="4" PlaneCount="6"/>'}, "does not hold the frames"),
        ({"data": '<TiffData FirstZ="0" IFD="0" PlaneCount="2"/>'}, "does not hold the frames"),
        (
            {"data": '<TiffData FirstZ="0" PlaneCount="1" IFD="0"/><TiffData FirstZ="2" PlaneCount="4" IFD="2"/>'},
            "does not hold the frames",  # the second, though a page is left over that might be it
        ),
        ({"n": 7}, "does not hold the frames"),
        ({"n": 10**9}, "wrong dimensions"),
        ({"n": "x"}, "cannot be used"),
        ({"order": "XYZ"}, "in the order"),
        ({"more": '<Image><Pixels SizeX="1"/></Image>'}, "several images"),
        ({"before": '<!DOCTYPE OME [<!ENTITY a "b">]>', "pitch": "&a;"}, "a document type or entities"),
        ({"before": '<!DOCTYPE OME SYSTEM "file:///etc/passwd">'}, "a document type or entities"),
        ({"pitch": '1"'}, "is no valid XML"),
    ],
)
def test_a_description_that_cannot_be_followed_is_refused(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    assert said in refusal(described(tmp_path / "a.tif", **change))


@pytest.mark.parametrize("suffix", [".oct", ".ome.tif"])
def test_what_is_cut_off_is_one_line(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix == ".oct":
        tifffile.imwrite(path, STACK[:2, :16, :16], photometric="minisblack", metadata=None)
    else:
        ome(path, STACK[:2, :16, :16], axes="ZYX")
    whole = path.read_bytes()
    for length in range(0, len(whole), 64):
        path.write_bytes(whole[:length])
        refusal(path)


def ngff(
    path: Path,
    stack: NDArray[Any] = STACK,
    *,
    version: str = "0.5",
    axes: str = "zyx",
    scale: tuple[float, ...] = (0.2, 5.0, 7.0),
    units: dict[str, str] | None = None,
    chunks: tuple[int, ...] = (1, 16, 32),
    **options: Any,
) -> Path:
    """Write two levels by hand, after the text of the specification; the coarser one is not of the same samples."""
    named = {"z": "millimeter", "y": "micrometer", "x": "micrometer", "t": "second"} if units is None else units
    kinds = {"t": "time", "c": "channel"}
    group = zarr.open_group(path, mode="w", zarr_format=3 if version == "0.5" else 2)
    datasets = []
    for level, factor in (("0", 1), ("1", 2)):
        values = stack if factor == 1 else stack[..., ::2, ::2] // 2
        more = {"chunk_key_encoding": {"name": "v2", "separator": "/"}} if version == "0.4" else {}
        array = group.create_array(level, shape=values.shape, dtype=values.dtype, chunks=chunks, **more, **options)
        array[...] = values
        steps = [step * (factor if axis in "yx" else 1) for axis, step in zip(axes, scale, strict=True)]
        datasets.append({"path": level, "coordinateTransformations": [{"type": "scale", "scale": steps}]})
    listed = [
        {"name": axis, "type": kinds.get(axis, "space")} | ({"unit": named[axis]} if axis in named else {})
        for axis in axes
    ]
    multiscales = [{"axes": listed, "datasets": datasets}]
    if version == "0.5":
        group.attrs.update({"ome": {"version": "0.5", "multiscales": multiscales}})
    else:
        group.attrs.update({"multiscales": [multiscales[0] | {"version": "0.4"}]})
    return path


@pytest.mark.parametrize("version", ["0.4", "0.5"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_planes_of_ome_zarr_are_frames(version: str, dtype: Any, tmp_path: Path) -> None:
    path = ngff(tmp_path / "a.ome.zarr", STACK.astype(dtype), version=version)
    np.testing.assert_array_equal(read(path), STACK.astype(dtype))
    np.testing.assert_array_equal(read(tmp_path), STACK.astype(dtype))
    keys = {"axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2, "feed_pitch_mm": 0.2}
    for place in (path, tmp_path):
        assert stated_by(place).keys == pytest.approx(keys)
    again = pickle.loads(pickle.dumps(open_stack(path)))
    np.testing.assert_array_equal(again[5], STACK[5].astype(dtype))


def test_shards_other_axes_and_times_are_read(tmp_path: Path) -> None:
    sharded = ngff(tmp_path / "a.zarr", chunks=(1, 16, 16), shards=(2, 48, 64))
    np.testing.assert_array_equal(read(sharded), STACK)
    five = STACK[:, None, None]
    scale = (0.04, 1.0, 1.0, 1.0, 1.0)
    timed = ngff(tmp_path / "b.zarr", five, axes="tczyx", scale=scale, units={"t": "second"}, chunks=(4, 1, 1, 40, 56))
    np.testing.assert_array_equal(read(timed), STACK)
    assert stated_by(timed).keys == pytest.approx({"frame_rate_hz": 25.0})


@pytest.mark.parametrize(("most", "read"), [(12, True), (11, False)])
def test_frames_of_too_many_chunks_are_refused(
    most: int, read: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames of 40 × 56 in chunks of 10 × 24 have 4 × 3; slices are no part of a frame."""
    path = ngff(tmp_path / "a.zarr", chunks=(1, 10, 24))
    monkeypatch.setattr("endoct.modalities.reading.ome_zarr.MOST_CHUNKS_A_FRAME", most)
    if read:
        assert len(open_stack(path)) == len(STACK)
    else:
        assert "too many chunks; expected 11 a frame" in refusal(path)


def test_missing_chunks_are_the_fill_value(tmp_path: Path) -> None:
    stack = STACK.copy()
    stack[2, :16, :32] = 0  # writers leave out what is nothing but the fill value
    path = ngff(tmp_path / "a.zarr", stack)
    assert not (path / "0" / "c" / "2" / "0" / "0").exists()
    np.testing.assert_array_equal(read(path), stack)
    shutil.rmtree(path / "0" / "c" / "4")
    assert "frame 4 of" in refusal(path)
    assert "none of its chunks" in refusal(path)


def test_a_converters_layout_is_entered(tmp_path: Path) -> None:
    zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2).attrs.update({"bioformats2raw.layout": 3})
    ngff(tmp_path / "a.zarr" / "0", version="0.4")
    np.testing.assert_array_equal(read(tmp_path / "a.zarr"), STACK)
    ngff(tmp_path / "a.zarr" / "1", version="0.4")
    assert "holds more than one recording" in refusal(tmp_path / "a.zarr")


def changed(path: Path, where: str, **values: Any) -> Path:
    file = path / where / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | values))
    return path


def test_stores_that_cannot_be_followed_are_refused(tmp_path: Path) -> None:
    wide = ngff(tmp_path / "a.zarr", STACK.reshape(2, 3, 40, 56), axes="czyx", scale=(1.0,) * 4, chunks=(1, 1, 40, 56))
    assert "c = 2, z = 3, y = 40, x = 56" in refusal(wide)
    sound = ngff(tmp_path / "sound.zarr")
    huge = shutil.copytree(sound, tmp_path / "b.zarr")
    assert "asks for too much memory" in refusal(changed(huge, "0", shape=[6, 10**6, 10**6]))
    coded = shutil.copytree(sound, tmp_path / "c.zarr")
    assert "codec" in refusal(changed(coded, "0", codecs=[{"name": "bytes"}, {"name": "pickle"}]))
    linked = shutil.copytree(sound, tmp_path / "d.zarr")
    chunk = linked / "0" / "c" / "1" / "0" / "0"
    chunk.unlink()
    chunk.symlink_to(sound / "0" / "c" / "2" / "0" / "0")
    assert "found a link" in refusal(linked)
    chunk.unlink()
    chunk.symlink_to(chunk.name)  # which leads to itself
    assert "found a link" in refusal(linked)
    bomb = shutil.copytree(sound, tmp_path / "e.zarr")
    import numcodecs

    (bomb / "0" / "c" / "1" / "0" / "0").write_bytes(numcodecs.Zstd().encode(bytes(10**7)))
    assert "more than it can have" in refusal(bomb)
    outside = shutil.copytree(sound, tmp_path / "f.zarr")
    attributes = json.loads((outside / "zarr.json").read_text())["attributes"]
    attributes["ome"]["multiscales"][0]["datasets"][0]["path"] = "../sound.zarr/0"
    assert "names a place outside" in refusal(changed(outside, "", attributes=attributes))
    attributes["ome"]["multiscales"][0]["datasets"][0]["path"] = "0"
    attributes["ome"]["version"] = "0.1"
    assert "OME-Zarr 0.1" in refusal(changed(outside, "", attributes=attributes))


def test_every_bit_that_falls_over_is_one_line_or_seen(tmp_path: Path) -> None:
    path = ngff(tmp_path / "a.zarr")
    chunk = path / "0" / "c" / "1" / "0" / "0"
    whole = chunk.read_bytes()
    for length in range(0, len(whole), 64):
        chunk.write_bytes(whole[:length])
        refusal(path)
    chunk.unlink()
    os.mkfifo(chunk)
    assert "no file with content" in refusal(path)


def placed(path: Path, axis: str, values: list[Any], name: str = "PositionZ", unit: str = "") -> Path:
    """Write a stack along ``axis`` whose planes say where, or when, each was taken; None says nothing."""
    of_unit = f' {name}Unit="{unit}"' if unit else ""
    planes = "".join(
        f'<Plane TheZ="{k if axis == "Z" else 0}" TheC="0" TheT="{k if axis == "T" else 0}" '
        f'{"" if value is None else f"""{name}="{value}"{of_unit}"""}/>'
        for k, value in enumerate(values)
    )
    data = described(path, planes).read_bytes()
    along_t = data.replace(b'SizeZ="6" SizeT="1"', b'SizeZ="1" SizeT="6"')
    path.write_bytes(along_t if axis == "T" else data)
    return path


@pytest.mark.parametrize(
    ("axis", "values", "name", "unit", "mm_or_s", "kind"),
    [
        ("Z", [0, 200, 400, 600, 800, 1000], "PositionZ", "µm", "mm", "even"),
        ("Z", [0, 200, 400, 800, 1000, 1200], "PositionZ", "µm", "mm", "gaps"),
        ("Z", [0, -200, -400, -800, -1000, -1200], "PositionZ", "µm", "mm", "gaps"),
        ("Z", [0.0, 0.21, 0.5, 0.6, 0.93, 1.0], "PositionZ", "mm", "mm", "uneven"),
        ("Z", [0, 2, 4, 8, 10, 12], "PositionZ", "", "", "gaps"),
        ("Z", [0, 2, 4, 8, 10, 12], "PositionZ", "reference frame", "", "gaps"),
        ("T", [0, 40, 80, 160, 200, 240], "DeltaT", "ms", "s", "gaps"),
        ("T", [0, 1, 2, 4, 5, 6], "DeltaT", "", "s", "gaps"),
        ("T", [0, 200, 400, 800, 1000, 1200], "PositionZ", "µm", "mm", "gaps"),
    ],
)
def test_planes_lie_where_they_say(
    axis: str, values: list[Any], name: str, unit: str, mm_or_s: str, kind: str, tmp_path: Path
) -> None:
    stack = open_stack(placed(tmp_path / "a.tif", axis, values, name, unit))
    assert stack.along is not None
    assert (stack.along.unit, spacing_of(stack.along.values, within=stack.along.within).kind) == (mm_or_s, kind)
    if unit in ("µm", "ms"):
        np.testing.assert_allclose(np.ptp(stack.along.values), np.ptp(values) / 1000)
    assert (np.diff(stack.along.values) > 0).all()
    assert codes(stack) == set()


def test_planes_that_say_nothing_of_their_places(tmp_path: Path) -> None:
    for name, axis, values in (("PositionZ", "Z", [5.0] * 6), ("DeltaT", "Z", [0, 1, 5, 6, 7, 8])):
        stack = open_stack(placed(tmp_path / "a.tif", axis, values, name))
        assert stack.along is None
        assert codes(stack) == set()
    stack = open_stack(placed(tmp_path / "a.tif", "Z", [0, 1, None, 3, 4, 5]))
    assert stack.along is None
    (doubt,) = stack.remarks.doubts
    assert (doubt.code, "PositionZ of 5 of 6 frames" in doubt.what) == ("frames-uneven", True)


def test_the_aspect_of_pixels_by_their_physical_size(tmp_path: Path) -> None:
    path = ome(tmp_path / "a.tif", axes="ZYX", PhysicalSizeX=3.0, PhysicalSizeY=2.0)
    assert open_stack(path).pixel_aspect == pytest.approx(1.5)
    assert open_stack(ome(tmp_path / "b.tif", axes="ZYX", PhysicalSizeX=3.0)).pixel_aspect == 1


def test_a_mask_in_ome_tiff_keeps_its_palette_and_which_value_is_white(tmp_path: Path) -> None:
    cells = np.zeros((6, 8), np.uint8)
    cells[1:3, 2:5] = 1
    colours = np.zeros((3, 256), np.uint16)
    colours[:, 0] = colours[0, 1] = 65535  # the ground is white, cell is red
    tifffile.imwrite(tmp_path / "palette.tif", cells, ome=True, photometric="palette", colormap=colours)
    stack = open_stack(tmp_path / "palette.tif")
    np.testing.assert_array_equal(stack.stored(0), cells)
    assert stack.palette is not None
    assert stack.palette[:2].tolist() == [[255, 255, 255], [255, 0, 0]]
    for name, stored in (("white.tif", 255 - 255 * cells), ("most.tif", 255 * cells)):
        tifffile.imwrite(tmp_path / name, stored, ome=True, photometric="miniswhite", metadata={"axes": "YX"})
    for name in ("palette.tif", "white.tif"):
        np.testing.assert_array_equal(read_drawing(tmp_path / name, None), cells > 0)
    with pytest.raises(EndoctError, match="88% of it white, in a file that changes what black and white stand for"):
        read_drawing(tmp_path / "most.tif", None)
