"""Feed and roll by a method chosen by name: the bench's, or a stranger's, by the same entry points."""

import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, EntryPoints
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from tolerances import CHOSEN_FEED_MM, CHOSEN_ROLL_RAD

from endoct.base import entry_points as names
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian
from endoct.modalities.endoscope.chosen_feed import by_method
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.mirror.optics import assumed_cone
from endoct.modalities.endoscope.motion import Motion
from endoct.stitching.motion.feed import Feed
from endoct.stitching.strip import Strip

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
