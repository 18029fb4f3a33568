"""A side whose pitch is stated wrongly: at which scale it fits, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import make_pair
from tolerances import ALIGNMENT_Z_MM

from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS
from endoct.fusion.registration.align import fit_stretched, stretched
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import AxialScale, Panorama

USUAL = 0.95, 1.05
PITCH_MM = 0.2


def stating(b: Panorama, factor: float) -> Panorama:
    """``b`` as a sidecar makes it that states ``factor`` times the pitch."""
    scale = AxialScale({"pullback_pitch_mm": PITCH_MM * factor})
    return replace(b, grid=b.grid.with_rows(b.z_mm * factor), axial_scale=scale)


@pytest.mark.parametrize("factor", [0.6, 1.25])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_scale_that_agrees_is_found(factor: float, seed: int) -> None:
    pair = make_pair(seed, rows=45, mirrored=seed == 1)
    b = stating(pair.b, factor)
    found = fit_stretched(prepare(pair.a), prepare(b), ALL_ORIENTATIONS, USUAL)
    assert found is not None
    assert found.mirrored == pair.truth.mirrored
    off_mm = np.abs(found.z_to_a(b.z_mm) - pair.truth.z_to_a(pair.b.z_mm))
    assert off_mm[pair.truth.z_to_a(pair.b.z_mm) <= pair.a.z_mm[-1]].max() < ALIGNMENT_Z_MM


def test_a_scale_within_the_usual_search_is_none_beyond_it() -> None:
    pair = make_pair(rows=45, z_scale=1.02)
    assert stretched(clipped(prepare(pair.a)), clipped(prepare(pair.b)), ALL_ORIENTATIONS, USUAL) is None


@pytest.mark.parametrize("seed", [0, 1])
def test_another_bore_fits_at_no_scale(seed: int) -> None:
    pair = make_pair(seed, rows=45, other_bore=True)
    assert fit_stretched(prepare(pair.a), prepare(pair.b), ALL_ORIENTATIONS, USUAL) is None


@pytest.mark.parametrize("factor", [0.8, 0.93, 1.08, 1.25])
def test_a_false_pitch_is_named_with_its_true_value_aligned_or_not(factor: float) -> None:
    pair = make_pair(2, rows=45)
    result = compare_panoramas(pair.a, stating(pair.b, factor)).result
    if not result.aligned:
        assert result.reason is not None
        named = float(result.reason.split("pullback_pitch_mm = ")[1].split()[0])
    else:
        (doubt,) = (each for each in result.doubts if each.code == "pitch-contradicted")
        assert doubt.expected == pytest.approx(PITCH_MM * factor)
        assert doubt.value is not None
        named = doubt.value
    assert named == pytest.approx(PITCH_MM, rel=0.01)


def test_lost_slices_are_no_false_pitch() -> None:
    pair = make_pair(1, rows=45)
    rows = np.r_[0:20, 26:45]
    b = stating(pair.b, 1.0)
    assert b.depth_mm is not None
    short = replace(
        b,
        grid=SurfaceGrid.full_circle(
            rows.size, b.grid.n_theta, z0_mm=0.0, dz_mm=b.grid.dz_mm, radius_mm=b.grid.radius_mm
        ),
        **{name: getattr(b, name)[rows] for name in ("intensity", "depth_mm", "valid", "weight")},
    )
    result = compare_panoramas(pair.a, short).result
    assert not result.aligned or "parts-out-of-place" in [doubt.code for doubt in result.doubts]
    assert "pitch-contradicted" not in [doubt.code for doubt in result.doubts]
