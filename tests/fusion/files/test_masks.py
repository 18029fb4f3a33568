"""Masks drawn by hand: as a side, and as truth."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import zarr
from bore_pairs import Pair

from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.files.drawings import is_label_store
from endoct.fusion.files.masks import on_comparison, read_mask, score_surface
from endoct.fusion.result import Threshold

COARSE = CompareParameters(n_theta=512)
TOLERANCE_MM = 0.1
SIDECAR = 'modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.05\n'


def drawn(path: Path, mask: np.ndarray, *, white: int = 255) -> Path:
    cv2.imwrite(str(path), mask.astype(np.uint8) * white)
    return path


def test_a_mask_on_the_other_sides_panorama_lies_there(pair: Pair, tmp_path: Path) -> None:
    mask = read_mask(drawn(tmp_path / "m.png", pair.cells_b), pair.b)
    assert mask.panorama.modality == "mask"
    assert np.array_equal(mask.panorama.intensity > 0, pair.cells_b)
    found = compare_panoramas(mask, pair.b, COARSE)
    assert found.alignment is not None
    assert (found.alignment.theta_shift_rad, found.alignment.z_shift_mm) == (0.0, 0.0)
    assert found.result.threshold["mask"] == Threshold(value=None, unit="1", of="mask as given")
    assert found.result.own_rows_jaccard > 0.85


@pytest.mark.parametrize("zarr_format", [2, 3])
@pytest.mark.parametrize("kind", ["array", "levels", "ome"])
def test_labels_in_zarr_are_a_mask(kind: str, zarr_format: int, pair: Pair, tmp_path: Path) -> None:
    labels = np.where(pair.cells_b, 70000 * (1 + np.arange(pair.cells_b.shape[1])), 0).astype(np.uint32)
    path = tmp_path / "anna_2.zarr"
    if kind == "array":
        zarr.create_array(path, data=labels, zarr_format=zarr_format)
    else:
        group = zarr.open_group(path, mode="w", zarr_format=zarr_format)
        group.create_array("fine", data=labels[np.newaxis])
        group.create_array("coarse", data=labels[np.newaxis, ::2, ::2])
        told = {"multiscales": [{"datasets": [{"path": "fine"}, {"path": "coarse"}]}]}
        group.attrs.update({"ome": told} if kind == "ome" else told)
    mask = read_mask(path, pair.b)
    assert np.array_equal(mask.mask, pair.cells_b)
    assert (mask.rater, mask.session) == ("anna", "2")
    assert is_label_store(path)


@pytest.mark.parametrize(("attributes", "message"), [({}, "holds no labels"), (None, "an array of shape")])
def test_a_store_without_one_plane_of_labels_is_refused(
    attributes: dict[str, object] | None, message: str, tmp_path: Path
) -> None:
    if attributes is None:
        zarr.create_array(tmp_path / "m.zarr", data=np.ones((3, 4, 5), np.uint8))
    else:
        zarr.open_group(tmp_path / "m.zarr", mode="w", attributes=attributes)
    assert not is_label_store(tmp_path / "m.zarr")
    with pytest.raises(EndoctError, match=message):
        read_mask(tmp_path / "m.zarr")


def test_a_mask_with_a_sidecar_is_aligned(pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(SIDECAR)
    mask = read_mask(drawn(tmp_path / "m.tif", pair.cells_a, white=1))
    assert mask.grid == pair.a.grid
    found = compare_panoramas(mask, pair.b, COARSE)
    assert found.alignment is not None
    assert abs(wrap_rad(found.alignment.theta_shift_rad - pair.truth.theta_shift_rad)) < 0.01
    assert abs(found.alignment.z_shift_mm - pair.truth.z_shift_mm) < 0.05
    assert found.result.jaccard > 0.75
    assert np.array_equal(found.sides[0].mask & found.sides[0].valid, found.sides[0].mask)


def test_a_mask_tells_the_polarity_of_an_image(pair_of: Callable, tmp_path: Path) -> None:
    pair = pair_of(6, bright_cells=True)
    (tmp_path / "m.toml").write_text(SIDECAR)
    mask = read_mask(drawn(tmp_path / "m.png", np.roll(pair.cells_a, 50, axis=1)))
    found = compare_panoramas(pair.a, mask, COARSE)
    assert found.result.polarity == {"camera": "bright", "mask": None}
    assert found.result.jaccard > 0.75


def test_truth_scores_each_side(pair: Pair, tmp_path: Path) -> None:
    found = compare_panoramas(pair.a, pair.b, COARSE)
    truth = read_mask(drawn(tmp_path / "truth.png", pair.cells_a), pair.a)
    scores = score_surface(found, on_comparison(found, truth), TOLERANCE_MM)
    assert set(scores) == {"camera", "ranger"}
    assert scores["camera"].jaccard > 0.85
    assert scores["ranger"].jaccard > 0.7
    turned = read_mask(drawn(tmp_path / "t.png", np.roll(pair.cells_a, 30, axis=1)), pair.a)
    blurred = score_surface(found, on_comparison(found, turned), TOLERANCE_MM)
    assert blurred["camera"].jaccard < scores["camera"].jaccard - 0.2


def test_a_colour_mask_counts_any_channel(pair: Pair, tmp_path: Path) -> None:
    colour = np.zeros((*pair.cells_b.shape, 3), np.uint8)
    colour[..., 2] = pair.cells_b * 200
    cv2.imwrite(str(tmp_path / "m.png"), colour)
    assert np.array_equal(read_mask(tmp_path / "m.png", pair.b).mask, pair.cells_b)


@pytest.mark.parametrize(
    ("sidecar", "message"),
    [
        (None, "nothing says where the mask"),
        (SIDECAR.replace("dz_mm", "dz"), "unknown key 'dz'.*expected 'dz_mm'"),
        (SIDECAR.replace("dz_mm = 0.05", "dz_mm = 0"), "'dz_mm'.*cannot be used"),
        (SIDECAR.replace("z0_mm = 0.0\n", ""), "lacks 'z0_mm'"),
        (SIDECAR.replace('"mask"', '"oct"'), "'modality'.*cannot be used"),
        ("modality = ", "not valid TOML"),
    ],
)
def test_a_mask_that_nothing_places(sidecar: str | None, message: str, pair: Pair, tmp_path: Path) -> None:
    path = drawn(tmp_path / "m.png", pair.cells_a)
    if sidecar is not None:
        path.with_suffix(".toml").write_text(sidecar)
    with pytest.raises(EndoctError, match=message):
        read_mask(path, pair.b)


def test_an_empty_mask(pair: Pair, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="shows no cells"):
        read_mask(drawn(tmp_path / "m.png", np.zeros(pair.b.grid.shape, np.bool_)), pair.b)


def test_a_mask_on_bright_cells_tells_the_polarity_in_place(pair_of: Callable, tmp_path: Path) -> None:
    pair = pair_of(6, bright_cells=True)
    found = compare_panoramas(pair.a, read_mask(drawn(tmp_path / "m.png", pair.cells_a), pair.a), COARSE)
    assert found.result.polarity["camera"] == "bright"
    assert found.result.jaccard > 0.75
