"""The lower bounds of what users install: exact versions, as `make lowest` installs them, none above what is pinned."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.version import Version

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(("which", "relation"), [("lowest", "=="), ("newest", ">=")])
def test_every_requirement_has_one_lower_bound(which: str, relation: str) -> None:
    command = [sys.executable, ROOT / ".ci" / "requirements.py", which]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    wanted = dict(re.split("[=>]=", line) for line in lines)
    assert sum(relation in line for line in lines) >= len(lines) - 1  # torch is pinned
    assert {"numpy", "tyro", "torch", "SimpleITK", "webdataset"} <= wanted.keys()
    assert "pytest" not in wanted
    pins = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE)
    pinned = {name.lower().replace("_", "-"): Version(version) for name, version in pins}
    for name, version in wanted.items():
        assert Version(version) <= pinned.get(name.lower().replace("_", "-"), Version("9999"))
