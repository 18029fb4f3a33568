"""docs/reference/parameters.md, of the simulator, is what docs/parameters.py makes of the parameters."""

import runpy
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_is_up_to_date() -> None:
    made = runpy.run_path(str(DOCS / "parameters.py"))["table"]()
    assert (DOCS / "reference" / "parameters.md").read_text(encoding="utf-8") == made, "run python docs/parameters.py"
