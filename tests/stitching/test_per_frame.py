"""Numbers per frame say what they mean; where nobody declared it, their names do."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.modalities.registry import manifests
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import Meaning, PerFrame, per_frame, stored_range, usual_meaning
from endoct.stitching.store import load_panorama, save_panorama

GRID = SurfaceGrid.full_circle(3, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
FLAGS = np.array([True, False, True])


@pytest.mark.parametrize(
    ("name", "values", "meaning"),
    [
        ("residual_mm", np.zeros(3), Meaning("residual", "mm")),
        ("frame_rate_hz", np.zeros(3), Meaning("frame rate", "Hz")),
        ("mm", np.zeros(3), Meaning("mm")),
        ("omega", np.zeros(3), Meaning("omega")),
        ("bridged", FLAGS, Meaning("bridged", "", False)),
        ("pair_trusted", FLAGS, Meaning("pair trusted", "", True)),
        ("pair_trusted", np.zeros(3), Meaning("pair trusted")),
        ("valid", np.zeros((3, 2), np.bool_), Meaning("valid")),
    ],
)
def test_a_name_says_what_nobody_declared(name: str, values: NDArray[np.generic], meaning: Meaning) -> None:
    assert usual_meaning(name, values) == meaning


def test_what_is_declared_counts() -> None:
    one = per_frame({"settled_known": FLAGS}, {"settled_known": Meaning("lost", trusted_when=False)})["settled_known"]
    np.testing.assert_array_equal(one.doubted, FLAGS)
    assert one.doubt == "lost"


def test_flags_that_speak_for_a_frame_differ_from_those_against_it() -> None:
    flags = per_frame(dict.fromkeys(("bridged", "pair_trusted", "rotation_known"), FLAGS), {})
    assert [one.doubt for one in flags.values()] == ["bridged", "pair not trusted", "rotation not known"]
    np.testing.assert_array_equal(flags["bridged"].doubted, FLAGS)
    np.testing.assert_array_equal(flags["pair_trusted"].doubted, ~FLAGS)
    assert not PerFrame(np.ones(3), "", "omega").doubted.any()


@pytest.mark.parametrize("name", ["oct", "endoscope"])
def test_flags_of_our_modalities_are_declared_as_their_names_say(name: str) -> None:
    for key, meaning in manifests()[name].per_frame.items():
        by_name = usual_meaning(key, np.zeros(3) if meaning.trusted_when is None else FLAGS)
        assert (meaning.unit, meaning.trusted_when) == (by_name.unit, by_name.trusted_when)
        PerFrame(np.zeros(3), meaning.unit, meaning.title, usual=meaning.usual)  # titles can be stored and drawn
        if meaning.trusted_when is not None:
            assert meaning.title == by_name.title


@pytest.mark.parametrize(
    ("values", "unit", "title", "trusted_when"),
    [
        (np.zeros(3), "", "<script>", None),
        (np.zeros(3), "$x", "x", None),
        (np.zeros(3), "", "two\nlines", None),
        (np.zeros(3), "", 3, None),
        (np.zeros(3), "", "x", True),
        (np.zeros((3, 2), np.bool_), "", "x", False),
    ],
)
def test_what_cannot_be_meant(values: NDArray[np.generic], unit: str, title: str, trusted_when: bool | None) -> None:
    with pytest.raises(EndoctError):
        PerFrame(values, unit, title, trusted_when)


@pytest.mark.parametrize("usual", [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_what_is_no_usual_range(usual: tuple[float, float]) -> None:
    with pytest.raises(EndoctError):
        PerFrame(np.zeros(3), "", "x", usual=usual)


@pytest.mark.parametrize("text", [None, "", "1", "1 2 3", "x y", "2 1", "nan 1", "-inf inf", 5])
def test_a_store_without_a_usual_range(text: object) -> None:
    assert stored_range(text) is None


def test_the_meaning_lies_in_the_store(tmp_path: Path) -> None:
    ones = np.ones(GRID.shape)
    given = {
        "slice_z_mm": PerFrame(GRID.z_mm, "mm", "place"),
        "settled": PerFrame(FLAGS, "", "settled", trusted_when=True),
        "lost": PerFrame(FLAGS, "", "lost", trusted_when=False),
        "noise_level": PerFrame(np.zeros((3, 2)), "dB", "level of noise"),
        "contrast": PerFrame(np.zeros(3), "", "contrast", usual=(0.3, 1.0)),
        "signal": PerFrame(np.zeros(3), "dB", "signal", usual=(15.0, float("inf"))),
    }
    made = Panorama(GRID, ones, None, ones > 0, ones, "oct", True, True, "slice", given)
    save_panorama(made, tmp_path / "p.zarr")
    loaded = load_panorama(tmp_path / "p.zarr").per_frame
    assert loaded.keys() == given.keys()
    for name, one in given.items():
        again = loaded[name]
        assert (again.unit, again.title, again.trusted_when, again.usual) == (
            one.unit, one.title, one.trusted_when, one.usual,
        )  # fmt: skip
        np.testing.assert_array_equal(again.values, one.values)
