"""docs/reference/settings.md is what docs/settings.py makes of the settings."""

import runpy
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_is_up_to_date() -> None:
    made = runpy.run_path(str(DOCS / "settings.py"))["table"]()
    assert (DOCS / "reference" / "settings.md").read_text(encoding="utf-8") == made, "run python docs/settings.py"
