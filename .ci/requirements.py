"""Prints what users of endoct install, in the lowest or the newest versions that pyproject.toml allows.

    python .ci/requirements.py lowest

That is the dependencies and those of every extra but `dev` and `docs`. Of torch it is the version in `constraints.txt`:
others bring gigabytes of CUDA along.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PINNED = ("torch",)
_BOUND = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)")


def bounds() -> dict[str, str]:
    """Return the lower bound of every requirement by its name. Raises ``ValueError`` where one has none."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [lines for name, lines in project["optional-dependencies"].items() if name not in ("dev", "docs")]
    found: dict[str, str] = {}
    for line in sorted({line for lines in (project["dependencies"], *extras) for line in lines}, key=str.lower):
        bound = _BOUND.fullmatch(line)
        if bound is None:
            raise ValueError(f"{line} is not a name and a lower bound")
        if found.setdefault(bound[1], bound[2]) != bound[2]:
            raise ValueError(f"{bound[1]} has two lower bounds")
    return found


def pins() -> dict[str, str]:
    """Return the versions in `constraints.txt` by name."""
    return dict(re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE))


def main() -> None:
    """Print a line for each."""
    relation = {"lowest": "==", "newest": ">="}[sys.argv[1]]
    for name, version in bounds().items():
        sys.stdout.write(f"{name}=={pins()[name]}\n" if name in PINNED else f"{name}{relation}{version}\n")


if __name__ == "__main__":
    main()
