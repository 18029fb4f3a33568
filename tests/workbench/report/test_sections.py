"""Sections of a report: whatever is drawn has its place in one of them."""

from pathlib import Path

import pytest
from markupsafe import Markup
from mock_comparison import Kind, write_comparison

from endoct.workbench.report.sections import comparison_sections


def test_a_figure_that_belongs_to_no_section_is_an_error(tmp_path: Path) -> None:
    result = write_comparison(tmp_path / "comparison", Kind("endoscope", depth=False), Kind("oct"))
    sections = comparison_sections(result, {"depth": Markup("<figure></figure>")})
    assert "<figure>" in next(one.html for one in sections if one.name == "depth")
    with pytest.raises(ValueError, match="no section of the report takes the figures of deepness"):
        comparison_sections(result, {"deepness": Markup("<figure></figure>")})
