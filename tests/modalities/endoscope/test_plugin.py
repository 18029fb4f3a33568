"""The plug-in as a whole, on a simulated specimen with truth and on frames made for one question."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
import xarray as xr
from skimage.filters import threshold_li
from tolerances import ANNULUS_PX, COORDINATE_ATOL, FRAME_ROLL_RAD, FRAME_Z_MM

from endoct.base.arrays import Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.conformance import CHECKS, Subject
from endoct.modalities.endoscope import plugin
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.manifest import MANIFEST
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.plugin import ENDOSCOPE
from endoct.modalities.recognition import open_recording
from endoct.stitching.blend import blend

N_SHORT = 7


def survey(path: Path, **overrides: Any) -> EndoscopeCalibration:
    _, stream = open_recording(path, modality="endoscope", overrides=overrides)
    return ENDOSCOPE.survey(stream, EndoscopeParameters())


def panorama(path: Path, calibration: EndoscopeCalibration) -> tuple[Image, Mask]:
    _, stream = open_recording(path)
    strips = thread_map(lambda frame: ENDOSCOPE.unroll(frame, calibration), stream)
    intensity, _, valid, _ = blend(strips, calibration.grid, calibration.row_z_mm)
    return intensity, valid


@pytest.fixture(scope="module")
def specimen(quick_specimen: Path) -> tuple[Path, dict[str, Any], EndoscopeCalibration]:
    truth = json.loads((quick_specimen / "truth" / "recording.json").read_text(encoding="utf-8"))["endoscope"]
    recording = quick_specimen / "endoscope"
    return recording, truth, survey(recording)


@pytest.fixture
def short(quick_specimen: Path, tmp_path: Path) -> Callable[..., Path]:
    """Make a recording of some of the specimen's frames, in the order asked for."""

    def make(*indices: int, name: str = "short", leave_out: tuple[str, ...] = ()) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        frames = sorted((quick_specimen / "endoscope").glob("frame_*"))
        for k, index in enumerate(indices):
            shutil.copy(frames[index], folder / f"frame_{k:04d}{frames[index].suffix}")
        lines = (quick_specimen / "endoscope" / "acquisition.toml").read_text(encoding="utf-8").splitlines()
        kept = [line for line in lines if line.split("=")[0].strip() not in leave_out]
        (folder / "acquisition.toml").write_text("\n".join(kept), encoding="utf-8")
        return folder

    return make


def test_the_annulus_is_where_it_was_drawn(specimen: tuple[Path, dict[str, Any], EndoscopeCalibration]) -> None:
    _, truth, calibration = specimen
    found = calibration.per_frame
    centre = np.array(truth["centre_px"])
    np.testing.assert_allclose(found["annulus_x_px"], centre[:, 0], atol=ANNULUS_PX)
    np.testing.assert_allclose(found["annulus_y_px"], centre[:, 1], atol=ANNULUS_PX)
    np.testing.assert_allclose(found["annulus_inner_px"], truth["inner_px"], atol=ANNULUS_PX)
    np.testing.assert_allclose(found["annulus_outer_px"], truth["outer_px"], atol=ANNULUS_PX)
    assert found["annulus_found"].all()


def test_every_frame_lies_where_it_was_taken(specimen: tuple[Path, dict[str, Any], EndoscopeCalibration]) -> None:
    _, truth, calibration = specimen
    off_mm = calibration.z_mm - np.array(truth["z_mm"])
    np.testing.assert_allclose(off_mm, np.median(off_mm), atol=FRAME_Z_MM)
    off_rad = wrap_rad(calibration.roll_rad + truth["theta_origin_rad"] - np.array(truth["roll_rad"]))
    np.testing.assert_allclose(off_rad, np.median(off_rad), atol=FRAME_ROLL_RAD)
    assert calibration.per_frame["pair_trusted"].all()
    assert calibration.z_mm.min() == 0


MIRROR_KEYS = ("cone_half_angle_deg", "focal_px", "mirror_distance_mm", "distortion")


def test_without_the_mirror_the_feed_tells_what_the_annulus_shows(
    specimen: tuple[Path, dict[str, Any], EndoscopeCalibration], short: Callable[..., Path]
) -> None:
    """The nominal feed errs by a tenth from frame to frame, so the length by no more than that over √n."""
    _, truth, calibration = specimen
    place_mm = np.array(truth["z_mm"])
    chosen = range(0, 12)
    recording = short(*chosen, name="bare", leave_out=(*MIRROR_KEYS, "visible_length_mm", "travel"))
    bare = survey(recording, travel=truth["travel"])
    assert any("does not give visible_length_mm" in note for note in bare.notes)
    stretched_by = np.ptp(bare.z_mm) / np.ptp(place_mm[list(chosen)])
    length_mm = calibration.optics.visible_length_mm * stretched_by
    assert bare.optics.visible_length_mm == pytest.approx(length_mm, rel=0.02)
    assert stretched_by == pytest.approx(1, abs=0.1)


def test_without_mirror_length_and_feed_nothing_can_be_said(short: Callable[..., Path]) -> None:
    recording = short(0, 1, leave_out=(*MIRROR_KEYS, "visible_length_mm", "feed_pitch_mm"))
    with pytest.raises(EndoctError, match="scale along the bore"):
        survey(recording)


def test_too_few_frames_do_not_tell_the_length(short: Callable[..., Path]) -> None:
    recording = short(0, 1, 2, leave_out=(*MIRROR_KEYS, "visible_length_mm"))
    with pytest.raises(EndoctError, match="visible_length_mm"):
        survey(recording)


def test_cells_stand_out_of_the_panorama(specimen: tuple[Path, dict[str, Any], EndoscopeCalibration]) -> None:
    """Thresholded by Li's method, against truth through the true transform."""
    recording, truth, calibration = specimen
    intensity, valid = panorama(recording, calibration)
    assert valid.mean() > 0.9
    with xr.open_zarr(recording.parent / "truth" / "wall.zarr", consolidated=False) as wall:
        rows = np.rint((calibration.row_z_mm + truth["z_origin_mm"]) / float(wall.z[1])).astype(int)
        theta = calibration.grid.theta_rad + truth["theta_origin_rad"]
        columns = np.rint(theta / float(wall.theta[1])).astype(int) % wall.sizes["theta"]
        cell = wall.cell.values[np.ix_(np.clip(rows, 0, wall.sizes["z"] - 1), columns)]
    darkness = np.clip(-np.log(np.maximum(intensity, 1e-6)), 0, 2)
    mask = darkness > threshold_li(darkness[valid])
    jaccard = (mask & cell & valid).sum() / ((mask | cell) & valid).sum()
    assert jaccard > 0.75
    assert np.median(intensity[valid & ~cell]) == pytest.approx(1, abs=0.1)


def test_what_is_drawn_over_the_picture_is_masked_and_doubted(
    specimen: tuple[Path, dict[str, Any], EndoscopeCalibration], short: Callable[..., Path]
) -> None:
    _, truth, clean = specimen
    assert clean.overlay is None
    recording = short(*range(9), name="drawn")
    (x, y), outer = np.mean(truth["centre_px"], axis=0), np.mean(truth["outer_px"])
    left, top = round(x - 0.8 * outer), round(y - 0.1 * outer)
    for k, file in enumerate(sorted(recording.glob("frame_*"))):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.rectangle(image, (left, top), (left + 60, top + 24), (0, 0, 0), -1)
        cv2.putText(image, f"N{k}", (left + 6, top + 18), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1)
        cv2.imwrite(str(file), image)
    calibration = survey(recording)
    assert calibration.overlay is not None
    assert calibration.overlay[top : top + 25, left : left + 61].all()
    assert calibration.overlay.mean() < 0.01
    (doubt,) = [doubt for doubt in calibration.doubts if doubt.code == "overlay-masked"]
    assert f"columns {np.flatnonzero(calibration.overlay.any(axis=0))[0]} to " in doubt.what
    np.testing.assert_allclose(np.diff(calibration.z_mm), np.diff(clean.z_mm[:9]), atol=FRAME_Z_MM)
    _, stream = open_recording(recording)
    strip = ENDOSCOPE.unroll(stream[4], calibration)
    of_angle = calibration.image_angle(4, strip.theta_rad)
    under = np.abs(wrap_rad(of_angle - np.arctan2(top + 12 - y, left + 30 - x))) < 0.02
    assert not strip.valid[:, under].all(axis=0).any()
    assert strip.valid[:, ~under].mean() > 0.9
    frame, _ = ENDOSCOPE.illustrate(stream[4], calibration)
    assert "overlay, masked" in frame.curves


def test_no_seam_where_theta_begins(specimen: tuple[Path, dict[str, Any], EndoscopeCalibration]) -> None:
    recording, _, calibration = specimen
    intensity, valid = panorama(recording, calibration)
    steps = np.abs(np.diff(intensity, axis=1, append=intensity[:, :1]))
    steps[~(valid & np.roll(valid, -1, axis=1))] = np.nan
    typical = np.nanmean(steps, axis=0)
    assert typical[-1] < 2 * np.median(typical)


def test_frames_overlap_without_bands(specimen: tuple[Path, dict[str, Any], EndoscopeCalibration]) -> None:
    """The rows' typical brightness on bone changes little from row to row: where strips begin and end too."""
    recording, _, calibration = specimen
    intensity, valid = panorama(recording, calibration)
    rows = np.nanquantile(np.where(valid, intensity, np.nan), 0.6, axis=1)
    inner = slice(20, -20)
    assert np.abs(np.diff(rows[inner])).max() < 0.06


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_conformance(check: Callable[[Subject], None], conforming: Subject) -> None:
    check(conforming)


@pytest.fixture(scope="module")
def conforming(quick_specimen: Path, tmp_path_factory: pytest.TempPathFactory) -> Subject:
    folder = tmp_path_factory.mktemp("conforming")
    for name in ["acquisition.toml", *(f"frame_{k:04d}.png" for k in range(4))]:
        shutil.copy(quick_specimen / "endoscope" / name, folder / name)
    return Subject(MANIFEST, folder)


def test_a_picture_of_a_frame_is_reduced_but_never_enlarged(
    specimen: tuple[Path, dict[str, Any], EndoscopeCalibration], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, _, calibration = specimen
    frame = open_recording(recording)[1][0]
    height, width = frame.samples.shape[:2]
    assert max(height, width) < plugin.PICTURE_SIDE_PX
    assert plugin.picture_frame(frame, calibration)[0].image.shape[:2] == (height, width)
    monkeypatch.setattr(plugin, "PICTURE_SIDE_PX", width // 4)
    assert max(plugin.picture_frame(frame, calibration)[0].image.shape[:2]) == width // 4


def test_one_frame_is_a_recording(short: Callable[..., Path]) -> None:
    calibration = survey(short(5))
    assert calibration.z_mm.tolist() == [0.0]
    assert calibration.grid.n_z * calibration.grid.dz_mm == pytest.approx(calibration.optics.visible_length_mm, abs=0.1)


def test_the_order_of_recording_does_not_turn_the_wall(short: Callable[..., Path]) -> None:
    """Recorded inward and outward, frame by frame the same place in a bore whose z grows inward."""
    inward = survey(short(*range(N_SHORT), name="a"), travel="in", outer_rim="ahead")
    outward = survey(short(*reversed(range(N_SHORT)), name="b"), travel="out", outer_rim="ahead")
    np.testing.assert_allclose(outward.z_mm[::-1], inward.z_mm, atol=0.003)


def test_a_rim_not_given_is_told_from_the_travel(short: Callable[..., Path]) -> None:
    given = survey(short(*range(N_SHORT), name="a"), travel="in", outer_rim="ahead")
    moved_in = given.z_mm[-1] > given.z_mm[0]
    against = survey(short(*range(N_SHORT), name="b", leave_out=("outer_rim",)), travel="out" if moved_in else "in")
    assert against.optics.rim_sign == -1
    assert any("outer rim" in note for note in against.notes)
    np.testing.assert_allclose(against.z_mm, given.z_mm.max() - given.z_mm, atol=0.003)
    agreeing = survey(short(*range(N_SHORT), name="c", leave_out=("outer_rim",)), travel="in" if moved_in else "out")
    assert agreeing.optics.rim_sign == 1


def test_travel_is_known_by_the_sidecar(short: Callable[..., Path]) -> None:
    path = short(*range(3))
    assert survey(path, travel="in").travel_known
    assert not survey(path, travel="unknown").travel_known


def test_feed_and_roll_can_be_taken_for_even(short: Callable[..., Path]) -> None:
    path = short(*range(N_SHORT))
    _, stream = open_recording(path)
    even = ENDOSCOPE.survey(stream, EndoscopeParameters(correct_feed=False, correct_roll=False))
    pitch_mm = stream.acquisition.pitch_mm
    np.testing.assert_allclose(np.abs(np.diff(even.z_mm)), pitch_mm, atol=COORDINATE_ATOL)
    assert not np.ptp(even.roll_rad)
    found = survey(path)
    assert np.ptp(np.diff(found.z_mm)) > 0.01
    assert np.ptp(found.roll_rad) > 0.01


def test_a_scale_that_the_feed_contradicts_is_doubted(short: Callable[..., Path]) -> None:
    path = short(*range(N_SHORT))
    _, stream = open_recording(path)
    assert survey(path).doubts == ()
    stated = stream.acquisition.visible_length_mm
    (doubt,) = survey(path, visible_length_mm=1.4 * stated, focal_px=None).doubts
    assert doubt.code == "feed-against-nominal"
    assert "apart as measured and 0.200 mm by the nominal feed" in doubt.what
    assert (doubt.unit, doubt.expected) == ("mm", pytest.approx(0.2))
    assert doubt.value == pytest.approx(1.4 * 0.2, rel=0.1)


def test_an_annulus_too_narrow_for_rows_is_told(short: Callable[..., Path]) -> None:
    path = short(0, 1, 2)
    _, stream = open_recording(path)
    ring = survey(path).annuli[0]
    narrow = {"x": ring.outer_x_px, "y": ring.outer_y_px, "inner_px": ring.outer_px - 3, "outer_px": ring.outer_px}
    with pytest.raises(EndoctError, match="too narrow"):
        survey(path, annulus=narrow)
    with pytest.raises(EndoctError, match="farther apart than a frame reaches; found dz_mm = 5"):
        ENDOSCOPE.survey(stream, EndoscopeParameters(dz_mm=5))


def test_a_given_annulus_is_used(short: Callable[..., Path]) -> None:
    path = short(0, 1, 2, leave_out=("annulus",))
    free = survey(path)
    found = free.annuli[0]
    keys = {"x": found.outer_x_px, "y": found.outer_y_px, "inner_px": 1.03 * found.inner_px, "outer_px": found.outer_px}
    given = survey(path, annulus=keys)
    assert given.annuli[0].inner_px == pytest.approx(1.03 * found.inner_px)
    assert given.annuli[1].outer_x_px == pytest.approx(free.annuli[1].outer_x_px, abs=1.0)


def test_pages_of_sixteen_bits_are_the_same_wall(short: Callable[..., Path], tmp_path: Path) -> None:
    path = short(0, 1, 2)
    frames = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in sorted(path.glob("*.png"))]
    pages = tmp_path / "pages"
    pages.mkdir()
    tifffile.imwrite(
        pages / "frames.tif",
        np.stack([f[..., ::-1] if f.ndim == 3 else f for f in frames]).astype(np.uint16) * 257,
        photometric="rgb" if frames[0].ndim == 3 else "minisblack",
    )
    shutil.copy(path / "acquisition.toml", pages)
    eight, sixteen = survey(path), survey(pages)
    np.testing.assert_allclose(sixteen.z_mm, eight.z_mm, atol=1e-6)
    np.testing.assert_allclose(panorama(pages, sixteen)[0], panorama(path, eight)[0], atol=1e-4)


def test_without_a_scale_or_a_feed_the_error_says_what_is_missing(short: Callable[..., Path]) -> None:
    path = short(0, 1, leave_out=("visible_length_mm", "focal_px"))
    with pytest.raises(EndoctError, match="visible_length_mm"):
        survey(path)
    apart = short(0, 30, name="apart", leave_out=("feed_pitch_mm",))
    with pytest.raises(EndoctError, match="feed_pitch_mm"):
        survey(apart)


def test_frames_without_an_annulus_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, (240, 320), np.uint8))
    with pytest.raises(EndoctError, match="annulus"):
        survey(tmp_path, bore_diameter_mm=2.5, visible_length_mm=1.0)


def ring(shape: tuple[int, int]) -> np.ndarray:
    """A bright ring on dark ground, as a mirror shows a bore."""
    picture = cv2.circle(np.full(shape, 8, np.uint8), (shape[1] // 2, shape[0] // 2), 100, 170, -1)
    return np.asarray(cv2.circle(picture, (shape[1] // 2, shape[0] // 2), 30, 10, -1))


@pytest.mark.parametrize(
    ("samples", "claims"),
    [
        (ring((240, 320)), True),
        (np.repeat(ring((240, 320))[..., None], 3, axis=2), True),
        (np.full((240, 320, 3), 90, np.uint8), False),
        (cv2.circle(np.zeros((240, 320), np.uint8), (160, 120), 100, 200, -1), False),
        (np.random.default_rng(0).integers(60, 200, (240, 320), np.uint8), False),
    ],
    ids=["a grey ring", "a ring in colour", "colour without a ring", "a grey disc", "grey all over"],
)
def test_an_endoscope_is_known_by_its_annulus(samples: np.ndarray, claims: bool, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), samples)
    verdict = ENDOSCOPE.sniff(tmp_path)
    assert verdict.claims == claims
    assert verdict.reason
    if claims:
        assert verdict.certainty == "unsure"  # of a single image
        cv2.imwrite(str(tmp_path / "1.png"), samples)
        assert ENDOSCOPE.sniff(tmp_path).certainty == "likely"
        cv2.imwrite(str(tmp_path / "2.png"), np.zeros_like(samples))
        assert ENDOSCOPE.sniff(tmp_path).certainty == "unsure"


def test_the_simulated_endoscope_is_known_by_its_annulus(quick_specimen: Path) -> None:
    verdict = ENDOSCOPE.sniff(quick_specimen / "endoscope")
    assert (verdict.claims, verdict.certainty) == (True, "likely")
    assert not ENDOSCOPE.sniff(quick_specimen / "oct").claims


def test_of_the_real_images_only_those_with_a_ring_are_taken_for_an_endoscope(recordings: Path) -> None:
    claims = {file.parent.name: ENDOSCOPE.sniff(file) for file in recordings.glob("*/*.jpg")}
    assert {name: verdict.claims for name, verdict in claims.items()} == {
        "endoscope-circle": False,
        "omnidirectional": True,
        "pipe-end": True,
    }
    assert {verdict.certainty for verdict in claims.values() if verdict.claims} == {"unsure"}
    assert not ENDOSCOPE.sniff(recordings / "coronary-oct").claims
