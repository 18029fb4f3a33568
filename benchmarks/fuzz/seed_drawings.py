"""Sound masks drawn by hand: outlines of napari and Fiji, label images, Zarr stores of labels; and pictures."""

import json
import struct
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray

from benchmarks.fuzz.archives import zipped
from benchmarks.fuzz.seed_recordings import image, npy, tiff
from benchmarks.fuzz.trees import Seed, read_tree

SHAPE = (12, 16)
"""Rows and columns of the panorama that all is drawn on."""
_CSV = """index,shape-type,vertex-index,axis-0,axis-1
0,polygon,0,2.0,3.0
0,polygon,1,2.0,9.0
0,polygon,2,8.5,9.5
1,rectangle,0,1.0,1.0
1,rectangle,1,1.0,4.0
1,rectangle,2,5.0,4.0
1,rectangle,3,5.0,1.0
2,ellipse,0,3.0,13.0
2,ellipse,1,3.0,18.0
2,ellipse,2,9.0,18.0
2,ellipse,3,9.0,13.0
"""
MASK_TOML = b'modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.05\nrater = "anna"\nsession = "2"\n'


def labels() -> NDArray[np.uint8]:
    """Return two cells on the panorama's samples."""
    cells = np.zeros(SHAPE, np.uint8)
    cells[2:6, 3:9], cells[7:10, 12:15] = 1, 2
    return cells


def region(kind: int, name: str = "") -> bytes:
    """Return an ImageJ region of interest; ``kind``: 0 polygon, 1 rectangle, 2 oval, 7 freehand, 8 traced, 10 point."""
    top, left, bottom, right = 2, 3, 8, 10
    xs, ys = (0, 6, 6, 0), (0, 0, 5, 5)
    points = [] if kind in (1, 2) else [*xs, *ys]
    head = b"Iout" + struct.pack(">hBB4hH", 228, kind, 0, top, left, bottom, right, len(points) // 2)
    head = head.ljust(60, b"\0")
    second = 64 + 2 * len(points)
    body = struct.pack(f">{len(points)}h", *points)
    more = struct.pack(">9i", 0, 0, 0, 0, second + 64, len(name), 0, 0, 0).ljust(64, b"\0")
    return head + struct.pack(">i", second) + body + more + name.encode("utf-16-be")


def drawing_seeds() -> Iterator[Seed]:
    """Yield outlines and label images."""
    yield Seed("napari", "anna_1.csv", {"anna_1.csv": _CSV.encode()})
    for kind in (0, 1, 2, 7, 8):
        yield Seed(f"roi {kind}", "a.roi", {"a.roi": region(kind, "cell")})
    sub = bytearray(region(0))
    sub[50:52] = struct.pack(">h", 128)  # with sub-pixel places
    floats = struct.pack(">8f", 3.5, 9.5, 9.5, 3.5, 2.0, 2.0, 7.0, 7.0)
    sub[60:64] = struct.pack(">i", 80 + len(floats))
    yield Seed("roi sub-pixel", "a.roi", {"a.roi": bytes(sub[:80]) + floats + bytes(sub[80:])})
    whole = zipped([("0001.roi", region(0, "one")), ("0002.roi", region(2)), ("0003.roi", region(7))])
    yield Seed("roi zip", "a.zip", {"a.zip": whole})
    yield Seed("label png", "a_2.png", {"a_2.png": image(labels())})
    yield Seed("label tiff", "a.tif", {"a.tif": tiff(labels().astype(np.uint32))})
    ground = np.stack([np.full(SHAPE, 255, np.uint8)] * 3 + [np.minimum(labels(), 1) * 255], axis=-1)
    yield Seed("on a transparent ground", "a.png", {"a.png": image(ground)})
    yield Seed("white as 0", "a.tif", {"a.tif": tiff(255 - labels(), photometric="miniswhite")})
    colours = np.arange(768, dtype=np.uint16).reshape(3, 256) * 85
    yield Seed("labels with colours", "a.tif", {"a.tif": tiff(labels(), photometric="palette", colormap=colours)})
    yield Seed("label npy", "a.npy", {"a.npy": npy(labels())})


def mask_seeds() -> Iterator[Seed]:
    """Yield masks with a sidecar that says where they lie."""
    for suffix, data in ((".png", image(labels() * 100)), (".tif", tiff(labels())), (".csv", _CSV.encode())):
        yield Seed(f"mask {suffix}", f"a_1{suffix}", {f"a_1{suffix}": data, "a_1.toml": MASK_TOML})
    yield Seed("mask alone", "a.png", {"a.png": image(labels() * 100)})


def label_seeds() -> Iterator[Seed]:
    """Yield Zarr stores of labels: arrays, groups with levels, of both formats, sharded and compressed."""
    cells = labels()
    forms: tuple[Literal[2, 3], ...] = (2, 3)
    for form in forms:
        yield _store(f"array {form}", lambda path, form=form: _array(path, cells, zarr_format=form))
        yield _store(f"levels {form}", lambda path, form=form: _levels(path, cells, form, ome=False))
    yield _store("ome", lambda path: _levels(path, cells, 3, ome=True))
    yield _store("sharded", lambda path: _array(path, cells.astype(np.uint32), shards=(12, 8), chunks=(6, 4)))
    yield _store("truth values", lambda path: _array(path, cells > 0, chunks=(5, 16)))
    filtered = _store("with filters", lambda path: _array(path, cells.astype("<i4"), zarr_format=2, filters=_delta()))
    yield replace(filtered, refused=True)


def _delta() -> list[Any]:
    from numcodecs import Delta

    return [Delta("<i4")]


def _array(path: Path, cells: NDArray[Any], **options: Any) -> None:
    zarr.create_array(path, data=cells, **options)


def _levels(path: Path, cells: NDArray[Any], form: Literal[2, 3], *, ome: bool) -> None:
    group = zarr.open_group(path, mode="w", zarr_format=form)
    group.create_array("fine", data=cells[np.newaxis])
    group.create_array("coarse", data=cells[np.newaxis, ::2, ::2])
    levels: list[Any] = [{"version": "0.4", "datasets": [{"path": "fine"}, {"path": "coarse"}]}]
    group.attrs["ome" if ome else "multiscales"] = {"multiscales": levels} if ome else levels


def _store(name: str, make: Any) -> Seed:
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / "a_1.zarr")
        return Seed(f"labels {name}", "a_1.zarr", read_tree(Path(folder)))


def picture_seeds() -> Iterator[Seed]:
    """Yield folders of pictures of single frames."""
    yield Seed("pictures", "", pictures("oct") | pictures("endoscope"))


def pictures(side: str) -> dict[str, bytes]:
    """Return two pictures of one frame, as files by name."""
    found = {}
    for order, name in enumerate(("raw", "flat")):
        metadata = {
            "side": side, "place": 1, "order": order, "name": name, "title": f"B-scan {name}",
            "x_label": "rotation (rad)",
            "y_label": "depth (mm)", "x_extent": [0.0, 6.2], "y_extent": [0.0, 2.5], "curves": ["outer face", "wall"],
        }  # fmt: skip
        curve = np.stack([np.linspace(0, 6.2, 5), np.linspace(1, 2, 5)], axis=1)
        text = np.array(json.dumps(metadata))
        members = {"image": image_of(name), "metadata": text, "curve_0": curve, "curve_1": curve + 0.1}
        found[f"{side}-0001-{name}.npz"] = zipped([(f"{key}.npy", npy(array)) for key, array in members.items()])
    return found


def image_of(name: str) -> NDArray[Any]:
    """Return a small picture, grey or in colour."""
    samples = np.random.default_rng(len(name)).random((5, 7, 3)).astype(np.float32)
    return samples if name == "raw" else samples[..., 0]
