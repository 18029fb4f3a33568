"""The annulus: drawn, noisy, notched, and in photographs that are not ours."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import RING_PX

from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.light import reduced_light
from endoct.modalities.endoscope.mirror.annulus import Annulus, Followed, find_annulus, follow
from endoct.modalities.endoscope.mirror.ring_search import settle_annuli
from endoct.modalities.endoscope.mirror.rings import Ring, fit_circle, trace_closed

TRUE = Annulus(152.3, 118.1, 52.7, 155.6, 121.4, 104.2)


def drawing(
    annulus: Annulus = TRUE,
    *,
    height: int = 240,
    width: int = 320,
    notches: bool = False,
    specular_px: float = 80.0,
    specular: float = 0.2,
) -> NDArray[np.float32]:
    """A bright textured ring on dark ground with soft edges, brighter on one side, with a specular ring in it."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width].astype(float)

    def disc(cx: float, cy: float, r: float) -> NDArray[np.float64]:
        return np.clip((r - np.hypot(x - cx, y - cy)) / 1.5 + 0.5, 0, 1)

    ring = disc(annulus.outer_x_px, annulus.outer_y_px, annulus.outer_px)
    ring = ring - disc(annulus.inner_x_px, annulus.inner_y_px, annulus.inner_px)
    light = 0.5 * (1 + 0.3 * (x - width / 2) / width)
    texture = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), 2.0)
    image = ring * light * (1 + 0.5 * texture)
    from_centre = np.hypot(x - annulus.outer_x_px, y - annulus.outer_y_px)
    image += specular * ring * np.exp(-0.5 * ((from_centre - specular_px) / 1.2) ** 2)
    if notches:
        for cx, cy, r in ((60, 80, 22), (250, 150, 25), (150, 65, 18)):
            image *= 1 - 0.9 * disc(cx, cy, r)
    image += 0.03 + 0.01 * rng.standard_normal(image.shape)
    return np.clip(image, 0, 1).astype(np.float32)


def assert_found(annulus: Annulus, expected: Annulus, atol: float = RING_PX) -> None:
    for name in ("inner_x_px", "inner_y_px", "inner_px", "outer_x_px", "outer_y_px", "outer_px"):
        assert getattr(annulus, name) == pytest.approx(getattr(expected, name), abs=atol), name


def test_both_rims_are_found_each_with_its_own_centre() -> None:
    assert_found(find_annulus(drawing()), TRUE)


def test_cells_on_the_rims_do_not_move_them() -> None:
    assert_found(find_annulus(drawing(notches=True)), TRUE, atol=3 * RING_PX)


def test_a_specular_ring_close_to_the_inner_rim_is_not_taken_for_it() -> None:
    assert_found(find_annulus(drawing(specular_px=57.0, specular=0.6)), TRUE, atol=2 * RING_PX)


def test_an_annulus_cut_by_the_image_is_found() -> None:
    wide = Annulus(160.0, 118.0, 60.0, 161.0, 121.0, 135.0)
    assert_found(find_annulus(drawing(wide)), wide)


def test_scaling_goes_there_and_back() -> None:
    assert_found(TRUE.scaled(3).scaled(1 / 3), TRUE, atol=1e-9)
    assert TRUE.scaled(2).outer_x_px == pytest.approx(2 * TRUE.outer_x_px + 0.5)


def test_the_centre_runs_from_one_rim_to_the_other() -> None:
    x, y = TRUE.centre_at(np.array([52.7, 78.45, 104.2]))
    np.testing.assert_allclose(x, [152.3, (152.3 + 155.6) / 2, 155.6])
    np.testing.assert_allclose(y, [118.1, (118.1 + 121.4) / 2, 121.4])


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((240, 320)), "blank"),
        (np.ones((240, 320)), "blank"),
        (np.random.default_rng(0).random((240, 320)), "no annulus"),
        (cv2.circle(np.zeros((240, 320)), (160, 120), 90, 1.0, -1), "no annulus"),
        (np.tile(np.linspace(0, 1, 320), (240, 1)), "no annulus"),
    ],
    ids=["black", "saturated", "noise", "a disc", "a slope"],
)
def test_where_there_is_none_the_error_says_so(image: NDArray[np.float64], message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        find_annulus(image.astype(np.float32))


def test_the_place_is_followed_and_the_radii_belong_to_the_recording() -> None:
    moves = [(0.0, 0.0), (1.5, -0.5), (-2.0, 2.5), (3.0, 1.0)]
    frames = [drawing(TRUE.moved(*move)) for move in moves]
    annuli, found = settle_annuli([follow(frame, TRUE) for frame in frames], TRUE, given=False)
    assert found.all()
    for annulus, move in zip(annuli, moves, strict=True):
        assert_found(annulus, TRUE.moved(*move))
    assert len({a.outer_px for a in annuli}) == 1


def test_an_annulus_that_jumped_is_found_again() -> None:
    moved = TRUE.moved(14.0, -9.0)
    followed = follow(drawing(moved), TRUE)
    assert followed.support > 0.25
    assert_found(followed.annulus, moved)


def test_a_frame_that_lost_its_rims_takes_the_place_of_those_around() -> None:
    good = [Followed(TRUE.moved(0.2 * k, 0.0), 1.0) for k in range(7)]
    good[3] = Followed(TRUE.moved(30.0, 5.0), 0.02)
    good[5] = Followed(TRUE.moved(9.0, 0.0), 1.0)  # clear, but apart from its neighbours
    annuli, found = settle_annuli(good, TRUE, given=False)
    assert np.flatnonzero(~found).tolist() == [3, 5]
    np.testing.assert_allclose([a.outer_x_px - TRUE.outer_x_px for a in annuli], 0.2 * np.arange(7), atol=1e-9)


def test_a_closed_trace_follows_a_path_over_the_seam() -> None:
    columns = np.round(20 + 8 * np.cos(2 * np.pi * np.arange(90) / 90 + 1.0)).astype(int)
    gain = 0.2 * np.random.default_rng(0).random((90, 40)).astype(np.float32)
    gain[np.arange(90), columns] = 1.0
    np.testing.assert_array_equal(trace_closed(gain), columns)
    np.testing.assert_array_equal(trace_closed(np.roll(gain, 31, axis=0)), np.roll(columns, 31))


def test_a_circle_ignores_a_third_of_the_points() -> None:
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * np.pi, 300)
    x, y = 40 + 25 * np.cos(angle), 30 + 25 * np.sin(angle)
    x[:100], y[:100] = rng.uniform(0, 80, (2, 100))
    assert fit_circle(x, y, (45.0, 26.0, 20.0)) == pytest.approx((40, 30, 25), abs=0.05)


@pytest.mark.parametrize("seed", range(20))
def test_points_on_a_line_make_no_circle_that_runs_away(seed: int) -> None:
    rng = np.random.default_rng(seed)
    along = rng.uniform(-300, 300, 240)
    x, y = 390 + 0.8 * along, 300 + 0.6 * along + rng.normal(0, 3, 240)
    assert 38 / 3 < fit_circle(x, y, (388.0, 302.0, 38.0))[2] < 38 * 3


def load(path: Path) -> tuple[NDArray[np.float32], int]:
    image = cv2.imread(str(path))
    assert image is not None
    factor = max(1, min(image.shape[:2]) // 480)
    return reduced_light(image, 255.0, factor)[0], factor


def test_the_mirror_camera_frame(recordings: Path) -> None:
    """Read off the picture: the mirror's rim, cut above and below, and the camera's own reflection in its middle."""
    image, factor = load(recordings / "omnidirectional" / "example.jpg")
    annulus = find_annulus(image).scaled(factor)
    assert (annulus.outer_x_px, annulus.outer_y_px, annulus.outer_px) == pytest.approx((980, 553, 594), abs=8)
    assert (annulus.inner_x_px, annulus.inner_y_px, annulus.inner_px) == pytest.approx((982, 551, 238), abs=12)


def test_the_pipe_end(recordings: Path) -> None:
    """Read off the picture: the sharp inner ring and the outside of the blurred one, which has another centre."""
    image, factor = load(next((recordings / "pipe-end").glob("*.jpg")))
    annulus = find_annulus(image).scaled(factor)
    assert (annulus.inner_x_px, annulus.inner_y_px, annulus.inner_px) == pytest.approx((2660, 1718, 1082), abs=20)
    assert annulus.outer_px == pytest.approx(2085, abs=60)
    assert annulus.outer_x_px - annulus.inner_x_px > 30


def test_an_image_circle_without_a_mirror_is_no_annulus(recordings: Path) -> None:
    image, _ = load(recordings / "endoscope-circle" / "demo.jpg")
    with pytest.raises(EndoctError, match="no annulus"):
        find_annulus(image)


def test_a_rim_that_the_mean_image_blurs_is_taken_as_the_frames_have_it() -> None:
    """A small inner rim, 8 % smaller in every frame than where it was found first."""
    true = Annulus(80.0, 60.0, 26.0, 80.0, 60.0, 100.0)
    blurred = replace(true, inner_px=28.1)
    annuli, found = settle_annuli([Followed(true.moved(k, 0), 0.5) for k in range(5)], blurred, given=False)
    assert found.all()
    assert annuli[0].inner_px == 26.0
    assert not settle_annuli([Followed(true, 0.5)] * 5, blurred, given=True)[1].any()


def test_rings_differ_in_their_places_or_their_radii() -> None:
    ring, aside, wider = Ring(0, 0, 10, True), Ring(3, 4, 12, True), Ring(0, 1, 17, True)
    assert (ring.apart_px(aside), ring.differs_px(aside), ring.differs_px(wider)) == (5, 5, 7)
    assert Ring(0, 0, 10, True, contrast=0.5, coverage=0.25).support == 0.125
    assert Annulus.of(ring, aside).rings[1].circle == aside.circle == (3, 4, 12)
