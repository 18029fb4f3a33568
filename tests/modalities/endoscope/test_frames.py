"""What the measured feed says of the nominal one: a length, and a doubt, each as sure as the spread of the pairs."""

import re
from dataclasses import replace

import numpy as np
import pytest
from doubted import outside
from numpy.typing import NDArray

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.frames import DOUBTED_FEED, SURE_OF_FEED, place_frames
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.mirror.optics import assumed_cone
from endoct.modalities.endoscope.motion import Centring, Motion, scale_by_feed
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.motion.feed import Feed

BAND = Band(assumed_cone(60.0, 210.0, 1.0, 1.25), np.linspace(-0.5, 0.5, 60))


def feed_of(steps_mm: NDArray[np.float64], trusted: NDArray[np.bool_] | None = None) -> Feed:
    n = steps_mm.size + 1
    known = np.ones(n, np.bool_) if trusted is None else np.r_[True, trusted]
    z_mm = np.r_[0, np.cumsum(steps_mm)]
    return Feed(
        z_mm, np.zeros(n), np.zeros((n, 2)), np.zeros(2), (0.0, np.inf), np.ones(n), np.ones(n), known, 1, measured=True
    )


def around(ratio: float, sigma: float, n: int) -> NDArray[np.float64]:
    """Return ``n`` ratios (n,) with exactly that median and robust spread."""
    half = np.random.default_rng(0).normal(size=n // 2)
    both = np.r_[half, -half]
    return ratio + sigma * both / (1.4826 * np.median(np.abs(both)))


def doubts(ratios: NDArray[np.float64], trusted: NDArray[np.bool_] | None = None) -> tuple[Doubt, ...]:
    nominal = 0.2 * np.arange(ratios.size + 1)
    acquisition = EndoscopeAcquisition(
        modality="endoscope", bore_diameter_mm=2.5, feed_pitch_mm=0.2, visible_length_mm=1.0, travel="in"
    )
    motion, centring = Motion(feed_of(0.2 * ratios, trusted), BAND), Centring((0.0, 0.0), None)
    return tuple(outside(place_frames(motion, centring, nominal, acquisition, EndoscopeParameters())[0].doubts))


@pytest.mark.parametrize("n", [16, 64])
def test_a_feed_is_doubted_beyond_what_its_pairs_make_sure(n: int) -> None:
    sigma = 0.4
    sure = SURE_OF_FEED * 1.25 * sigma / np.sqrt(n)  # of a median
    assert sure > DOUBTED_FEED
    assert doubts(around(1 + 0.95 * sure, sigma, n)) == ()
    (doubt,) = doubts(around(1 + 1.05 * sure, sigma, n))
    assert (doubt.code, doubt.expected) == ("feed-against-nominal", pytest.approx(0.2))
    assert doubt.value == pytest.approx(0.2 * (1 + 1.05 * sure))


@pytest.mark.parametrize("ratio", [0.92, 1.08])
def test_a_feed_that_differs_by_little_is_not_doubted_however_sure(ratio: float) -> None:
    assert doubts(around(ratio, 0.001, 40)) == ()
    (doubt,) = doubts(around(1 + 2 * (ratio - 1), 0.001, 40))
    assert doubt.code == "feed-against-nominal"


def test_pairs_that_could_not_be_matched_are_no_evidence() -> None:
    ratios, trusted = around(1.0, 0.02, 12), np.ones(12, np.bool_)
    wrong = np.where(np.arange(12) < 8, 2.0, ratios)
    assert doubts(wrong) != ()
    trusted[:7] = False
    wrong[7] = ratios[7]
    assert doubts(wrong, trusted) == ()
    trusted[7] = False  # four are left
    assert doubts(2 * ratios, trusted) == ()


def test_a_length_by_the_feed_is_as_sure_as_the_pairs() -> None:
    nominal = 0.2 * np.arange(41)
    larger = around(1.25, 0.1, 40)
    ratio, note = scale_by_feed(feed_of(0.2 / larger), nominal, 0.8)
    assert ratio == pytest.approx(1.25)
    said = re.search(r"it is ([\d.]+) mm \(± ([\d.]+)%", note)
    assert said is not None
    assert [float(value) for value in said.groups()] == pytest.approx(
        [1.0, 100 * 1.25 * 0.1 / np.sqrt(40) / 1.25], abs=0.05
    )
    few = np.arange(40) < 4
    with pytest.raises(EndoctError, match="4 pairs of frames"):
        scale_by_feed(replace(feed_of(0.2 / larger), trusted=np.r_[True, few]), nominal, 0.8)
