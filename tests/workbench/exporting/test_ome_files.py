"""OME-Zarr, OME-TIFF and labels, read by other libraries: names, sizes in mm, and the marked place where it is."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import PIL.Image
import pytest
import SimpleITK as sitk
import tifffile
import zarr
from marked_wall import MARK, PLACES, RADIUS_MM, UNSEEN, Place, grid, write_marked, write_marked_comparison

from endoct.stitching.grid import SurfaceGrid
from endoct.workbench import export
from endoct.workbench.running.progress import SilentStages

OME = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"
HALF_SAMPLE = 0.5


def assert_is_marked(image: np.ndarray, at: tuple[float, float], step_mm: tuple[float, float], place: Place) -> None:
    """Assert that the brightest sample lies at ``place``, z and arc in mm, whatever the first column is."""
    row, column = np.unravel_index(np.nanargmax(image), image.shape)
    z_mm, arc_mm = at[0] + row * step_mm[0], at[1] + column * step_mm[1]
    assert abs(z_mm - place.z_mm) <= (HALF_SAMPLE + 0.01) * step_mm[0]
    assert _apart(arc_mm / RADIUS_MM, place.theta_rad) * RADIUS_MM <= (HALF_SAMPLE + 0.01) * step_mm[1]


def _apart(a_rad: float, b_rad: float) -> float:
    return abs(np.mod(a_rad - b_rad + np.pi, 2 * np.pi) - np.pi)


def _placed(dataset: dict[str, Any]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return what the specification has every dataset say: (translation, scale) of (y, x)."""
    scale, translation = dataset["coordinateTransformations"]
    assert (scale["type"], translation["type"]) == ("scale", "translation")
    return tuple(translation["translation"][-2:]), tuple(scale["scale"][-2:])


def _described(group: zarr.Group, version: str) -> dict[str, Any]:
    attributes = dict(group.attrs)
    if version == "0.5":
        assert attributes["ome"]["version"] == "0.5"
        return dict(attributes["ome"])
    assert attributes["multiscales"][0]["version"] == "0.4"
    return attributes


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("version", ["0.5", "0.4"])
def test_every_level_of_ome_zarr_shows_the_mark_in_mm(tmp_path: Path, place: Place, version: str) -> None:
    store = write_marked(tmp_path / "wall.zarr", place, grid(1500))
    exported = export(store, tmp_path / "wall.ome.zarr", version=version)  # type: ignore[arg-type]
    group = zarr.open_group(tmp_path / "wall.ome.zarr", mode="r")
    assert group.metadata.zarr_format == (3 if version == "0.5" else 2)
    attributes = _described(group, version)
    (multiscale,) = attributes["multiscales"]
    assert multiscale["axes"] == [
        {"name": "c", "type": "channel"},
        {"name": "y", "type": "space", "unit": "millimeter"},
        {"name": "x", "type": "space", "unit": "millimeter"},
    ]
    assert [channel["label"] for channel in attributes["omero"]["channels"]] == ["oct intensity", "oct relief (mm)"]
    assert exported.facts["levels"] == len(multiscale["datasets"]) == 3
    for dataset in multiscale["datasets"]:
        array = group[dataset["path"]]
        for channel in (0, 1):
            assert_is_marked(np.asarray(array[channel]), *_placed(dataset), place)
    assert np.isnan(group["0"][0, UNSEEN[0], 0])


@pytest.mark.parametrize("version", ["0.5", "0.4"])
def test_ngff_zarr_reads_what_the_specification_says(tmp_path: Path, version: str) -> None:
    ngff_zarr = pytest.importorskip("ngff_zarr", reason="ngff-zarr is not installed")
    folder = write_marked_comparison(tmp_path / "result", PLACES[0])
    export(folder, tmp_path / "both.ome.zarr", version=version)  # type: ignore[arg-type]
    read = ngff_zarr.from_ngff_zarr(tmp_path / "both.ome.zarr")
    assert [one.label for one in read.metadata.omero.channels] == [
        "endoscope intensity", "oct intensity", "oct relief (mm)",
    ]  # fmt: skip
    image = read.images[0]
    assert (image.axes_units["y"], image.axes_units["x"]) == ("millimeter", "millimeter")
    at, step_mm = ((of["y"], of["x"]) for of in (image.translation, image.scale))
    assert_is_marked(np.asarray(image.data[1]), at, step_mm, PLACES[0])


def test_what_mirrors_is_noticed() -> None:
    of = grid()
    image = np.zeros(of.shape)
    image[np.argmin(abs(of.z_mm - 1.9)), np.argmin(abs(of.theta_rad - 1.1))] = 1
    at, step_mm = (of.z0_mm, of.theta0_rad * RADIUS_MM), (of.dz_mm, of.dtheta_mm)
    place = Place(1.1, 1.9)
    assert_is_marked(image, at, step_mm, place)
    for wrong in (image[:, ::-1], image[::-1], np.roll(image, 2, axis=1)):
        with pytest.raises(AssertionError):
            assert_is_marked(wrong, at, step_mm, place)


def test_an_average_beyond_the_circle_goes_on_from_its_beginning(tmp_path: Path) -> None:
    of = grid(1111)  # odd at every level
    place = Place(of.theta0_rad - of.dtheta_rad / 2, 1.4)  # between the last column and the first
    export(write_marked(tmp_path / "wall.zarr", place, of), tmp_path / "wall.ome.zarr")
    group = zarr.open_group(tmp_path / "wall.ome.zarr", mode="r")
    arrays = [np.asarray(group[str(k)][0]) for k in range(3)]
    assert [array.shape[1] for array in arrays] == [1111, 556, 278]
    row = arrays[0].shape[0] and int(np.argmin(abs(of.z_mm - 1.4)))
    np.testing.assert_allclose(arrays[1][row, -1], arrays[0][row, [-1, 0]].mean(), rtol=1e-5)
    np.testing.assert_allclose(arrays[2][row, -1], arrays[0][row, [-3, -2, -1, 0]].mean(), rtol=1e-5)


def _ome(path: Path) -> tuple[ElementTree.Element, list[str]]:
    with tifffile.TiffFile(path) as file:
        pixels = ElementTree.fromstring(file.ome_metadata or "").find(f"{OME}Image/{OME}Pixels")
    assert pixels is not None
    return pixels, [str(channel.get("Name")) for channel in pixels.iter(f"{OME}Channel")]


@pytest.mark.parametrize("place", PLACES)
def test_ome_tiff_shows_the_mark_in_mm(tmp_path: Path, place: Place) -> None:
    of = grid(2500)
    export(write_marked(tmp_path / "wall.zarr", place, of), tmp_path / "wall.ome.tif")
    pixels, names = _ome(tmp_path / "wall.ome.tif")
    assert names == ["oct intensity", "oct relief (mm)"]
    assert (pixels.get("PhysicalSizeXUnit"), pixels.get("PhysicalSizeYUnit")) == ("mm", "mm")
    step_mm = float(pixels.get("PhysicalSizeY", "")), float(pixels.get("PhysicalSizeX", ""))
    np.testing.assert_allclose(step_mm, (of.dz_mm, of.dtheta_mm))
    plane = pixels.find(f"{OME}Plane")
    assert plane is not None
    at = float(plane.get("PositionY", "")), float(plane.get("PositionX", ""))
    with PIL.Image.open(tmp_path / "wall.ome.tif") as pages:  # another decoder than the one that wrote it
        assert pages.n_frames == 2
        for channel in range(2):
            pages.seek(channel)
            image = np.asarray(pages)
            assert image.shape == of.shape
            assert_is_marked(image, at, step_mm, place)
            assert np.isnan(image[UNSEEN[0], 0])
    with tifffile.TiffFile(tmp_path / "wall.ome.tif") as file:
        shapes = [level.shape for level in file.series[0].levels]
        assert shapes == [(2, 101, 2500), (2, 101, 1250), (2, 101, 625), (2, 101, 313)]
        factor = 8
        coarse = file.series[0].levels[-1].asarray()[0]
    coarse_at = at[0], at[1] + (factor - 1) / 2 * step_mm[1]
    assert_is_marked(coarse, coarse_at, (step_mm[0], factor * step_mm[1]), place)


def test_both_sides_are_channels_on_one_grid_and_cells_are_those_of_the_table(tmp_path: Path) -> None:
    place = PLACES[1]  # over the seam: one cell all the same
    folder = write_marked_comparison(tmp_path / "result", place)
    export(folder, tmp_path / "both.ome.tiff")
    assert _ome(tmp_path / "both.ome.tiff")[1] == ["endoscope intensity", "oct intensity", "oct relief (mm)"]
    exported = export(folder, tmp_path / "cells.tif", to="labels")
    assert exported.facts["channels"] == ["endoscope cells", "endoscope observed", "oct cells", "oct observed"]
    labels = tifffile.imread(tmp_path / "cells.tif")
    assert labels.dtype == np.uint16
    assert labels[2, :, 0].any()
    assert labels[2, :, -1].any()
    assert labels.max(axis=(1, 2)).tolist() == [1, 1, 1, 1]
    assert not labels[3, slice(*UNSEEN)].any()
    assert labels[1].all()
    export(folder, tmp_path / "both.ome.zarr")
    group = zarr.open_group(tmp_path / "both.ome.zarr", mode="r")
    assert isinstance(group["labels"], zarr.Group)
    cells = group["labels/oct-cells"].attrs["ome"]
    assert group["labels"].attrs["ome"]["labels"][2] == "oct-cells"
    assert cells["image-label"] == {"source": {"image": "../../"}}
    assert _placed(cells["multiscales"][0]["datasets"][0]) == ((-0.5, 0.0), (0.05, grid().dtheta_mm))
    np.testing.assert_array_equal(group["labels/oct-cells/0"][...], labels[2])
    assert group["0"].shape == (3, *grid().shape)


def test_sides_that_are_not_aligned_say_so(tmp_path: Path) -> None:
    folder = write_marked_comparison(tmp_path / "result", PLACES[0], alignment=None)
    exported = export(folder, tmp_path / "both.ome.tif")
    assert _ome(tmp_path / "both.ome.tif")[1][1] == "oct (not aligned) intensity"
    assert re.search("not aligned", exported.notes[0])


def test_uneven_rows_become_even_ones_and_gaps_stay_open(tmp_path: Path) -> None:
    z_mm = np.delete(grid().z_mm, [60, 61, 62])
    of = SurfaceGrid.full_circle(z_mm.size, 360, z0_mm=-0.5, dz_mm=0.05, radius_mm=RADIUS_MM).with_rows(z_mm)
    place = PLACES[3]  # beyond the gap
    exported = export(write_marked(tmp_path / "wall.zarr", place, of), tmp_path / "wall.ome.zarr")
    assert any("unevenly" in note for note in exported.notes)
    image = np.asarray(zarr.open_group(tmp_path / "wall.ome.zarr", mode="r")["0"][0])
    assert image.shape[0] == 101
    assert np.isnan(image[61]).all()
    assert np.nanmax(image) > 0.9 * MARK
    assert_is_marked(image, (-0.5, 0.0), (0.05, of.dtheta_mm), place)


class Watched(SilentStages):
    def __init__(self) -> None:
        super().__init__()
        self.shares: list[float] = []

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Callable[[float], None]]:
        yield self.shares.append


@pytest.mark.parametrize("to", ["ome-tiff", "labels"])
def test_ome_tiff_is_read_by_simpleitk_too(tmp_path: Path, to: Any) -> None:
    comparison = write_marked_comparison(tmp_path / "result", PLACES[0])
    exported = export(comparison, tmp_path / "x.ome.tif", to=to)
    image = sitk.ReadImage(str(tmp_path / "x.ome.tif"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), tifffile.imread(tmp_path / "x.ome.tif"))
    assert image.GetSpacing()[:2] == pytest.approx(exported.facts["step_mm"][::-1], rel=1e-5)  # type: ignore[index]


@pytest.mark.parametrize("rows", [40, 2100])
def test_ome_tiff_is_the_same_whenever_it_is_written(tmp_path: Path, rows: int) -> None:
    store = write_marked(tmp_path / "wall.zarr", PLACES[0], grid(rows))
    names = "one.ome.tif", "other.ome.tif"
    for name in names:
        export(store, tmp_path / name)
    one, other = ((tmp_path / name).read_bytes() for name in names)
    assert one == other
    assert re.search(rb'UUID="urn:uuid:\w{8}-\w{4}-5', one)  # made of what is in it, not of the machine and the time


def test_rows_of_all_channels_are_counted(tmp_path: Path) -> None:
    tall = SurfaceGrid.full_circle(700, 40, z0_mm=-0.5, dz_mm=0.01, radius_mm=RADIUS_MM)
    stages = Watched()
    exported = export(write_marked(tmp_path / "wall.zarr", PLACES[0], tall), tmp_path / "x.ome.tif", progress=stages)
    n_rows = 700 * len(exported.facts["channels"])  # type: ignore[arg-type]
    assert stages.shares[:3] == [512 / n_rows, 700 / n_rows, 1212 / n_rows]
