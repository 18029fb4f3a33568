"""Sections of a report: whatever is drawn has its place in one of them."""

from pathlib import Path

import pytest
from markupsafe import Markup
from mock_comparison import Kind, write_comparison

from endoct.fusion.result import Reliefs, ReliefStratum
from endoct.workbench.report.sections import comparison_sections
from endoct.workbench.report.tables import relief_rows


def test_a_figure_that_belongs_to_no_section_is_an_error(tmp_path: Path) -> None:
    result = write_comparison(tmp_path / "comparison", Kind("endoscope", depth=False), Kind("oct"))
    sections = comparison_sections(result, {"depth": Markup("<figure></figure>")})
    assert "<figure>" in next(one.html for one in sections if one.name == "depth")
    with pytest.raises(ValueError, match="no section of the report takes the figures of deepness"):
        comparison_sections(result, {"deepness": Markup("<figure></figure>")})


def test_rows_of_reliefs_say_what_is_open_and_what_is_not_known() -> None:
    wall = ReliefStratum(
        low=None, to=0.05, area_mm2=5.996, mean=-0.011, median=-0.008, spread=0.025, low_limit=-0.073,
        high_limit=0.038, within_two_errors=0.995,
    )  # fmt: skip
    deep = ReliefStratum(low=0.7, to=None, area_mm2=0.0)
    between = ReliefStratum(low=0.05, to=0.7, area_mm2=1.0)
    reliefs = Reliefs(first="endoscope", second="oct", known=0.655, rim_mm=0.1, strata=(wall, between, deep))
    assert relief_rows(reliefs) == [
        ["below 0.05", "6.00 mm²", "−0.008 mm", "−0.011 mm", "0.025 mm", "−0.073 to 0.038", "0.995"],
        ["0.05 to 0.7", "1.00 mm²", "–", "–", "–", "–", "–"],
        ["0.7 and more", "0.00 mm²", "–", "–", "–", "–", "–"],
    ]
