"""A wall as DICOM, read by pydicom, highdicom and GDCM: values, mm, the way θ and z run, and what is not said."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from marked_wall import DEPTH_MM, PLACES, RADIUS_MM, UNSEEN, Place, grid, write_marked, write_marked_comparison

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench import export
from endoct.workbench.exporting.dicom_files import write_dicom
from endoct.workbench.exporting.source import open_for_export
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import SilentStages

PLACE = PLACES[0]


@pytest.fixture(scope="module")
def hd():
    return pytest.importorskip("highdicom", reason="highdicom is not installed: pip install 'endoct[dicom]'")


@pytest.fixture(scope="module")
def folder(hd, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison as DICOM."""
    place = tmp_path_factory.mktemp("dicom")
    export(write_marked_comparison(place / "bore Ä\\1", PLACE), place / "bore.dicom")
    return place / "bore.dicom"


def where(image: np.ndarray) -> tuple[int, int]:
    row, column = np.unravel_index(np.nanargmax(image), image.shape)
    return int(row), int(column)


def sample_of(place: Place, of: SurfaceGrid) -> tuple[int, int]:
    turn = np.mod(of.theta_rad - place.theta_rad + np.pi, 2 * np.pi) - np.pi
    return int(np.argmin(abs(of.z_mm - place.z_mm))), int(np.argmin(abs(turn)))


@pytest.mark.parametrize("place", PLACES)
def test_gdcm_finds_the_mark_in_mm(hd, tmp_path: Path, place: Place) -> None:
    of = grid()  # from θ = 0.3 rad and z = -0.5 mm
    export(write_marked(tmp_path / "wall.zarr", place, of), tmp_path / "wall.dicom")
    assert sorted(path.name for path in (tmp_path / "wall.dicom").glob("*.dcm")) == ["oct-image.dcm", "oct-relief.dcm"]
    read = sitk.ReadImage(str(tmp_path / "wall.dicom" / "oct-image.dcm"))
    np.testing.assert_allclose(read.GetSpacing()[:2], (2 * np.pi * 1.25 / 360, 0.05), rtol=1e-9)
    np.testing.assert_allclose(read.GetOrigin(), (0.3 * 1.25, -0.5, 0), rtol=1e-9)
    assert read.GetDirection() == (1, 0, 0, 0, 1, 0, 0, 0, 1)
    row, column = where(sitk.GetArrayFromImage(read)[0])
    arc_mm, z_mm, _ = read.TransformIndexToPhysicalPoint((column, row, 0))
    assert abs(z_mm - place.z_mm) <= 0.026
    turn = np.mod(arc_mm / RADIUS_MM - place.theta_rad + np.pi, 2 * np.pi) - np.pi
    assert abs(turn) <= 1.02 * np.pi / 360


def test_an_image_has_the_values_to_half_a_step_and_says_where_nothing_was_seen(folder: Path) -> None:
    image = pydicom.dcmread(folder / "oct-image.dcm")
    wanted = open_for_export(folder.parent / "bore Ä\\1").layer("oct", "intensity").read(0, 101)
    stored = image.pixel_array.astype(float)
    unseen = np.isnan(wanted)
    assert unseen[slice(*UNSEEN)].all()
    np.testing.assert_array_equal(stored == image.PixelPaddingValue, unseen)
    assert (stored[~unseen].min(), stored.max()) == (1, 65535)
    read = stored * float(image.RescaleSlope) + float(image.RescaleIntercept)
    assert abs(read - wanted)[~unseen].max() <= 0.501 * (np.nanmax(wanted) - np.nanmin(wanted)) / 65534
    assert image.PixelSpacingCalibrationDescription == "arc on a wall of radius 1.25 mm, and z"


def test_a_relief_is_a_map_of_depth_in_mm(hd, folder: Path) -> None:
    relief = hd.imread(folder / "oct-relief.dcm")
    assert relief.SOPClassUID == pydicom.uid.ParametricMapStorage
    frame = relief.get_frames(apply_real_world_transform=True)[0]
    of = grid(theta0_rad=0.0)
    row, column = where(frame)
    assert (row, column) == sample_of(PLACE, of)
    assert abs(frame[row, column] - DEPTH_MM) < 0.01
    assert np.isnan(frame[slice(*UNSEEN)]).all()
    assert np.isfinite(frame).sum() == 98 * 360
    (mapping,) = relief.SharedFunctionalGroupsSequence[0].RealWorldValueMappingSequence
    assert mapping.MeasurementUnitsCodeSequence[0].CodeValue == "mm"
    assert (mapping.RealWorldValueSlope, mapping.RealWorldValueIntercept) == (1, 0)
    assert mapping.DoubleFloatRealWorldValueLastValueMapped == np.nanmax(frame)
    assert mapping.QuantityDefinitionSequence[0].ConceptCodeSequence[0].CodeMeaning == "Depth"
    measures = relief.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0]
    np.testing.assert_allclose(measures.PixelSpacing, (0.05, 2 * np.pi * 1.25 / 360))


def test_a_reader_displays_what_is_displayed_well(hd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.workbench.exporting.dicom_files.contrast_of", lambda layer: (-0.25, 0.75))
    export(write_marked(tmp_path / "wall.zarr", PLACE), tmp_path / "wall.dicom")
    image, relief = (pydicom.dcmread(tmp_path / "wall.dicom" / f"oct-{name}.dcm") for name in ("image", "relief"))
    (of_relief,) = relief.SharedFunctionalGroupsSequence[0].FrameVOILUTSequence
    for window in (image, of_relief):
        assert (window.WindowCenter, window.WindowWidth) == (0.25, 1.0)


@pytest.mark.parametrize(("side", "turned_rad"), [("endoscope", 0.5), ("oct", 0.0)])
def test_cells_lie_on_the_image_of_their_side(hd, folder: Path, side: str, turned_rad: float) -> None:
    cells, image = hd.seg.segread(folder / f"{side}-cells.dcm"), pydicom.dcmread(folder / f"{side}-image.dcm")
    assert cells.segmentation_type == hd.seg.SegmentationTypeValues.BINARY
    assert cells.FrameOfReferenceUID == image.FrameOfReferenceUID
    (segment,) = cells.SegmentSequence
    assert (segment.SegmentLabel, segment.SegmentAlgorithmName) == (f"{side} cells", "endoct")
    mask = cells.get_pixels_by_source_instance([image.SOPInstanceUID])[0, ..., 0]
    of = grid(theta0_rad=0.0)
    expected = sample_of(Place(PLACE.theta_rad + turned_rad, PLACE.z_mm), of)
    rows, columns = np.nonzero(mask)
    assert (round(rows.mean()), round(columns.mean())) == expected
    # where a bump of 0.08 mm is above one half: a disc of radius 0.08·√(2 ln 2) mm
    area_mm2 = mask.sum() * 0.05 * 2 * np.pi * 1.25 / 360
    assert abs(area_mm2 - np.pi * 0.08**2 * 2 * np.log(2)) < 0.004
    read = sitk.ReadImage(str(folder / f"{side}-cells.dcm"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(read)[0] > 0, mask > 0)
    np.testing.assert_allclose(read.GetOrigin(), (0, -0.5, 0))
    np.testing.assert_allclose(read.GetSpacing()[:2], (2 * np.pi * 1.25 / 360, 0.05))


def test_nothing_is_said_of_a_patient(folder: Path) -> None:
    datasets = [pydicom.dcmread(path) for path in sorted(folder.glob("*.dcm"))]
    assert len(datasets) == 5
    for dataset in datasets:
        for empty in ("PatientName", "PatientID", "PatientBirthDate", "PatientSex", "StudyDate", "AccessionNumber"):
            assert not dataset[empty].value
        assert (dataset.ContentQualification, dataset.Manufacturer) == ("RESEARCH", "endoct")
        assert dataset.Modality in ("OT", "SEG")
        assert dataset.StudyDescription == "bore Ä_1"
        assert dataset.PositionReferenceIndicator in (None, "")
    assert len({dataset.StudyInstanceUID for dataset in datasets}) == 1
    assert len({dataset.SeriesInstanceUID for dataset in datasets}) == 5
    assert len({dataset.SOPInstanceUID for dataset in datasets}) == 5
    assert sorted(dataset.SeriesNumber for dataset in datasets) == [1, 3, 4, 5, 6]


def test_only_aligned_sides_share_a_frame(hd, folder: Path, tmp_path: Path) -> None:
    def frames(of: Path) -> set[str]:
        return {pydicom.dcmread(path).FrameOfReferenceUID for path in of.glob("*.dcm")}

    assert len(frames(folder)) == 1
    export(write_marked_comparison(tmp_path / "result", PLACE, alignment=None), tmp_path / "apart.dicom")
    assert len(frames(tmp_path / "apart.dicom")) == 2
    image = pydicom.dcmread(tmp_path / "apart.dicom" / "oct-image.dcm")
    assert image.SeriesDescription == "oct (not aligned) intensity"


def test_without_the_library_one_line_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "highdicom", None)
    store = write_marked(tmp_path / "wall.zarr", PLACE)
    with pytest.raises(EndoctError, match=r"not installed; found no highdicom.*pip install 'endoct\[dicom\]'"):
        export(store, tmp_path / "wall.dicom")
    assert not (tmp_path / "wall.dicom").exists()


def test_what_dicom_cannot_hold_is_refused(hd, folder: Path, tmp_path: Path) -> None:
    source = open_for_export(folder.parent / "bore Ä\\1")
    large = SurfaceGrid.full_circle(2, 65_536, z0_mm=0, dz_mm=0.1, radius_mm=1.25)
    for wrong, said in (
        (replace(source, grid=large), "too large for DICOM; found 2 × 65536"),
        (replace(source, layers=source.layers[-1:], kind="truth"), "has no image; found a truth"),
    ):
        with pytest.raises(EndoctError, match=said):
            write_dicom(wrong, tmp_path / "x.dicom", ExportRequest("", ""), SilentStages())
    assert not list(tmp_path.iterdir())
