"""Writes `THIRD_PARTY.md`, a file of the wheel, from what is installed; to be run after a change of a dependency."""

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path, PurePosixPath

from packaging.requirements import Requirement

PAGE = Path(__file__).parents[1] / "THIRD_PARTY.md"
EXTRAS = {"shards", "fiji", "dicom", "logs", "ct", "pose", "rivals", "cuda", "learn"}
LONGEST = 60
COPYLEFT = {
    "x264": "GPL-2.0-or-later",
    "x265": "GPL-2.0-or-later",
    "gmp": "LGPL-3.0-or-later or GPL-2.0-or-later",
    "nettle": "LGPL-3.0-or-later or GPL-2.0-or-later",
    "hogweed": "LGPL-3.0-or-later or GPL-2.0-or-later",
    "unistring": "LGPL-3.0-or-later or GPL-2.0-or-later",
    "gnutls": "LGPL-2.1-or-later",
    "mp3lame": "LGPL-2.0-or-later",
    "asound": "LGPL-2.1-or-later",
    "avcodec": "LGPL-2.1-or-later; GPL-2.0-or-later where built with x264 or x265, as in av",
    "avdevice": "as avcodec",
    "avfilter": "as avcodec",
    "avformat": "as avcodec",
    "avutil": "as avcodec",
    "swresample": "as avcodec",
    "swscale": "as avcodec",
    "gfortran": "GPL-3.0-or-later WITH GCC-exception-3.1",
    "gomp": "GPL-3.0-or-later WITH GCC-exception-3.1",
    "quadmath": "LGPL-2.1-or-later",
}
"""Of libraries in wheels, those under a GPL or LGPL, by name; what their own sources say."""
STATIC = {
    "simpleitk": "ITK with GDCM, HDF5, libtiff and others, built in; see its NOTICE",
    "llvmlite": "LLVM, built in",
    "torch": "many, built in; 98 licence texts come with it",
    "imagecodecs": "its licence texts lie in imagecodecs/licenses",
    "opencv-contrib-python-headless": "others built in; see LICENSE-3RD-PARTY.txt in it",
}
HEAD = """# Licences

What is installed with endoct, with all extras but `dev` and `docs`, and under which licences. Made by
`python docs/licences.py` from the metadata of the versions in `constraints.txt`, on Linux (x86-64).

endoct itself is under BSD-3-Clause and ships none of these. Its page contains OpenSeadragon (BSD-3-Clause) and three.js
(MIT); `workbench/page/bundle/notices.txt` has their texts.

**If you pass an installed environment on**, as a container or an installer: the wheel of `av` holds x264 and x265,
which are under the GPL, so the whole that includes it is too. endoct loads `av` only to read and write videos.

"""


def dependencies() -> tuple[dict[str, Distribution], set[str]]:
    """Return what endoct needs, directly or not, by normalised name; and what of it is not installed here."""
    found: dict[str, Distribution] = {}
    missing: set[str] = set()
    seen: set[tuple[str, frozenset[str]]] = set()
    waiting = [("endoct", frozenset(EXTRAS))]
    while waiting:
        name, extras = waiting.pop()
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            missing.add(name)
            continue
        for requirement in map(Requirement, found[name].requires or []):
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras | {""}):
                waiting.append((normalised(requirement.name), frozenset(requirement.extras)))
    del found["endoct"]
    return dict(sorted(found.items())), missing


def normalised(name: str) -> str:
    """Return a name as package indices compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(of: Distribution) -> str:
    """Return what the metadata say: an expression, else a classifier, else a short text."""
    expression, text = of.metadata.get("License-Expression"), (of.metadata.get("License") or "").strip()
    classifiers = [
        line for line in of.metadata.get_all("Classifier") or [] if line.startswith("License :: OSI Approved")
    ]
    if expression:
        return str(expression)
    if text and "\n" not in text and len(text) <= LONGEST:
        return text
    return ", ".join(line.split(" :: ")[-1] for line in classifiers) or "see its LICENSE"


def bundled(of: Distribution) -> list[str]:
    """Return the names of the shared libraries that a wheel brings along beside its own modules."""
    names = {PurePosixPath(str(file)).name for file in of.files or [] if re.search(r"\.libs/.*\.so", str(file))}
    return sorted({re.sub(r"^lib|-[0-9a-f]{8}|(-r[0-9])?(\.[0-9.]+)?\.so.*$", "", name) for name in names})


def page() -> str:
    """Return the whole page."""
    found, missing = dependencies()
    lines = ["| package | version | licence |", "|---|---|---|"]
    lines += [f"| {name} | {of.version.split('+')[0]} | {licence(of)} |" for name, of in found.items()]
    lines += [f"| {name} | not installed where this was made | see its own page |" for name in sorted(missing)]
    lines += ["", "## Libraries inside wheels", "", "| wheel | shared libraries | and |", "|---|---|---|"]
    inside = {name: bundled(of) for name, of in found.items()}
    lines += [
        f"| {name} | {', '.join(inside[name]) or '–'} | {STATIC.get(name, '')} |"
        for name in found
        if inside[name] or name in STATIC
    ]
    lines += [
        "",
        "Of these, those under a GPL or LGPL:",
        "",
        "| library | licence | in the wheel of |",
        "|---|---|---|",
    ]
    for library, said in COPYLEFT.items():
        holders = [name for name in found if any(re.fullmatch(rf"{library}(64_|p)?", one) for one in inside[name])]
        lines += [f"| {library} | {said} | {', '.join(holders)} |"] * bool(holders)
    return HEAD + "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
