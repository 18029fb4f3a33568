"""What `make` says while it does nothing that can be seen."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("target", ["demo", "test"])
def test_installing_says_so_first(target: str, tmp_path: Path) -> None:
    command = ["make", "--dry-run", f"VENV={tmp_path / 'environment'}", target]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    said = next(k for k, line in enumerate(lines) if "echo" in line and "Installing" in line)
    assert said < next(k for k, line in enumerate(lines) if "pip install" in line)
