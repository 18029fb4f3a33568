"""Images that somebody else unrolled: what becomes of them, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.conformance import CHECKS, Check, Subject
from endoct.modalities.recognition import recognise
from endoct.modalities.registry import manifests
from endoct.stitching.panorama import Panorama
from endoct.workbench import unroll
from tests.modalities.unrolled.drawn import COUNT_MM, N_COLUMNS, N_ROWS, PITCH_MM, brightness, distances, pits, write

MASK = pits()
QUARTER = N_COLUMNS // 4


@pytest.fixture(scope="module", params=["intensity", "depth", "both"])
def subject(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Subject:
    folder, of = tmp_path_factory.mktemp("image"), request.param
    write(folder, None if of == "depth" else brightness(MASK), None if of == "intensity" else distances(MASK))
    return Subject(manifests()["unrolled"], folder)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_conforms(check: Check, subject: Subject) -> None:
    check(subject)


def unrolled(folder: Path) -> Panorama:
    return unroll(folder)


def test_rows_and_columns_lie_where_the_sidecar_says(tmp_path: Path) -> None:
    image = brightness(MASK)
    plain = unrolled(write(tmp_path / "a", image))
    assert plain.grid.shape == (N_ROWS, N_COLUMNS)
    assert np.allclose(plain.z_mm, PITCH_MM * np.arange(N_ROWS))
    assert np.array_equal(plain.intensity, image.astype(np.float32))
    assert plain.depth_mm is None
    assert plain.valid.all()
    assert plain.axial_scale.stated == {"row_pitch_mm": PITCH_MM}
    out = unrolled(write(tmp_path / "b", image, travel="out"))
    assert np.array_equal(out.intensity, plain.intensity[::-1])
    mirrored = unrolled(write(tmp_path / "c", image, handedness="mirrored"))
    assert np.array_equal(mirrored.intensity, plain.intensity[:, -np.arange(N_COLUMNS)])
    unknown = unrolled(write(tmp_path / "d", image, handedness="unknown", travel="unknown"))
    assert not unknown.handedness_known
    assert not unknown.travel_known
    assert plain.handedness_known
    assert plain.travel_known


def test_positions_and_a_tables_first_column_say_where_rows_lie(tmp_path: Path) -> None:
    positions = tuple(float(z) for z in 3.0 * np.arange(N_ROWS) ** 1.1)
    image = unrolled(write(tmp_path / "a", brightness(MASK), row_pitch_mm=None, positions_mm=positions))
    assert np.allclose(image.z_mm, positions)
    folder = write(tmp_path / "b", brightness(MASK), row_pitch_mm=None, z_column_mm=1000, intensity_file="wall.csv")
    lines = [f"{106.8 + 0.006 * k:.3f}," + ",".join(map(str, row)) for k, row in enumerate(brightness(MASK))]
    (folder / "wall.csv").write_text("depth," + ",".join(map(str, range(N_COLUMNS))) + "\n" + "\n".join(lines))
    table = unrolled(folder)
    assert np.allclose(table.z_mm, 6.0 * np.arange(N_ROWS), atol=1e-6)
    assert np.array_equal(table.intensity, image.intensity)


def test_brightness_is_green_and_may_be_turned_around(tmp_path: Path) -> None:
    image = brightness(MASK)
    colours = np.stack([image // 2, image, image // 3], axis=2)
    assert np.array_equal(unrolled(write(tmp_path / "a", colours)).intensity, image.astype(np.float32))
    inverted = unrolled(write(tmp_path / "b", 255 - image, brighter="smaller"))
    assert np.array_equal(inverted.intensity, (image - image.min()).astype(np.float32))


def test_padding_dead_columns_and_what_was_not_observed_are_not_valid(tmp_path: Path) -> None:
    image = brightness(MASK).astype(np.float32)
    padded = np.pad(image, ((2, 3), (1, 4)), constant_values=7)
    padded[5, 11], padded[6, 12] = -999.25, np.nan
    span = {"rows": (2, N_ROWS + 1), "columns": (1, N_COLUMNS)}
    shown = unrolled(write(tmp_path, padded, **span, dead_columns=(21,), invalid_values=(-999.25,)))
    expected = np.ones((N_ROWS, N_COLUMNS), np.bool_)
    expected[:, 20] = expected[3, 10] = expected[4, 11] = False
    assert np.array_equal(shown.valid, expected)
    assert np.array_equal(shown.intensity[expected], image[expected])


@pytest.mark.parametrize("smaller", [False, True])
def test_the_sine_of_a_probe_off_the_axis_is_taken_off(tmp_path: Path, smaller: bool) -> None:
    counts = distances(MASK)
    keys = {"deeper": "smaller"} if smaller else {}
    panorama = unrolled(write(tmp_path, None, -counts if smaller else counts, **keys))
    depth_mm, values = panorama.depth_mm, {name: one.values for name, one in panorama.per_frame.items()}
    assert depth_mm is not None
    assert np.allclose(values["sine_amplitude_mm"], 1.2, atol=0.03)
    # the near wall lies in the direction of the offset: −e cos(θ − β) = e sin(θ − β − π/2)
    assert np.allclose(np.mod(values["sine_phase_rad"], 2 * np.pi), 2 * np.pi - 2.0 - np.pi / 2, atol=0.03)
    assert np.median(values["beam_noise_mm"]) == pytest.approx(0.03, rel=0.1)
    assert np.median(values["residual_mm"]) < 1.1 * np.median(values["beam_noise_mm"])
    assert np.quantile(np.abs(depth_mm[~MASK]), 0.9) < 0.06
    deep = depth_mm[panorama.valid & MASK]
    assert np.median(deep) == pytest.approx(3.0, abs=0.1)
    assert np.array_equal(panorama.intensity, depth_mm)


def test_a_beam_of_a_probe_off_the_axis_meets_the_wall_elsewhere(tmp_path: Path) -> None:
    """The probe is 8 mm off towards 0: its beam at 90° meets a wall of 40 mm at atan2(√(40² − 8²), 8) = 78.5°."""
    n = 360
    far = np.zeros((12, n), np.bool_)
    far[:, 80:101] = True
    panorama = unrolled(write(tmp_path, None, distances(far, offset_mm=8.0, direction_rad=0.0)))
    depth_mm = panorama.depth_mm
    assert depth_mm is not None
    deep = np.flatnonzero(np.median(depth_mm, axis=0) > 1.5)
    assert deep.mean() == pytest.approx(np.degrees(np.arctan2(np.sqrt(40**2 - 8**2), 8)), abs=1.2)


def test_a_turn_without_a_wall_is_bridged(tmp_path: Path) -> None:
    counts = distances(MASK)
    counts[7] = np.random.default_rng(5).uniform(0, 2000, N_COLUMNS)
    panorama = unrolled(write(tmp_path, None, counts))
    assert np.flatnonzero(panorama.per_frame["bridged"].values).tolist() == [7]
    assert np.flatnonzero(~panorama.valid.any(axis=1)).tolist() == [7]
    assert any("1 of 40 turns" in note for note in panorama.notes)


def test_travel_time_is_half_the_way_and_a_stated_zero_is_kept(tmp_path: Path) -> None:
    """2 mm/µs, 0.05 µs a count there and back: 0.05 mm a count."""
    keys = {"depth_mm_per_count": None, "travel_time_us_per_count": 0.05, "velocity_m_s": 2000.0}
    in_time = unrolled(write(tmp_path / "a", None, distances(MASK), **keys))
    in_mm = unrolled(write(tmp_path / "b", None, distances(MASK)))
    assert np.allclose(in_time.depth_mm, in_mm.depth_mm, equal_nan=True)
    counts = (MASK * 3 / COUNT_MM).astype(np.float32)
    above = unrolled(write(tmp_path / "c", None, counts, centred=True, zero_depth_mm=0.5))
    assert np.allclose(above.depth_mm, 0.5 + 3 * MASK, atol=1e-5)
    typical = unrolled(write(tmp_path / "d", None, counts + 100, centred=True))
    assert np.allclose(typical.depth_mm, 3 * MASK, atol=1e-5)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"travel": None}, "travel"),
        ({"handedness": None}, "handedness"),
        ({"theta_origin_rad": None}, "theta_origin_rad"),
        ({"intensity_file": None}, "intensity_file or depth_file"),
        ({"row_pitch_mm": None}, "one of row_pitch_mm, positions_mm and z_column_mm"),
        ({"positions_mm": (0.0, 1.0)}, "one of row_pitch_mm, positions_mm and z_column_mm"),
        ({"z_column_mm": 1.0, "row_pitch_mm": None}, "no table"),
        ({"depth_file": "wall.tif"}, "depth_mm_per_count"),
        ({"depth_file": "wall.tif", "depth_mm_per_count": 1.0}, "deeper"),
        ({"depth_file": "wall.tif", "depth_mm_per_count": 1.0, "deeper": "larger"}, "centred"),
        ({"depth_file": "wall.tif", "depth_mm_per_count": 1.0, "velocity_m_s": 1.0, "travel_time_us_per_count": 1.0},
         "not both"),
        ({"intensity_curve": "AMP"}, "is no log"),
        ({"intensity_file": "../wall.tif"}, "outside"),
        ({"intensity_file": "other.tif"}, "other.tif"),
        ({"columns": (0, 96)}, "'columns' lies outside"),
        ({"rows": (9, 3)}, "rows whose first"),
        ({"columns": (0, 20)}, "too few columns"),
        ({"dead_columns": (96,)}, "'dead_columns' lies outside"),
        ({"row_pitch_mm": None, "positions_mm": (0.0,) * N_ROWS}, "two rows lie at one place"),
        ({"bore_diameter_mm": 2001.0}, "bore_diameter_mm"),
    ],
)  # fmt: skip
def test_what_the_sidecar_does_not_say_is_refused_by_name(tmp_path: Path, keys: dict[str, object], said: str) -> None:
    folder = write(tmp_path, brightness(MASK), **keys)
    with pytest.raises(EndoctError) as error:
        recognise(folder).open()
    assert said in str(error.value)


def test_images_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    sizes = write(tmp_path / "sizes", brightness(MASK), distances(MASK)[:-1])
    with pytest.raises(EndoctError, match="differ in size"):
        recognise(sizes).open()
    colours = np.stack([brightness(MASK)] * 3, axis=2)
    colours[0, 0, 0] += 1
    depth = write(tmp_path / "colours", colours, intensity_file=None, **{
        "depth_file": "wall.tif", "deeper": "larger", "centred": True, "depth_mm_per_count": 1.0,
    })  # fmt: skip
    with pytest.raises(EndoctError, match="depth in colours"):
        recognise(depth).open()
    alone = write(tmp_path / "other", brightness(MASK))
    (alone / "second.tif").write_bytes((alone / "wall.tif").read_bytes())
    with pytest.raises(EndoctError, match="is of other files"):
        recognise(alone / "second.tif").open()
    assert len(recognise(alone / "wall.tif").open()) == N_ROWS
    nowhere = np.random.default_rng(1).uniform(0, 1e5, (12, N_COLUMNS)).astype(np.float32)
    with pytest.raises(EndoctError, match="no turn of the depth image"):
        unrolled(write(tmp_path / "noise", None, nowhere))


def test_an_image_that_is_no_full_turn_is_doubted(tmp_path: Path) -> None:
    image = brightness(MASK)
    assert unrolled(write(tmp_path / "whole", image)).doubts == ()
    for keys in ({}, {"handedness": "mirrored"}):
        half = unrolled(write(tmp_path / f"half{len(keys)}", image[:, : 2 * QUARTER], **keys))
        assert [doubt.code for doubt in half.doubts] == ["turn-not-closed"]
    twice = unrolled(write(tmp_path / "twice", np.hstack([image, image[:, :1]])))
    assert "repeats its first" in twice.doubts[0].what


def test_a_row_is_shown_in_the_images_colours(tmp_path: Path) -> None:
    colours = np.stack([brightness(MASK), brightness(MASK) // 2, brightness(MASK)], axis=2)
    subject = Subject(manifests()["unrolled"], write(tmp_path, colours))
    (picture,) = subject.modality.illustrate(subject.stream[3], subject.calibration)
    assert picture.image.shape == (N_ROWS, N_COLUMNS, 3)
    assert np.array_equal(picture.image, colours)
    assert picture.y_extent == (0.0, N_ROWS - 1.0)
    assert np.array_equal(picture.curves["this row"][:, 1], [3, 3])
    bare = replace(subject.stream[3], metadata={})
    assert subject.modality.illustrate(bare, subject.calibration)[0].image.shape == (1, N_COLUMNS)
