"""Distances of outlines on the cylinder: by hand, against surface-distance, around the seam."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from endoct.fusion.scoring.boundary import BoundaryDistances, boundary_distances, outline

DZ, COLUMN = 0.03, 0.02


def distances(a: NDArray[np.bool_], b: NDArray[np.bool_], valid: NDArray[np.bool_] | None = None) -> BoundaryDistances:
    valid = np.ones(a.shape, np.bool_) if valid is None else valid
    found = boundary_distances(outline(a, valid, DZ, COLUMN), outline(b, valid, DZ, COLUMN), a.shape[1] * COLUMN)
    assert found is not None
    return found


def rectangle(rows: slice, columns: list[int], shape: tuple[int, int] = (40, 60)) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.bool_)
    mask[rows, np.mod(columns, shape[1])] = True
    return mask


def test_a_shift_along_z_and_over_the_seam() -> None:
    a = rectangle(slice(10, 20), list(range(-5, 5)))
    down = distances(a, rectangle(slice(13, 23), list(range(-5, 5))))
    assert max(down.a_to_b_mm.max(), down.b_to_a_mm.max()) == pytest.approx(3 * DZ)
    assert down.within(3 * DZ + 1e-9) == 1
    assert down.within(2.5 * DZ) < 1
    across = distances(a, rectangle(slice(10, 20), list(range(-3, 7))))
    assert across.p95_mm == pytest.approx(2 * COLUMN)
    assert across.mean_mm < 2 * COLUMN
    same = distances(a, a)
    assert same.mean_mm == same.p95_mm == 0


def test_the_length_of_an_outline() -> None:
    found = outline(rectangle(slice(10, 20), list(range(-5, 5))), np.ones((40, 60), np.bool_), DZ, COLUMN)
    # a rectangle with its four corners cut
    cut = np.hypot(DZ, COLUMN) / 2
    assert found.length_mm.sum() == pytest.approx(2 * 9 * DZ + 2 * 9 * COLUMN + 4 * cut)


def test_the_end_of_what_was_seen_is_no_outline() -> None:
    a = rectangle(slice(0, 20), list(range(10, 30)))
    valid = np.ones(a.shape, np.bool_)
    valid[:, 25:] = False
    found = outline(a, valid, DZ, COLUMN)
    assert found.place_mm[:, 0].max() == pytest.approx(19.5 * DZ)
    assert found.place_mm[:, 1].max() < 24.5 * COLUMN
    assert found.place_mm[:, 0].min() == pytest.approx(0.5 * DZ)
    nothing = outline(np.zeros_like(a), valid, DZ, COLUMN)
    assert boundary_distances(found, nothing, 60 * COLUMN) is None


def test_labels_follow_the_pieces() -> None:
    one, two = rectangle(slice(5, 10), [0, 1, 2]), rectangle(slice(20, 30), [58, 59, 0])
    labels = one.astype(np.int32) + 2 * two.astype(np.int32)
    found = outline(one | two, np.ones_like(one), DZ, COLUMN, labels)
    assert set(found.label) == {1, 2}
    assert (found.label == (found.place_mm[:, 0] > 15 * DZ) + 1).all()


def test_every_piece_around_a_sample_has_its_label_also_over_the_seam() -> None:
    """Of cells of one sample each, a piece of outline has its sample at one corner only."""
    rng = np.random.default_rng(2)
    labels = np.zeros((40, 60), np.int32)
    places = [(row, column) for row in range(3, 38, 5) for column in range(3, 60, 7)]
    for number, (row, column) in enumerate(places, 1):
        labels[row + rng.integers(0, 3) - 1, column] = number
    found = outline(labels > 0, np.ones(labels.shape, np.bool_), DZ, COLUMN, labels)
    assert (np.bincount(found.label)[1:] == 4).all()
    for place, number in zip(found.place_mm, found.label, strict=True):
        row, column = np.argwhere(labels == number)[0]
        across = (place[1] / COLUMN - column + 30) % 60 - 30
        assert max(abs(place[0] / DZ - row), abs(across)) == pytest.approx(0.5)


@pytest.mark.filterwarnings("ignore")  # its own imports
def test_as_surface_distance_measures_a_tiled_wall() -> None:
    import surface_distance

    rng = np.random.default_rng(1)
    a, b = rng.random((2, 20, 30)) < 0.1
    found = distances(a, b)
    theirs = surface_distance.compute_surface_distances(*(np.tile(m, 5) for m in (a, b)), spacing_mm=(DZ, COLUMN))
    # the farthest of the middle turns is the farthest of all that do not look beyond the ends
    assert found.a_to_b_mm.max() <= theirs["distances_gt_to_pred"].max() + 1e-9
    ours, all_theirs = (np.unique(np.round(d, 6)) for d in (found.a_to_b_mm, theirs["distances_gt_to_pred"]))
    assert set(ours) <= set(all_theirs)


@pytest.mark.filterwarnings("ignore")
def test_as_surface_distance_measures_away_from_the_seam() -> None:
    import surface_distance

    rng = np.random.default_rng(3)
    z, x = np.mgrid[:60, :90]
    a, b = np.zeros((60, 90), np.bool_), np.zeros((60, 90), np.bool_)
    for _ in range(4):
        row, column, radius = rng.uniform(18, 42), rng.uniform(30, 60), rng.uniform(4, 9)
        a |= np.hypot(z - row, x - column) < radius
        b |= np.hypot(z - row - rng.normal(0, 1.5), x - column - rng.normal(0, 1.5)) < radius
    found = distances(a, b)
    theirs = surface_distance.compute_surface_distances(a, b, spacing_mm=(DZ, COLUMN))
    mean_a, mean_b = surface_distance.compute_average_surface_distance(theirs)
    areas = theirs["surfel_areas_gt"].sum(), theirs["surfel_areas_pred"].sum()
    assert found.a.length_mm.sum() == pytest.approx(areas[0])
    assert found.mean_mm == pytest.approx((mean_a * areas[0] + mean_b * areas[1]) / sum(areas))
    assert found.p95_mm == pytest.approx(surface_distance.compute_robust_hausdorff(theirs, 95))
    for tolerance in (0.013, 0.037, 0.107):
        assert found.within(tolerance) == pytest.approx(
            surface_distance.compute_surface_dice_at_tolerance(theirs, tolerance)
        )


@settings(max_examples=20, deadline=None)
@given(columns=st.integers(1, 59), masks=hnp.arrays(np.bool_, (2, 20, 60)))
def test_rolling_changes_nothing(columns: int, masks: NDArray[np.bool_]) -> None:
    a, b = masks
    a[5, 5], a[6, 5], b[7, 7], b[8, 7] = True, False, True, False
    before, after = distances(a, b), distances(np.roll(a, columns, axis=1), np.roll(b, columns, axis=1))
    assert after.mean_mm == pytest.approx(before.mean_mm)
    assert after.p95_mm == pytest.approx(before.p95_mm)
