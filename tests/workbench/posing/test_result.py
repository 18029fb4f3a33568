"""What the outlook's file says, and how places and estimates are said: by hand."""

import numpy as np
import pytest

from endoct.fusion.pose import search
from endoct.fusion.pose.outlook import Outlook, Prospect, Tried, facts_of
from endoct.fusion.pose.pose import Estimate
from endoct.modalities.ct.trajectory import Trajectory
from endoct.workbench.posing import figures
from endoct.workbench.posing.result import Made, OutlookResult, estimate_text, in_convention, place_text

PLAN = Trajectory((1.0, 2.0, 3.0), (1.0, 6.0, 6.0))
GOOD = Tried(None, right=True, error_mm=0.1, turn_deg=1.0, deviation_mm=0.2, agreement=0.9, second=None)
RESULT = OutlookResult(
    Outlook(
        facts_of(np.zeros((40, 256), np.float32)),
        (
            Prospect("depth", tuple(Tried(None, True, mm, 0.0, 0.1, 0.9, None) for mm in (0.1, 0.3, 0.2))),
            Prospect("cells", (GOOD, Tried("no", True, 5.0, 0, 0, 0, 0.1), Tried(None, False, 4.0, 0, 0, 0, 0.1))),
        ),
    ),
    PLAN, "ras", np.zeros((2, 3), np.float32), Made({"ct": "ab"}, {"endoct": "1"}, {"seed": 3}, {"search": 1.5}), {},
)  # fmt: skip


def test_an_outlook_is_written_in_the_coordinates_asked_for() -> None:
    said = RESULT.to_json()
    assert said["plan"] == {"entry_mm": [-1, -2, 3], "target_mm": [-1, -6, 6], "length_mm": pytest.approx(5)}
    depth, cells = said["instruments"]["depth"], said["instruments"]["cells"]
    assert (depth["told"], depth["told_at_a_wrong_place"]) == (3, 0)
    assert (depth["median_error_mm"], depth["largest_error_mm"]) == (0.2, 0.3)
    assert (cells["told"], cells["told_at_a_wrong_place"]) == (1, 1)
    assert (cells["median_error_mm"], cells["largest_error_mm"]) == pytest.approx((2.05, 4.0))
    assert [one["error_mm"] for one in cells["rehearsals"]] == [0.1, 5.0, 4.0]
    assert said["level"] == depth["level"] == "well"
    assert cells["level"] == "hardly"
    assert RESULT.tellable
    assert said["inputs"] | said["versions"] | said["parameters"] | said["seconds"] == {
        "ct": "ab", "endoct": "1", "seed": 3, "search": 1.5,
    }  # fmt: skip
    assert said["doubts"] == []


def test_a_transform_changes_its_convention_on_the_side_of_the_patient() -> None:
    to_lps = np.array([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]], float)
    assert in_convention(to_lps, "ras").tolist() == [[0, 1, 0, -5], [-1, 0, 0, -6], [0, 0, 1, 7], [0, 0, 0, 1]]
    assert in_convention(to_lps, "lps").tolist() == to_lps.tolist()


def test_estimates_and_places_in_words() -> None:
    assert estimate_text(Estimate(-0.314, -0.4, 0.226)) == "−0.31 (−0.40 to 0.23)"
    assert estimate_text(Estimate(1.25, 1.0, 2.0), 1) == "1.2 (1.0 to 2.0)"
    assert place_text((12.46, -40.0, 7.06)) == "12.5, −40.0, 7.1"


def test_the_wall_of_a_plan_is_drawn_as_bone_on_its_own_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    show = figures.show_surface
    monkeypatch.setattr(figures, "show_surface", lambda axes, *given: shown.append(given) or show(axes, *given))
    monkeypatch.setattr(figures, "render", lambda figure, name: (figure, name))
    air = np.zeros((30, search.COLUMNS), np.float32)
    air[5, 7] = 0.75
    drawn = figures.draw_wall_of_plan(air, 1.2)
    ((grid, bone, known, _, *bounds),) = shown
    assert bone[5, 7] == 0.25
    assert (np.delete(bone.ravel(), 5 * bone.shape[1] + 7) == 1).all()
    assert known.all()
    assert bounds == [0.0, 1.0]
    assert (grid.n_z, grid.dz_mm, grid.radius_mm) == (30, search.ROWS_MM, 1.2)
    assert drawn.section == "wall"
