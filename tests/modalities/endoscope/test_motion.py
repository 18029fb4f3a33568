"""The bore's axis from the drift of ring centres, against rays traced one by one; feed by a method chosen by name."""

import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, EntryPoints
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from tolerances import CHOSEN_FEED_MM, CHOSEN_ROLL_RAD

from endoct.base import entry_points as names
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone
from endoct.modalities.endoscope.motion import BoreAxis, Motion, bore_axis, by_method, probe_offsets
from endoct.stitching.motion.feed import Feed
from endoct.stitching.strip import Strip

RADIUS_MM, INNER_PX, OUTER_PX = 1.25, 60.0, 210.0
RIMS = Annulus(0, 0, INNER_PX, 0, 0, OUTER_PX)


def optics(half_angle_deg: float) -> ConeOptics:
    return ConeOptics(INNER_PX, OUTER_PX, float(np.deg2rad(half_angle_deg)), 430.0, 1.2, RADIUS_MM)


def place_on_wall(
    mirror: ConeOptics, r_px: np.ndarray, angle: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return z, from the apex, and θ about the bore's axis at ``off`` where rays at r, angle meet the wall."""
    a, d = mirror.half_angle_rad, mirror.mirror_distance_mm
    psi = np.arctan(r_px / mirror.focal_px)
    along = off[0] * np.cos(angle) + off[1] * np.sin(angle)
    rho = along + np.sqrt(along**2 - off @ off + RADIUS_MM**2)
    z = -d * np.cos(2 * a) + (rho + d * np.sin(2 * a)) / np.tan(2 * a - psi)
    return z, np.arctan2(rho * np.sin(angle) - off[1], rho * np.cos(angle) - off[0])


def centre(mirror: ConeOptics, r_px: float, off: np.ndarray) -> np.ndarray:
    """Return the centre of the circle of constant z near ``r_px``, fitted to where that z is seen."""
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    wanted = place_on_wall(mirror, np.array([r_px]), np.zeros(1), np.zeros(2))[0]

    def misfit(place: np.ndarray) -> np.ndarray:
        x, y = place[0] + r_px * np.cos(angle), place[1] + r_px * np.sin(angle)
        return place_on_wall(mirror, np.hypot(x, y), np.arctan2(y, x), off)[0] - wanted

    return np.asarray(least_squares(misfit, np.zeros(2)).x)


@pytest.mark.parametrize("half_angle_deg", [43.0, 45.0, 47.0])
def test_the_axis_is_found_and_tells_where_the_wall_is(half_angle_deg: float) -> None:
    mirror, off = optics(half_angle_deg), np.array([0.03, -0.02])
    inner, outer = (centre(mirror, r, off) for r in (INNER_PX, OUTER_PX))
    axis = bore_axis(tuple(inner - outer), RIMS, mirror, RADIUS_MM)
    assert axis is not None
    np.testing.assert_allclose([axis.x_mm, axis.y_mm], off, atol=1e-3)
    np.testing.assert_allclose(axis.shift_px, outer, atol=0.05)
    angle = np.linspace(0, 2 * np.pi, 32)
    cos, sin = axis.sway_rad(0.0, RADIUS_MM)
    theta = place_on_wall(mirror, np.full(32, 130.0), angle, off)[1]
    off_by = np.angle(np.exp(1j * (theta - angle - cos * np.cos(angle) - sin * np.sin(angle))))
    assert np.abs(off_by).max() < 1e-3


def test_an_assumed_cone_tells_most_of_it() -> None:
    mirror, off = optics(46.0), np.array([0.03, -0.02])
    inner, outer = (centre(mirror, r, off) for r in (INNER_PX, OUTER_PX))
    assumed = assumed_cone(INNER_PX, OUTER_PX, mirror.visible_length_mm, RADIUS_MM)
    axis = bore_axis(tuple(inner - outer), RIMS, assumed, RADIUS_MM)
    assert axis is not None
    assert np.hypot(axis.x_mm - off[0], axis.y_mm - off[1]) < 0.25 * np.hypot(*off)


def test_a_drift_beyond_reason_tells_nothing() -> None:
    assert bore_axis((40.0, 0.0), RIMS, optics(45.0), RADIUS_MM) is None


def test_sway_and_the_probes_place_turn_with_the_roll() -> None:
    """By what θ about the bore's axis differs from θ about the probe's, in directions of the wall."""
    off, roll = np.array([0.02, -0.035]), 0.8
    axis = BoreAxis(*off, (0.0, 0.0))
    cos, sin = axis.sway_rad(roll, RADIUS_MM)
    along = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    turned = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]) @ off
    true = np.arctan2(
        RADIUS_MM * np.sin(along) - turned[1], RADIUS_MM * np.cos(along) - turned[0]
    )  # θ about the axis of what lies at ``along`` about the probe, to first order
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (true - along))), cos * np.cos(along) + sin * np.sin(along), atol=2e-3
    )
    places = probe_offsets(axis, np.array([[cos, sin], [0.0, 0.01]]), RADIUS_MM)
    np.testing.assert_allclose([places["probe_offset_x_mm"][0], places["probe_offset_y_mm"][0]], -turned, atol=1e-12)
    assert places["probe_offset_x_mm"][1] == pytest.approx(-0.01 * RADIUS_MM)
    assert np.isnan(probe_offsets(None, np.zeros((2, 2)), RADIUS_MM)["probe_offset_x_mm"]).all()


ROWS, COLUMNS, N = 60, 256, 6
BAND = Band(assumed_cone(60.0, 210.0, 1.0, 1.25), np.linspace(-0.5, 0.5, ROWS))
NOMINAL_MM = 0.2 * np.arange(N)
Z_MM = NOMINAL_MM + np.array([0, 0.02, -0.02, 0.01, 0.03, 0.0])
ROLL_RAD = np.array([0, 0.05, -0.05, 0.1, 0.0, 0.05])
"""Of both signs: the texture moves over the seam."""


def textures() -> list[NDArray[np.float32]]:
    """Logarithms of strips of one wall, with noise, some of each not seen."""
    rng = np.random.default_rng(0)
    wall = gaussian(rng.standard_normal((200, COLUMNS)).astype(np.float32), 2.0, 3.0)
    made = []
    for z_mm, roll_rad in zip(Z_MM, ROLL_RAD, strict=True):
        rows = z_mm / BAND.row_mm + np.arange(ROWS)
        columns = roll_rad / (2 * np.pi) * COLUMNS + np.arange(COLUMNS)
        strip = map_coordinates(wall, np.broadcast_arrays(rows[:, None], columns), order=3, mode="grid-wrap")
        strip = (strip + 0.01 * rng.standard_normal(strip.shape)).astype(np.float32)
        strip[:5, 40:60] = np.nan
        made.append(strip)
    return made


def motion() -> Motion:
    one = np.ones(N)
    known = np.ones(N, np.bool_)
    feed = Feed(
        NOMINAL_MM, np.zeros(N), np.zeros((N, 2)), np.zeros(2), (0.0, np.inf), one, one, known, 1, measured=True
    )
    return Motion(feed, BAND)


def answer(**parts: object) -> SimpleNamespace:
    usual = {"z_mm": Z_MM, "roll_rad": ROLL_RAD, "trusted": np.ones(N, np.bool_)}
    return SimpleNamespace(**usual | parts)


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., object]], str]:
    """Register a function as somebody's method; returns its name."""

    def of(function: Callable[..., object]) -> str:
        module = ModuleType("somebodys_feed")
        module.function = function  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "somebodys_feed", module)
        entry = EntryPoint("theirs", "somebodys_feed:function", "endoct.bench.stitching")
        monkeypatch.setattr(names, "entry_points", lambda *, group: EntryPoints([entry]).select(group=group))
        return "theirs"

    return of


def test_a_method_of_the_bench_finds_feed_and_roll() -> None:
    found, doubt = by_method(motion(), "cross-correlation-prepared", textures(), BAND, NOMINAL_MM)
    np.testing.assert_allclose(found.feed.z_mm, Z_MM - Z_MM[0], atol=CHOSEN_FEED_MM)
    np.testing.assert_allclose(found.feed.roll_rad, ROLL_RAD - ROLL_RAD[0], atol=CHOSEN_ROLL_RAD)
    assert found.band is BAND
    assert doubt.code == "feed-by-method"
    assert doubt.value == pytest.approx(0.03, abs=0.02)  # our own was the nominal feed


def test_a_stranger_gets_what_the_bench_gives(register: Callable[..., str]) -> None:
    given: list[object] = []

    def theirs(strips: Sequence[Strip], nominal_pitch_mm: float) -> object:
        given.extend((strips, nominal_pitch_mm))
        return answer(trusted=np.array([False, True, False, True, True, True]))

    some = textures()
    found, _ = by_method(motion(), register(theirs), some, BAND, -NOMINAL_MM)
    strips, pitch_mm = given
    assert pitch_mm == pytest.approx(-0.2)
    for strip, texture in zip(strips, some, strict=True):
        seen = np.isfinite(texture)
        np.testing.assert_array_equal(strip.valid, seen)
        np.testing.assert_allclose(np.log(strip.intensity[seen]), texture[seen], atol=1e-5)
        np.testing.assert_array_equal(strip.z_mm, BAND.outward_mm)
    np.testing.assert_array_equal(found.feed.z_mm, Z_MM)
    np.testing.assert_array_equal(found.feed.trusted, [True, True, False, True, True, True])  # the first is where it is
    assert not found.feed.sway_rad.any()


def test_a_method_without_a_nominal_feed_is_refused(register: Callable[..., str]) -> None:
    with pytest.raises(EndoctError, match="needs the nominal feed"):
        by_method(motion(), register(lambda *_: answer()), textures(), BAND, None)


def _fails(*_: object) -> object:
    raise RuntimeError("out of\nideas")


@pytest.mark.parametrize(
    ("theirs", "message"),
    [
        (lambda *_: None, "answers no places"),
        (lambda *_: answer(z_mm=Z_MM[:-1]), "answers no places"),
        (lambda *_: answer(roll_rad=np.full(N, np.nan)), "answers no places"),
        (lambda *_: answer(trusted=np.ones(N)), "answers no places"),
        (_fails, "gives no answer; found RuntimeError"),
    ],
)
def test_a_wrong_answer_is_one_line(register: Callable[..., str], theirs: Callable[..., object], message: str) -> None:
    with pytest.raises(EndoctError, match=message) as caught:
        by_method(motion(), register(theirs), textures(), BAND, NOMINAL_MM)
    assert "\n" not in str(caught.value)
