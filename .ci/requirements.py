"""Prints what users of endoct install, in the lowest or the newest versions that pyproject.toml allows.

    python .ci/requirements.py lowest

That is the dependencies and those of every extra but `dev` and `docs`. What brings torch along is left out: it has many
gigabytes, and `constraints.txt` names the version that is tested.
"""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
LEFT_OUT = {"torch", "kornia"}
_BOUND = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)")


def bounds() -> dict[str, str]:
    """Return the lower bound of every requirement by its name. Raises ``ValueError`` where one has none."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = [lines for name, lines in project["optional-dependencies"].items() if name not in ("dev", "docs")]
    found: dict[str, str] = {}
    for line in sorted({line for lines in (project["dependencies"], *extras) for line in lines}, key=str.lower):
        bound = _BOUND.fullmatch(line)
        if bound is None:
            raise ValueError(f"{line} is not a name and a lower bound")
        if found.setdefault(bound[1], bound[2]) != bound[2]:
            raise ValueError(f"{bound[1]} has two lower bounds")
    return {name: version for name, version in found.items() if name not in LEFT_OUT}


def main() -> None:
    """Print a line for each."""
    relation = {"lowest": "==", "newest": ">="}[sys.argv[1]]
    for name, version in bounds().items():
        sys.stdout.write(f"{name}{relation}{version}\n")


if __name__ == "__main__":
    main()
