"""The built wheel holds everything and runs without the sources. (The CI also installs it with its dependencies.)"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("base", "modalities", "stitching", "fusion", "synthetic", "workbench")
LEFT_OUT = {"__pycache__", "frontend"}  # what the page's program is made from; the wheel has the bundle


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the sources, so that nothing stays behind in the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns(*LEFT_OUT))
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(source)], check=True)
    return next(folder.glob("*.whl"))


def test_every_file_of_the_sources_is_in_the_wheel(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if name.startswith("endoct/")}
        (entry,) = (name for name in archive.namelist() if name.endswith("/data/share/applications/endoct.desktop"))
        assert b"\nExec=endoct-workbench\n" in archive.read(entry)
    sources = {
        f"endoct/{path.relative_to(ROOT).as_posix()}"
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not LEFT_OUT & set(path.parts)
    }
    manuals = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert packed == sources | {f"endoct/workbench/manual/{name}" for name in manuals}
    assert {f"endoct/{folder}/py.typed" for folder in FOLDERS} <= packed
    assert "endoct/__init__.py" not in packed  # a namespace


def test_the_installed_wheel_runs_without_the_sources(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    options = ["--quiet", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(wheel)], check=True)
    # site-packages come from a path entry, whose own .pth files, the editable install's among them, are not read
    packages = next(path for path in map(Path, sys.path) if path.name == "site-packages")
    script = (
        "import endoct.stitching; print(endoct.stitching.__path__[0]); from endoct.workbench.cli import main; main()"
    )
    run = subprocess.run(
        [sys.executable, "-S", "-c", script, "modalities"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(target), str(packages)])},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[0] == str(target / "endoct" / "stitching")
    assert "oct" in run.stdout
    assert "endoscope" in run.stdout
