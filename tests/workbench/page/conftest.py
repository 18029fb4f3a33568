"""A comparison to show, and the server that shows it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from page_browser import WITHOUT_CARD, browser
from workbench_page import Served, serving, written


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison whose sides lie in place, with cells; tests must not change it."""
    return written(tmp_path_factory.mktemp("shown") / "specimen-7")


@pytest.fixture(scope="session")
def served(comparison: Path) -> Iterator[Served]:
    """The page of the comparison, served."""
    with serving(comparison) as found:
        yield found


@pytest.fixture(scope="package")
def chromium() -> Iterator[Any]:
    with browser(WITHOUT_CARD) as started:
        yield started
