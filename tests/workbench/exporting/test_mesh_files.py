"""PLY, STL and GLB, read by other libraries: a closed wall with holes, in mm, the right way round and in colour."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from marked_wall import DEPTH_MM, PLACES, RADIUS_MM, UNSEEN, Place, grid, write_marked, write_marked_comparison
from stl import mesh as numpy_stl

from endoct.base.errors import EndoctError
from endoct.workbench import export

VERTEX_MM = 0.05
M = 1e-3
NEAR_MM = 0.03


def read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return vertices in mm, faces, and colours (n, 3) or None."""
    if path.suffix == ".stl":
        corners = numpy_stl.Mesh.from_file(str(path)).vectors
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        return vertices, index.reshape(-1, 3), None
    loaded = trimesh.load(path, process=False)
    if isinstance(loaded, trimesh.Scene):
        (name,) = loaded.geometry
        one, (node,) = loaded.geometry[name], loaded.graph.geometry_nodes[name]
        in_metres = trimesh.transform_points(one.vertices, loaded.graph[node][0])
        return in_metres / M, one.faces, one.visual.vertex_attributes["color"][:, :3] / 65535 * 255
    return loaded.vertices, loaded.faces, np.asarray(loaded.visual.vertex_colors)[:, :3]


def assert_faces_the_axis(vertices: np.ndarray, faces: np.ndarray) -> None:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) * (1, 1, 0)
    assert ((normals * outward).sum(axis=1) < 0).all()


def _brightest(vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Return where on the nominal wall the middle of the brightest grey is; what was not observed is no grey."""
    grey = np.where(np.ptp(colours, axis=1) < 1, colours[:, 0], 0)
    middle = vertices[grey > 0.95 * grey.max()].mean(axis=0)
    return np.array([*middle[:2] * RADIUS_MM / np.hypot(*middle[:2]), middle[2]])


def _on_nominal_wall(place: Place) -> np.ndarray:
    return place.xyz_mm * (RADIUS_MM / (RADIUS_MM + DEPTH_MM), RADIUS_MM / (RADIUS_MM + DEPTH_MM), 1)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["wall.ply", "wall.stl", "wall.glb"])
def test_the_mark_is_the_farthest_place_of_the_wall(tmp_path: Path, place: Place, name: str) -> None:
    store = write_marked(tmp_path / "wall.zarr", place)
    export(store, tmp_path / name, vertex_mm=VERTEX_MM)
    vertices, faces, colours = read(tmp_path / name)
    radius_mm = np.hypot(vertices[:, 0], vertices[:, 1])
    weights = np.clip(radius_mm - RADIUS_MM - 0.6 * DEPTH_MM, 0, None)
    found_mm = (vertices * weights[:, np.newaxis]).sum(axis=0) / weights.sum()
    at = place.xyz_mm * (1, 1, 1)
    at[:2] *= np.hypot(*found_mm[:2]) / np.hypot(*at[:2])
    assert np.abs(found_mm - at).max() < NEAR_MM
    assert np.abs(found_mm - place.mirrored.xyz_mm).max() > NEAR_MM or abs(np.sin(place.theta_rad)) < 0.1
    assert radius_mm.max() > RADIUS_MM + 0.9 * DEPTH_MM
    assert np.abs(np.median(radius_mm) - RADIUS_MM) < 1e-3
    assert_faces_the_axis(vertices, faces)
    with pytest.raises(AssertionError):  # a mirror image would be noticed, also where it is of points alone
        assert_faces_the_axis(vertices * (1, -1, 1), faces)
    if colours is not None:
        assert np.abs(_brightest(vertices, colours) - _on_nominal_wall(place)).max() < NEAR_MM


def test_the_wall_has_no_seam_and_holes_where_nothing_was_observed(tmp_path: Path) -> None:
    store = write_marked(tmp_path / "wall.zarr", PLACES[0])
    export(store, tmp_path / "wall.ply", vertex_mm=VERTEX_MM)
    vertices, faces, _ = read(tmp_path / "wall.ply")
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    of, count = np.unique(edges, axis=0, return_counts=True)
    assert count.max() == 2
    rim = vertices[of[count == 1]].mean(axis=1)
    of_grid = grid()
    ends_mm = of_grid.z_mm[0], of_grid.z_mm[-1]
    hole_mm = of_grid.z_mm[UNSEEN[0] - 1] - 1e-6, of_grid.z_mm[UNSEEN[1]] + 1e-6
    at_ends = np.isclose(rim[:, 2], ends_mm[0], atol=1e-5) | np.isclose(rim[:, 2], ends_mm[1], atol=1e-5)
    around_hole = (rim[:, 2] > hole_mm[0]) & (rim[:, 2] < hole_mm[1])
    assert (at_ends | around_hole).all()
    assert around_hole.any()
    # vertices − edges + faces: 0 for a tube, one less for a hole
    assert len(vertices) - len(of) + len(faces) == -1


def test_a_comparison_has_the_relief_of_one_side_and_the_colours_of_either(tmp_path: Path) -> None:
    place = PLACES[1]
    folder = write_marked_comparison(tmp_path / "result", place)
    seen = Place(place.theta_rad + 0.5, place.z_mm)
    for color, bright in {"oct": place, "endoscope": seen}.items():
        for name in ("wall.ply", "wall.glb"):
            exported = export(folder, tmp_path / name, color=color, vertex_mm=VERTEX_MM, overwrite=True)
            assert (exported.facts["relief"], exported.facts["color"]) == ("oct relief", f"{color} intensity")
            vertices, _, colours = read(tmp_path / name)
            assert colours is not None
            assert np.abs(_brightest(vertices, colours) - _on_nominal_wall(bright)).max() < NEAR_MM
    flat = export(folder, tmp_path / "flat.stl", side="endoscope", vertex_mm=VERTEX_MM)
    vertices, _, _ = read(tmp_path / "flat.stl")
    assert flat.facts["relief"] is None
    np.testing.assert_allclose(np.hypot(vertices[:, 0], vertices[:, 1]), RADIUS_MM, atol=1e-5)


def test_the_colours_of_a_glb_are_linear_light(tmp_path: Path) -> None:
    store = write_marked(tmp_path / "wall.zarr", PLACES[0])
    for name in ("wall.ply", "wall.glb"):
        export(store, tmp_path / name, color="relief", vertex_mm=VERTEX_MM)
    srgb, light = read(tmp_path / "wall.ply")[2], read(tmp_path / "wall.glb")[2]
    assert srgb is not None
    assert light is not None
    share = srgb / 255
    expected = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4) * 255
    np.testing.assert_allclose(light, expected, atol=1)


def test_what_cannot_be_is_said(tmp_path: Path) -> None:
    folder = write_marked_comparison(tmp_path / "apart", PLACES[0], alignment=None)
    with pytest.raises(EndoctError, match=r"not aligned.*choose side='endoscope' too"):
        export(folder, tmp_path / "w.ply", color="endoscope")
    with pytest.raises(EndoctError, match="found microscope; expected endoscope or oct or relief"):
        export(folder, tmp_path / "w.ply", color="microscope")
    with pytest.raises(EndoctError, match="no such side; found microscope"):
        export(folder, tmp_path / "w.ply", side="microscope")
    with pytest.raises(EndoctError, match="vertices cannot have that distance"):
        export(folder, tmp_path / "w.ply", vertex_mm=0)
    with pytest.raises(EndoctError, match="stl has no option 'color'"):
        export(folder, tmp_path / "w.stl", color="oct")
    assert [path.name for path in tmp_path.iterdir()] == ["apart"]
