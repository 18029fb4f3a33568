"""A method in a package of its own: installed beside endoct, on the bench, and as docs/how-to/bench.md prints it."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from endoct.workbench.bench.runner import BenchPlan, run
from endoct.workbench.bench.task import check_names, load_task, origin

PACKAGE = Path(__file__).parent / "endoct-behind-median"
DOCS = Path(__file__).parents[2] / "docs" / "how-to" / "bench.md"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install the package into a folder of its own, with nothing fetched, where this process finds it."""
    shutil.copytree(PACKAGE, tmp_path / "source")  # pip builds inside the source folder
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target", str(tmp_path / "site")]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(tmp_path / "source")], check=True)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    yield
    sys.modules.pop("endoct_behind_median", None)


def test_it_is_on_the_bench_beside_the_others(installed: None) -> None:
    task = load_task("segmentation")
    names = check_names(task, ["behind-median", "otsu"])
    assert "endoct-behind-median 0.1.0" in origin(task, "behind-median")
    ranges = {**task.ranges, "recipe": ("made",), "signal_db": (20.0, 20.0)}
    rows = run(BenchPlan(task.name, names, (1, 2, 3), 1, ranges), workers=1, advance=lambda _: None)
    own = [row for row in rows if row.method == "behind-median"]
    for row in own:
        assert row.status == ("ok" if row.conditions["modality"] == "depth" else "declined"), row.reason
    assert {row.conditions["modality"] for row in own} == {"depth", "intensity"}
    assert max(row.scores.get("jaccard", 0) for row in own) > 0.3


def test_the_documentation_prints_the_package_as_it_is() -> None:
    text = DOCS.read_text(encoding="utf-8")
    assert f"```toml\n{(PACKAGE / 'pyproject.toml').read_text(encoding='utf-8')}```" in text
    assert f"```python\n{(PACKAGE / 'endoct_behind_median.py').read_text(encoding='utf-8')}```" in text
