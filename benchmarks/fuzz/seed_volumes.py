"""Sound CTs, segmentations, tables of labels and plans, as small as readers take them."""

import gzip
import io
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from benchmarks.ct_faults.drawn import Drawn, drawn, named_slices
from benchmarks.ct_faults.writing import (
    enhanced,
    metaimage_header,
    nifti,
    nrrd_header,
    save,
    segmentation,
    write_metaimage,
    write_nrrd,
    write_series,
    write_slice,
)
from benchmarks.fuzz.trees import Seed, read_tree

NAMES = ("facial nerve", "cochlea", "temporal bone")


def volume_seeds() -> Iterator[Seed]:
    """Yield a CT or a segmentation in every format."""
    volume = drawn(Random(4))
    labels = _labels(volume)
    for name, write in _writers(volume, labels).items():
        with tempfile.TemporaryDirectory() as scratch:
            target = write(Path(scratch))
            yield Seed(name, target, read_tree(Path(scratch)))


def plan_seeds() -> Iterator[Seed]:
    """Yield lines of 3D Slicer, of all its versions."""
    points = "".join(
        f'{comma}{{"id": "{k}", "label": "{end}", "position": [{x}, 2.5, -3], "positionStatus": "defined"}}'
        for k, (comma, end, x) in enumerate((("", "entry", 1), (",", "target", 20)), 1)
    )
    markup = f'{{"type": "Line", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": [{points}]}}'
    yield Seed("json", "plan.mrk.json", {"plan.mrk.json": f'{{"markups": [{markup}]}}'.encode()})
    columns = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
    for version, system, more in (("4.6", "0", ""), ("4.11", "LPS", ""), ("5.4", "RAS", ",2,0")):
        rows = "".join(f"{k},{x}.5,2,-3,0,0,0,1,1,1,0,F-{k},,{more}\n" for k, x in ((1, 4), (2, 30)))
        text = f"# Markups fiducial file version = {version}\n# CoordinateSystem = {system}\n# columns = {columns}\n"
        yield Seed(version, "plan.fcsv", {"plan.fcsv": (text + rows).encode()})


def label_table_seeds() -> Iterator[Seed]:
    """Yield tables of labels."""
    yield Seed("ctbl", "a.ctbl", {"a.ctbl": b"# Color table file\n0 Background 0 0 0 0\n1 facial_nerve 9 8 7 255\n"})
    table = b'LabelValue,Name,Color_R,Color_G,Color_B\n1,facial nerve,1,2,3\n2,"cochlea, left",1,2,3\n'
    yield Seed("csv", "a.csv", {"a.csv": table})
    snap = b'# ITK-SnAP Label Description File\n    0     0    0    0        0  0  0    "Clear Label"\n'
    yield Seed("snap", "a.txt", {"a.txt": snap + b'    7   255    0    0        1  1  1    "facial nerve"\n'})


def _labels(volume: Drawn) -> dict[str, Any]:
    parts = np.indices(volume.voxels.shape).sum(axis=0) % 7
    return {name: parts == number for number, name in enumerate(NAMES, 1)}


def _writers(volume: Drawn, labels: dict[str, Any]) -> dict[str, Callable[[Path], str]]:
    slices = named_slices(volume)
    data = volume.voxels.astype("<i2").tobytes()
    flat = sum(number * mask for number, mask in enumerate(labels.values(), 1)).astype(np.uint8)

    def series(folder: Path) -> str:
        write_series(folder / "series", slices)
        return "series"

    def one_file(folder: Path) -> str:
        save(enhanced(slices), folder / "ct.dcm")
        return "ct.dcm"

    def segments(kind: str) -> Callable[[Path], str]:
        def write(folder: Path) -> str:
            save(segmentation(volume, labels, kind=kind), folder / "seg.dcm")
            return "seg.dcm"

        return write

    def compressed(folder: Path) -> str:
        (folder / "series").mkdir()
        for number, one in enumerate(slices[:4]):
            write_slice(folder / "series" / f"{number}.dcm", number, one | _jpeg_ls(one["values"]), JPEG_LS)
        return "series"

    def of_nifti(packed: bool) -> Callable[[Path], str]:
        def write(folder: Path) -> str:
            stream = nifti(volume).to_bytes()
            name = "ct.nii.gz" if packed else "ct.nii"
            (folder / name).write_bytes(gzip.compress(stream, mtime=0) if packed else stream)
            return name

        return write

    def slicer(folder: Path) -> str:
        header = nrrd_header(volume) | {"type": "unsigned char"}
        for number, name in enumerate(NAMES):
            header |= {f"Segment{number}_Name": f"= {name}", f"Segment{number}_LabelValue": f"= {number + 1}"}
        write_nrrd(folder / "labels.seg.nrrd", header, flat.tobytes())
        content = (folder / "labels.seg.nrrd").read_bytes()
        (folder / "labels.seg.nrrd").write_bytes(content.replace(b": = ", b":="))
        return "labels.seg.nrrd"

    def detached(folder: Path) -> str:
        write_nrrd(folder / "ct.nhdr", nrrd_header(volume) | {"encoding": "raw", "data file": "ct.raw"}, b"")
        (folder / "ct.raw").write_bytes(data)
        return "ct.nhdr"

    def named(folder: Path) -> str:
        (folder / "labels.nii.gz").write_bytes(gzip.compress(nifti(volume, flat).to_bytes(), mtime=0))
        rows = "".join(f"{number} {name.replace(' ', '_')} 1 2 3 255\n" for number, name in enumerate(NAMES, 1))
        (folder / "labels.ctbl").write_text(rows)
        return "labels.nii.gz"

    def mha(folder: Path) -> str:
        header = metaimage_header(volume) | {"CompressedData": "True"}
        write_metaimage(folder / "ct.mha", header, zlib.compress(data))
        return "ct.mha"

    def mhd(folder: Path) -> str:
        write_metaimage(folder / "ct.mhd", metaimage_header(volume) | {"ElementDataFile": "ct.raw"}, b"")
        (folder / "ct.raw").write_bytes(data)
        return "ct.mhd"

    return {
        "series": series, "enhanced": one_file, "seg": segments("BINARY"), "label map": segments("LABELMAP"),
        "jpeg-ls": compressed, "nii": of_nifti(False), "nii.gz": of_nifti(True), "seg.nrrd": slicer,
        "nrrd": lambda folder: write_nrrd(folder / "ct.nrrd", nrrd_header(volume), data).name, "nhdr": detached,
        "named": named, "mha": mha, "mhd": mhd,
    }  # fmt: skip


JPEG_LS = "1.2.840.10008.1.2.4.80"


def _jpeg_ls(values: Any) -> dict[str, Any]:
    """Return elements of a slice whose voxels are JPEG-LS."""
    import imagecodecs
    from pydicom.encaps import encapsulate

    raised = (values.astype(np.int32) + 1024).astype(np.uint16)
    stream = io.BytesIO(imagecodecs.jpegls_encode(raised)).getvalue()
    return {"PixelData": encapsulate([stream]), "PixelRepresentation": 0, "RescaleIntercept": -1024}
