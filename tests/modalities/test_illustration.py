"""Places of the wall in frames as recorded: against the simulator's truth, and against how frames are unrolled."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tolerances import LOCATED_ASCANS, LOCATED_DEPTH_PX, LOCATED_PX, TABLED_PX

from benchmarks.located_places import oct_errors, pixel_errors, table_errors
from endoct.base.errors import EndoctError
from endoct.modalities.contract import Picture, Places, Seen
from endoct.modalities.illustration import illustrated, places_of
from endoct.modalities.oct.undistort import beam_angles_rad, depth_at_radius_mm, radius_mm, theta_at_radius
from endoct.stitching.strip import Strip
from endoct.workbench.page.recorded import picture_json
from endoct.workbench.report.pictures import load_pictures, save_pictures
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.sides.recordings import open_recording, unroll_recording


def unrolled(path: Path, **settings: object) -> Any:
    return unroll_recording(open_recording(path, settings=settings), SilentStages())


def test_the_beam_and_the_sample_that_see_a_place(small_specimen: Path) -> None:
    around, along = oct_errors(small_specimen)
    assert around.size > 3000
    assert np.median(np.abs(around)) < LOCATED_ASCANS
    assert np.median(np.abs(along)) < LOCATED_DEPTH_PX


def test_the_pixel_that_sees_a_place(small_specimen: Path) -> None:
    missed_px = pixel_errors(small_specimen)
    assert missed_px.size > 20_000
    assert np.median(missed_px) < LOCATED_PX


@pytest.mark.parametrize("name", ["oct", "endoscope"])
def test_between_the_places_of_a_table(small_specimen: Path, name: str) -> None:
    assert np.percentile(table_errors(small_specimen, name), 99) < TABLED_PX


@pytest.mark.parametrize("undistort", ["eccentric", "sine"])
def test_it_undoes_how_a_bscan_is_unrolled(small_specimen: Path, undistort: str) -> None:
    made = unrolled(small_specimen / "oct", undistort=undistort)
    calibration, index = made.calibration, 5
    theta_rad = calibration.grid.theta_rad
    nominal, recorded = beam_angles_rad(calibration, index, theta_rad)
    for depth_mm in (0.0, 0.4):
        radius = np.full(theta_rad.size, calibration.grid.radius_mm + depth_mm)
        deep = depth_at_radius_mm(calibration, index, nominal, radius)
        assert radius_mm(calibration, index, nominal, deep) == pytest.approx(radius)
    at_bore = theta_at_radius(calibration, index, nominal, np.full(theta_rad.size, calibration.grid.radius_mm))
    apart = np.angle(np.exp(1j * (at_bore - theta_rad)))[recorded]
    assert np.abs(apart).max() < 1e-3  # the glass's bend is found by three rounds
    # the brightest sample of the strip's column is that of the A-scan that is located
    strip = made.recording.manifest.load().unroll(made.recording.stream[index], calibration)
    places = Places(theta_rad, np.full(theta_rad.size, strip.z_mm[0]), strip.depth_mm[0].astype(float))
    found = made.recording.manifest.load().locate(index, places, calibration)
    assert found["bscan-undistorted"][recorded, 1] == pytest.approx(places.depth_mm[recorded] + radius[0] - 0.4)
    wall = next(
        p
        for p in made.recording.manifest.load().illustrate(made.recording.stream[index], calibration)
        if p.name == "bscan"
    )
    at = np.round(found["bscan"][:, 0] / calibration.grid.dtheta_rad).astype(int) % theta_rad.size
    drawn_mm = wall.curves["wall"][at, 1]
    known = recorded & strip.valid[0] & np.isfinite(drawn_mm)
    assert np.median(np.abs(found["bscan"][known, 1] - drawn_mm[known])) < 1e-3


def test_places_that_a_frame_does_not_show_are_not_seen(small_specimen: Path) -> None:
    for name, far_mm in (("oct", 1.0), ("endoscope", 5.0)):
        made = unrolled(small_specimen / name)
        _, places = places_of(made.recording.manifest.load().unroll(made.recording.stream[3], made.calibration))
        away = Places(places.theta_rad, places.z_mm + far_mm, places.depth_mm)
        for xy in made.recording.manifest.load().locate(3, away, made.calibration).values():
            assert np.isnan(xy).all()


def test_a_plug_in_that_does_not_locate_is_illustrated_all_the_same() -> None:
    picture = Picture("one", "one", np.zeros((4, 4)), "x (px)", "y (px)", (0.0, 3.0), (0.0, 3.0))

    class Without:
        def illustrate(self, frame: Any, calibration: Any) -> tuple[Picture, ...]:
            return (picture,)

    assert illustrated(Without(), None, None) == (picture,)  # type: ignore[arg-type]
    assert picture_json(picture, None)["seen"] is None


def test_what_is_seen_is_kept_with_pictures(tmp_path: Path) -> None:
    xy = np.array([[[0.5, 1.0], [2.5, np.nan], [np.nan, np.nan], [0.25, 3.0]]])
    seen = Seen(np.array([1.5]), xy)
    picture = Picture("one", "one", np.zeros((4, 4)), "θ (rad)", "y (mm)", (0.0, 6.0), (0.0, 3.0), seen=seen)
    save_pictures(tmp_path, "oct", "0001", [picture])
    (loaded,) = load_pictures(tmp_path)["oct"][1]
    assert loaded.seen is not None
    np.testing.assert_array_equal(loaded.seen.xy, xy)
    assert picture_json(loaded, None)["seen"] == {
        "z_mm": [1.5],
        "x": [[0.5, 2.5, None, 0.25]],
        "y": [[1.0, None, None, 3.0]],
    }
    (path,) = tmp_path.glob("*.npz")
    for z_mm, wrong in ((seen.z_mm, xy[..., :1]), (np.array([np.nan]), xy), (seen.z_mm, np.full_like(xy, np.inf))):
        arrays = dict(np.load(path))
        np.savez_compressed(path, **{**arrays, "seen_z_mm": z_mm, "seen_xy": wrong})
        with pytest.raises(EndoctError):
            load_pictures(tmp_path)
        np.savez_compressed(path, **arrays)


@pytest.mark.parametrize("n_rows", [1, 3])
def test_places_have_the_depth_of_the_nearest_beam(n_rows: int) -> None:
    """Columns begin at 1 rad; what lies there says its own angle as its depth."""
    n = 720
    theta_rad = 1 + 2 * np.pi / n * np.arange(n)
    depth_mm = np.tile(np.mod(theta_rad, 2 * np.pi), (n_rows, 1)).astype(np.float32)
    valid = np.ones((n_rows, n), np.bool_)
    valid[-1, np.abs(np.mod(theta_rad, 2 * np.pi) - 0.5) < 0.2] = False
    ones = np.ones((n_rows, n), np.float32)
    strip = Strip(0.1 * np.arange(1, n_rows + 1), theta_rad, ones, depth_mm, valid, ones)
    z_mm, places = places_of(strip)
    assert z_mm == pytest.approx(0.1 * np.arange(1, n_rows + 1))
    around = places.theta_rad.reshape(n_rows, -1)
    np.testing.assert_allclose(np.diff(around, axis=1), 2 * np.pi / around.shape[1])
    assert (around[:, 0] == 0).all()
    np.testing.assert_array_equal(places.z_mm.reshape(n_rows, -1), np.repeat(z_mm[:, None], around.shape[1], 1))
    depth = places.depth_mm.reshape(n_rows, -1)
    away_rad = np.abs(around[-1] - 0.5)
    assert np.isnan(depth[-1][away_rad < 0.19]).all()
    assert np.isfinite(depth[-1][away_rad > 0.21]).all()
    known = np.isfinite(depth)
    assert np.abs(np.angle(np.exp(1j * (depth - around)[known]))).max() <= np.pi / n + 1e-6
