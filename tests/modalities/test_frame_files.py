"""Which images of a folder are frames, in what order, and what their names say of their places."""

from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.reading.frame_files import FrameFiles, choose_frames
from endoct.modalities.reading.frame_names import read_names
from endoct.modalities.reading.numbering import Along, positions_along, spacing_of


def order(*names: str) -> list[str]:
    return [name.path.name for name in read_names([Path(name) for name in names])[0]]


def chosen(folder: Path, contents: dict[str, str], *, alike: bool = False) -> FrameFiles:
    for name, content in contents.items():
        (folder / name).write_text(content)
    return choose_frames(folder, sorted(folder.iterdir()), lambda one, other: alike)


def codes(of: FrameFiles) -> list[str]:
    return [doubt.code for doubt in of.remarks.doubts]


@pytest.mark.parametrize(
    "names",
    [
        ["z0mm.png", "z0.2mm.png", "z0.25mm.png", "z0.4mm.png", "z1mm.png", "z1.2mm.png"],
        ["z0,2 mm.png", "z0,25 mm.png", "z1 mm.png"],
        ["z-0.4.png", "z-0.2.png", "z0.png", "z0.2.png"],
        ["z\u22122.png", "z\u22121.png", "z0.png", "z1.png"],
        ["z800um.png", "z1mm.png", "z1200um.png"],
        ["f (1).png", "f (2).png", "f (10).png"],
        ["f[9].png", "f[10].png", "f[11].png"],
        ["s1.8.png", "s1.9.png", "s1.10.png", "s1.11.png"],
        ["img-1.png", "img-2.png", "img-10.png"],
        ["2024-05-01_23-59-59-900.png", "2024-05-02_00-00-00-000.png", "2024-05-02_00-00-00-100.png"],
        ["F2.PNG", "f9.png", "f10.png"],
    ],
    ids=str,
)
def test_names_are_in_the_order_of_their_places(names: list[str]) -> None:
    assert order(*reversed(names)) == names


@pytest.mark.parametrize(
    ("names", "is_ambiguous"),
    [
        (["s1.8", "s1.9", "s1.10"], False),  # even as counts: no doubt
        (["s1.8", "s1.10"], True),  # two have no spacing
        (["s1.8", "s1.9", "s1.10", "s1.12"], True),
        (["a1.8", "b1.9", "b1.10"], True),
    ],
)
def test_names_that_count_evenly_leave_no_doubt(names: list[str], is_ambiguous: bool) -> None:
    assert read_names([Path(f"{name}.png") for name in names])[1] is is_ambiguous


def test_copies_are_left_out_by_their_bytes(tmp_path: Path) -> None:
    frames = {f"slice_{k:03d}.png": f"frame {k}" for k in range(6)}
    of = chosen(tmp_path, frames | {"slice_003 (1).png": "frame 3", "Copy of slice_000.png": "frame 0"})
    assert [file.name for file in of.files] == list(frames)
    assert "slice_003 (1).png" in of.remarks.notes[0]
    assert codes(of) == []


def test_a_frame_that_repeats_another_is_doubted_and_kept(tmp_path: Path) -> None:
    of = chosen(tmp_path, {f"slice_{k}.png": f"frame {k // 2}" for k in range(4)})
    assert len(of.files) == 4
    assert codes(of) == ["frames-repeated"]
    assert "slice_0.png = slice_1.png" in of.remarks.doubts[0].what


def test_images_in_two_formats_are_taken_once_if_their_pixels_agree(tmp_path: Path) -> None:
    contents = {f"s{k}{suffix}": f"{k}{suffix}" for k in range(4) for suffix in (".png", ".tif")}
    of = chosen(tmp_path, contents, alike=True)
    assert [file.name for file in of.files] == [f"s{k}.tif" for k in range(4)]
    with pytest.raises(EndoctError, match=r"s0\.png and s0\.tif"):
        chosen(tmp_path, contents, alike=False)


@pytest.mark.parametrize("other", ["s{}_filtered.png", "filtered_s{}.png", "s{} (1).png", "a{}.png"])
def test_two_series_are_refused_by_name(other: str, tmp_path: Path) -> None:
    contents = {f"s{k}.png": f"raw {k}" for k in range(4)} | {other.format(k): f"filtered {k}" for k in range(4)}
    with pytest.raises(EndoctError, match="several series") as caught:
        chosen(tmp_path, contents)
    assert "s0.png (4)" in str(caught.value)


def test_series_are_named_by_their_first_image_cut_short(tmp_path: Path) -> None:
    contents = {f"{letter * 80}{k}.png": f"{letter}{k}" for letter in "abcd" for k in (1, 2)}
    with pytest.raises(EndoctError) as caught:
        chosen(tmp_path, contents)
    assert caught.value.found == f"{'a' * 60} (2), {'b' * 60} (2), {'c' * 60} (2) and 1 more"


@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["run1_1", "run1_2", "run2_1", "run2_2"], "names-of-several-series"),
        (["id9_1", "id7_2", "id8_3"], "names-in-two-orders"),
        (["z-0.4mm", "z-0.2mm", "z-0.6mm"], "names-negative"),
        (["a", "b", "c"], "names-without-numbers"),
        (["f1", "f2x", "f3"], "names-of-several-forms"),
        (["z1.1", "z1.2", "z1.25", "z1.3", "z1.6"], "names-unclear"),
    ],
    ids=str,
)
def test_what_names_leave_open_is_doubted(names: list[str], code: str, tmp_path: Path) -> None:
    of = chosen(tmp_path, {f"{name}.png": name for name in names})
    assert code in codes(of)
    assert len(of.files) == len(names)


def test_an_image_that_is_no_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"overview.png \(1\)"):
        chosen(tmp_path, {f"s{k}.png": str(k) for k in range(5)} | {"overview.png": "all"})


def test_thousands_of_names_are_read_at_once(tmp_path: Path) -> None:
    files = [tmp_path / f"frame_{k:05d}.png" for k in range(5000)]
    names, unclear = read_names(list(reversed(files)))
    assert [name.path for name in names] == files
    assert not unclear


@pytest.mark.parametrize(
    ("values", "resolution", "kind", "places"),
    [
        ([0, 1, 2, 3], 1.0, "even", [0, 1, 2, 3]),
        ([0, 10, 20, 40, 50], 1.0, "gaps", [0, 1, 2, 4, 5]),
        ([0, 2, 4, 7, 10, 12, 27], 1.0, "uneven", None),
        ([0, 41, 79, 121, 159, 281, 320], 1.0, "gaps", [0, 1, 2, 3, 4, 7, 8]),  # ms that jitter
        ([0.0, 0.04, 0.08, 0.2, 0.24], 0.0, "gaps", [0, 1, 2, 5, 6]),
        ([0.0, 0.04, 0.13, 0.15, 0.2], 0.0, "uneven", None),
        ([0, 2, 1], 1.0, "uneven", None),
        ([0, 0, 0], 1.0, "uneven", None),
    ],
    ids=str,
)
def test_how_values_are_spaced(values: list[float], resolution: float, kind: str, places: list[float] | None) -> None:
    found = spacing_of(values, resolution)
    assert found.kind == kind
    if places is not None:
        np.testing.assert_allclose(found.places, places)


def test_times_become_places() -> None:
    lost = Along(np.array([0, 0.04, 0.08, 0.24, 0.28]), "s", "the time stamps", within=0.1)
    places, remarks = positions_along(lost, 0.2, 25.0, steady=True)
    assert places == pytest.approx((0, 0.2, 0.4, 1.2, 1.4))
    assert not remarks.doubts
    uneven = Along(np.array([0, 0.04, 0.1, 0.14, 0.21]), "s", "the time stamps", within=0.1)
    places, remarks = positions_along(uneven, 0.2, 25.0, steady=True)
    assert places == pytest.approx((0, 0.2, 0.5, 0.7, 1.05))
    _, remarks = positions_along(uneven, 0.2)
    assert [doubt.code for doubt in remarks.doubts] == ["frames-uneven"]
    faster = Along(np.arange(5) / 30, "s", "the time stamps", within=0.1)
    places, remarks = positions_along(faster, 0.2, 25.0, steady=True)
    assert places is None, "the sidecar's rate is believed; that it differs is doubted where the file states its own"
    assert not remarks.doubts


def test_a_count_that_began_anew_is_doubted(tmp_path: Path) -> None:
    of = chosen(tmp_path, {f"IMG_{number:04d}.png": str(number) for number in (9997, 9998, 9999, 0, 1, 2, 3)})
    _, remarks = positions_along(of.along, 0.2)
    assert [doubt.code for doubt in remarks.doubts] == ["frames-mostly-missing"]


def test_millimetres_in_names_are_held_against_the_pitch() -> None:
    even = Along(np.arange(5) * 0.1, "mm", "the numbers in names", resolution=0.01)
    places, remarks = positions_along(even, 0.2)
    assert places is None
    assert [doubt.code for doubt in remarks.doubts] == ["names-against-pitch"]
    assert positions_along(even, 0.1)[1].doubts == ()
