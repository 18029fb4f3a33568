"""What labels stand for: the names of the file, of a table next to it or named; nothing is guessed."""

import csv
import re
from pathlib import Path
from random import Random

import nibabel
import numpy as np
import pytest

from benchmarks.ct_faults.drawn import Drawn, drawn
from benchmarks.ct_faults.writing import nifti, nrrd_header, write_nrrd
from endoct.base.errors import EndoctError
from endoct.fusion.pose.structures import label_doubts, structures_near
from endoct.modalities.ct.ct_volume import CtVolume, holds_labels, read_ct, with_label_names
from endoct.modalities.ct.label_names import read_label_names
from endoct.modalities.ct.trajectory import Trajectory, as_point
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.ct_scan import _write as write_as_simulated

NAMES = {1: "facial nerve", 2: "cochlea", 3: "chorda tympani"}
SNAP = """\ufeff################################################
# ITK-SnAP Label Description File
################################################
    0     0    0    0        0  0  0    "Clear Label"
    1   255    0    0        1  1  1    "facial nerve"
    2     0  255    0        0.5  1  1    "cochlea"
    3     0    0  255        1  1  1    "chorda tympani"
    4     0    0  255        1  1  1    "Label 4"
"""
CTBL = """# Color table file
0 Background 0 0 0 0
1 facial_nerve 216 101 79 255
2 cochlea 1 2 3 255
3 chorda_tympani 1 2 3 255
"""
CSV = """LabelValue,Name,Color_R,Color_G,Color_B,Opacity
1,facial nerve,1,2,3,1
2,"cochlea",1,2,3,1
3,chorda tympani,1,2,3,1
"""


@pytest.fixture
def volume() -> Drawn:
    return drawn(Random(5))


def labels_of(volume: Drawn) -> np.ndarray:
    return np.asarray(np.indices(volume.voxels.shape).sum(axis=0) % 4, dtype=np.uint8)


def names_near(ct: CtVolume) -> list[str]:
    middle = ct.origin_mm + (np.array(ct.voxels.shape) / 2) @ ct.steps_mm
    return [
        one.name for one in structures_near(ct, Trajectory(as_point(middle), as_point(middle + np.array([2.0, 0, 0]))))
    ]


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ("labels.ctbl", CTBL),
        ("labels_ColorTable.ctbl", CTBL),
        ("labels.txt", SNAP),
        ("labels.label", SNAP),
        ("labels.csv", CSV),
    ],
)
def test_a_table_next_to_the_labels_names_them(tmp_path: Path, volume: Drawn, table: str, text: str) -> None:
    nibabel.save(nifti(volume, labels_of(volume)), tmp_path / "labels.nii.gz")
    (tmp_path / table).write_text(text, encoding="utf-8")
    assert read_label_names(tmp_path / table) == NAMES
    ct = read_ct(tmp_path / "labels.nii.gz")
    assert names_near(ct) == list(NAMES.values())
    assert ct.files == (tmp_path / "labels.nii.gz", tmp_path / table)
    (tmp_path / "labels_ColorTable.ctbl").write_text(CTBL)
    (tmp_path / "labels.label").write_text(SNAP)
    with pytest.raises(EndoctError, match="several tables"):
        read_ct(tmp_path / "labels.nii.gz")


def test_without_names_labels_are_unknown_also_the_first(tmp_path: Path, volume: Drawn) -> None:
    nibabel.save(nifti(volume, labels_of(volume)), tmp_path / "labels.nii.gz")
    (tmp_path / "labels.txt").write_text("about these labels: drawn by hand\n")
    ct = read_ct(tmp_path / "labels.nii.gz")
    assert names_near(ct) == ["unknown label 1", "unknown label 2", "unknown label 3"]
    (doubt,) = label_doubts(ct)
    assert (doubt.code, doubt.value) == ("labels-unnamed", 3)
    assert names_near(with_label_names(ct, "endoct")) == ["facial nerve", "chorda tympani"]
    (tmp_path / "other.ctbl").write_text("1 cochlea 1 2 3 255\n2 bone 1 2 3 255\n")
    assert names_near(with_label_names(ct, tmp_path / "other.ctbl")) == ["cochlea", "unknown label 3"]


def test_labels_that_the_simulator_wrote_are_known(tmp_path: Path, volume: Drawn) -> None:
    from endoct.modalities.ct.nifti import OUR_LABELS

    lattice = Lattice(volume.origin, volume.to_lps[:3, 2::-1].T, volume.voxels.shape)
    write_as_simulated(tmp_path / "labels.nii.gz", labels_of(volume), lattice, OUR_LABELS)
    assert names_near(read_ct(tmp_path / "labels.nii.gz")) == ["facial nerve", "chorda tympani"]


def segmented(volume: Drawn, path: Path, layers: int, fields: dict[str, str]) -> Path:
    header = nrrd_header(volume) | {"type": "unsigned char"}
    data = labels_of(volume)
    if layers > 1:
        data = np.stack([data == 1, 2 * (data == 2) + (data == 1)], axis=-1).astype(np.uint8)
        header |= {
            "dimension": "4",
            "sizes": f"{layers} {header['sizes']}",
            "space directions": f"none {header['space directions']}",
            "kinds": f"list {header['kinds']}",
        }
    write_nrrd(path, header | {f"{key}=": value for key, value in fields.items()}, data.tobytes())
    path.write_bytes(path.read_bytes().replace(b"=: ", b":="))
    return path


def test_segments_of_3d_slicer_have_their_names_and_layers(tmp_path: Path, volume: Drawn) -> None:
    fields = {
        "Segment0_Name": "Nervus facialis (links, früh)", "Segment0_LabelValue": "1", "Segment0_Layer": "0",
        "Segment1_Name": "bone", "Segment1_LabelValue": "2", "Segment1_Layer": "1",
        "Segment2_Name": "cochlea", "Segment2_LabelValue": "1", "Segment2_Layer": "1",
    }  # fmt: skip
    ct = read_ct(segmented(volume, tmp_path / "labels.seg.nrrd", 2, fields))
    assert names_near(ct) == ["Nervus facialis (links, früh)", "cochlea"]
    assert ct.segments is not None
    labels = labels_of(volume)
    for segment, number in zip(ct.segments, (1, 2, 1), strict=True):
        assert np.array_equal(np.isin(ct.voxels, segment.values), labels == number)
    del fields["Segment2_LabelValue"]
    with pytest.raises(EndoctError, match="which voxels are segment 2"):
        read_ct(segmented(volume, tmp_path / "lacking.seg.nrrd", 2, fields))


def test_a_facial_nerve_with_the_label_1_is_no_bone(tmp_path: Path, volume: Drawn) -> None:
    fields = {f"Segment{n}_{key}": value for n, name in enumerate(NAMES.values()) for key, value in
              (("Name", name), ("LabelValue", str(n + 1)))}  # fmt: skip
    ct = read_ct(segmented(volume, tmp_path / "labels.seg.nrrd", 1, fields))
    assert names_near(ct) == list(NAMES.values())
    assert label_doubts(ct) == ()
    with pytest.raises(EndoctError, match="does not have air as 0 and bone"):
        holds_labels(ct, "the CT", "")


def test_many_values_are_no_labels(volume: Drawn) -> None:
    many = np.arange(2000, dtype=np.uint16).reshape(10, 10, 20)
    with pytest.raises(EndoctError, match="the labels are none; found 1999 values"):
        names_near(CtVolume(many, volume.origin, np.eye(3), "lps"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found 0 names"),
        ("# only a comment\n", "found 0 names"),
        ("1 2 3", "the line '1 2 3'"),
        ("hello\n", "the line 'hello'"),
        ("1 a 1 2 3\n1 b 1 2 3\n", "names a label twice; found 1: 'a' and 'b'"),
        ("65536 a 1 2 3\n", "a label '65536'"),
        ("-1 a 1 2 3", "a label '-1'"),
        ("\ufefflabel", "the line 'label'"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.ctbl").write_text(text, encoding="utf-8")
    with pytest.raises(EndoctError, match=re.escape(said)):
        read_label_names(tmp_path / "a.ctbl")


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([("1", "bone", "1"), ("2",)], "a row of 1 fields"),
        ([("x", "bone", "1")], "a label 'x'"),
        ([("1", "bone", "1"), ("1", "air", "1")], "names a label twice"),
    ],
)
def test_a_table_of_3d_slicer_that_is_damaged_is_refused(
    tmp_path: Path, rows: list[tuple[str, ...]], said: str
) -> None:
    with (tmp_path / "a.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("LabelValue", "Name", "Color_R"), *rows])
    with pytest.raises(EndoctError, match=said):
        read_label_names(tmp_path / "a.csv")


@pytest.mark.parametrize("data", [b"1 \x81 1 2 3", "1 bone 1 2 3".encode("utf-16")[:-1]])
def test_bytes_that_are_no_text_are_no_table(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.ctbl").write_bytes(data)
    with pytest.raises(EndoctError, match="found no text"):
        read_label_names(tmp_path / "a.ctbl")
