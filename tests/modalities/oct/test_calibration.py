"""Fixed lines of the detector that hide the bore's wall."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.modalities.oct.calibration import OctCalibration, notes_on_lines
from endoct.modalities.oct.doubts import doubts_of_lines
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.surface.fixed_lines import FixedLines
from tests.modalities.oct.phantom import BORE_MM, PIXEL_MM, Phantom
from tests.modalities.oct.unrolling import UnrollPhantom

N, WALL = 10, 200  # slices; the row of the wall where the catheter is on the axis


def hiding(surveyed: OctCalibration, first: int, n_rows: int, *, offset_mm: float = 0.0, faint: bool = False) -> Doubt:
    """The only doubt, or one called none: so many rows from ``first`` on are hidden in ``N`` equal slices."""
    excess = np.zeros(surveyed.n_depth, np.float32)
    background = replace(surveyed.background, line_excess=excess)
    excess[first : first + n_rows] = (0.5 if faint else 0.7) * background.contrast
    doubts = doubts_of_lines(replace(centred(surveyed, offset_mm), background=background))
    return doubts[0] if doubts else Doubt("none", "None.")


def centred(surveyed: OctCalibration, offset_mm: float) -> OctCalibration:
    capillary = replace(
        surveyed.capillary,
        x_mm=np.zeros(N),
        y_mm=np.full(N, offset_mm),
        axis_depth_mm=np.full(N, WALL * PIXEL_MM - BORE_MM),
    )
    return replace(surveyed, faces=replace(surveyed.faces, capillary=capillary, bridged=np.zeros(N, np.bool_)))


@pytest.fixture
def surveyed(unrolled: UnrollPhantom) -> OctCalibration:
    return unrolled(Phantom(n_slices=3, n_ascans=512), n_theta=512).calibration


def test_a_wall_under_a_wide_band_of_lines_is_doubted(surveyed: OctCalibration) -> None:
    doubt = hiding(surveyed, WALL - 5, 11)
    assert (doubt.code, doubt.value, doubt.expected) == ("wall-under-lines", 1.0, (0.0, 0.05))
    assert "100% of the bore's nominal wall" in doubt.what
    assert f"rows {WALL - 5}–{WALL + 5}" in doubt.what
    assert "0.07 mm off" in doubt.what
    assert hiding(surveyed, WALL, 11).value == hiding(surveyed, WALL - 10, 11).value == 1.0
    for first in (WALL + 1, WALL - 11):
        assert hiding(surveyed, first, 11).code == "none", "before the wall or behind it"
    assert hiding(surveyed, WALL - 5, 9).code == "none", "narrow enough to be bridged"
    assert hiding(surveyed, WALL - 5, 11, faint=True).code == "none", "seen through"
    assert hiding(surveyed, WALL, surveyed.n_depth).value == 1.0, "to the last row"


def test_the_share_of_the_wall_under_lines_is_that_of_the_turn(surveyed: OctCalibration) -> None:
    """Off the axis by 20 rows, the wall's depth is that of a cosine, less up to a row."""
    deeper = hiding(surveyed, WALL, 40, offset_mm=20 * PIXEL_MM)
    assert deeper.value == pytest.approx(0.5, abs=0.03)
    # rows 216 to 226: beyond 15.5 rows of 20, where the cosine is over 0.775 (0.684 rad either way)
    assert hiding(surveyed, WALL + 16, 11, offset_mm=20 * PIXEL_MM).value == pytest.approx(2 * 0.684 / 6.283, abs=0.02)
    assert hiding(surveyed, WALL + 20, 40, offset_mm=20 * PIXEL_MM).value == pytest.approx(0.072, abs=0.02)


def test_bridged_slices_say_nothing_of_the_wall_under_lines(surveyed: OctCalibration) -> None:
    calibration = centred(surveyed, 0.0)
    excess = np.zeros(surveyed.n_depth, np.float32)
    excess[WALL - 5 : WALL + 6] = surveyed.background.contrast
    background = replace(surveyed.background, line_excess=excess)
    axis = np.where(np.arange(N) < 1, calibration.capillary.axis_depth_mm, 0.5)
    faces = replace(calibration.faces, capillary=replace(calibration.capillary, axis_depth_mm=axis))
    one_of_ten = replace(calibration, background=background, faces=faces)
    assert [doubt.value for doubt in doubts_of_lines(one_of_ten)] == [pytest.approx(0.1)]
    for bridged in (np.arange(N) < 1, np.ones(N, np.bool_)):
        assert doubts_of_lines(replace(one_of_ten, faces=replace(faces, bridged=bridged))) == ()


def test_a_wall_deeper_than_the_recording_lies_under_no_line(surveyed: OctCalibration) -> None:
    calibration = centred(surveyed, 0.0)
    excess = np.zeros(surveyed.n_depth, np.float32)
    excess[-11:] = surveyed.background.contrast
    deep = replace(calibration.capillary, axis_depth_mm=np.full(N, (surveyed.n_depth + 5) * PIXEL_MM - BORE_MM))
    background = replace(surveyed.background, line_excess=excess)
    beyond = replace(calibration, background=background, faces=replace(calibration.faces, capillary=deep))
    assert doubts_of_lines(beyond) == ()


def test_every_line_that_is_taken_out_is_noted() -> None:
    excess = np.array([0, 0.5, 0.5, 0, 2], np.float32)
    taken, kept = notes_on_lines(FixedLines(excess, np.array([1, 0, 0, 1, 0], np.bool_)))
    assert taken.startswith("Depth rows 1–2, 4 hold")
    assert kept.startswith("Depth rows 0, 3 may hold")


def test_a_pullback_is_doubted_for_its_lines_as_it_is_settled(unrolled: UnrollPhantom) -> None:
    _, calibration, panorama = unrolled(Phantom(n_slices=3, n_ascans=512), n_theta=512)
    assert panorama.doubts == ()
    excess = np.full(calibration.n_depth, calibration.background.contrast, np.float32)
    blind = replace(calibration, background=replace(calibration.background, line_excess=excess))
    assert "wall-under-lines" in [doubt.code for doubt in OCT.settle(panorama, blind).doubts]
