"""Whether a change left every output as it was.

    python benchmarks/same_outputs.py -o DIR [--endoct EXE] [--against DIR]

Makes one specimen of each preset, and unrolls and compares it, or finds its pose in its CT. Does the same with the
recordings that ``ENDOCT_RECORDINGS`` names. Writes what all of it holds to ``DIR/held.json``: digests of files and
arrays, and every value of every ``result.json`` and ``pose.json``. With ``--against``, prints what differs from an
earlier run, made with the older ``endoct``; the figures and the page of a report are no part of it.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zarr

ENDOCT = Path(sys.executable).with_name("endoct")
SPECIMENS = {"quick": 11, "hard": 12, "mastoid": 13, "learning": 14, "paper": 15, "small-patient": 16}
WITH_CT = "small-patient"
IMAGES = ("omnidirectional/example.jpg", "pipe-end/2019_10_23_13_39_07.jpg", "endoscope-circle/demo.jpg")
RUNS_APART = ("seconds", "versions", "inputs")
"""Parts of ``result.json`` and ``pose.json`` that differ between any two runs."""


def make(endoct: Path, folder: Path, presets: list[str]) -> None:
    """Make every output below ``folder``."""

    def run(name: str, *words: str | Path) -> None:
        ended = subprocess.run([endoct, *words], cwd=folder, capture_output=True, text=True)
        (folder / f"{name}.status").write_text(f"{ended.returncode}\n")
        if ended.returncode not in (0, 3):
            print(f"{name}: {ended.stderr.strip()[-300:]}", flush=True)

    for preset in presets:
        seed = SPECIMENS[preset]
        print(preset, flush=True)
        more = ["--ct"] if preset == WITH_CT else [] if preset == "paper" else ["--labels"]
        run(f"{preset}-simulate", "simulate", "-o", preset, "--preset", preset, "--seed", str(seed), *more)
        sides = [f"{preset}/endoscope", f"{preset}/oct"]
        if preset == WITH_CT:
            plan = ["--ct", f"{preset}/truth/ct.nii.gz", "--plan", f"{preset}/plan.mrk.json"]
            run(f"{preset}-pose", "pose", *sides, *plan, "-o", f"{preset}-posed")
            continue
        if preset == "learning":
            run(f"{preset}-volume", "unroll", sides[1], "-o", f"{preset}.zarr", "--volume")
        run(f"{preset}-compare", "compare", *sides, "-o", f"{preset}-compared", "--truth", f"{preset}/truth")
        if preset == "quick":
            turned = "quick-turned"
            run(turned, "compare", *sides[::-1], "-o", turned, "--set-b", "visible_length_mm=0.9")
    recordings = os.environ.get("ENDOCT_RECORDINGS")
    if recordings is None:
        print("ENDOCT_RECORDINGS names no folder of real recordings: left out")
        return
    print("real recordings", flush=True)
    coronary = Path(recordings) / "coronary-oct"
    run("coronary", "unroll", coronary, "-o", "coronary.zarr", "--volume")
    run("coronary-compare", "compare", coronary, coronary, "-o", "coronary-compared", "--set-b", "undistort=sine")
    for image in IMAGES:
        name = Path(image).parent.name
        (folder / name).mkdir()
        for k in range(3):
            shutil.copy(Path(recordings) / image, folder / name / f"frame_{k:04d}.jpg")
        stated = ["--set", "bore_diameter_mm=2.5", "--set", "visible_length_mm=1.0"]
        run(f"{name}-unroll", "unroll", name, "-o", f"{name}.zarr", "--modality", "endoscope", *stated)
    for raw in sorted((Path(recordings) / "axsun-oct").glob("*.bin")):
        samples = np.fromfile(raw, np.uint8)
        np.save(folder / f"{raw.stem}.npy", samples[: samples.size // 1024 // 4 * 4096].reshape(4, -1, 1024))
        stated = [
            "axial_pixel_mm=0.00575",
            "pullback_pitch_mm=0.2",
            "bore_diameter_mm=2.5",
            "capillary_outer_diameter_mm=1.7",
        ]
        options = [text for one in stated for text in ("--set", one)]
        run(raw.stem, "unroll", f"{raw.stem}.npy", "-o", f"{raw.stem}.zarr", "--modality", "oct", *options)


def held(folder: Path) -> dict[str, str]:
    """Return what the outputs below ``folder`` hold: "path" or "path:where" to a digest or a value."""
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if (
            "/figures/" in name
            or "/." in name
            or name == "held.json"
            or path.name in ("report.html", "endoct-output.json")
        ):
            continue
        if path.name == "zarr.json":
            found |= dict(_stored(path, folder))
        elif path.name in ("result.json", "pose.json"):
            found |= {f"{name}:{where}": value for where, value in _values(json.loads(path.read_text()))}
        elif path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                found |= {f"{name}:{key}": _digest(arrays[key].tobytes()) for key in arrays.files}
        elif path.is_file() and not any((parent / "zarr.json").is_file() for parent in path.parents):
            found[name] = _digest(path.read_bytes())
    return found


def _stored(path: Path, folder: Path) -> Iterator[tuple[str, str]]:
    node = zarr.open(path.parent, mode="r")
    if isinstance(node, zarr.Array):
        data = np.ascontiguousarray(node[...])
        yield path.parent.relative_to(folder).as_posix(), f"{data.shape} {data.dtype} {_digest(data.tobytes())}"


def _values(value: object, where: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            if where or key not in RUNS_APART:
                yield from _values(inner, f"{where}/{key}")
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _values(inner, f"{where}/{k}")
    else:
        yield where, repr(value)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def main() -> None:
    """Make, look, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--endoct", type=Path, default=ENDOCT)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--presets", nargs="*", default=list(SPECIMENS), choices=list(SPECIMENS))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True)
    make(arguments.endoct.absolute(), arguments.output, arguments.presets)
    now = held(arguments.output)
    (arguments.output / "held.json").write_text(json.dumps(now, indent=1))
    print(f"{len(now)} files, arrays and values")
    if arguments.against is None:
        return
    before: dict[str, str] = json.loads((arguments.against / "held.json").read_text())
    left_out = {preset for preset in SPECIMENS if preset not in arguments.presets}
    before = {k: v for k, v in before.items() if k.replace(".", "-").replace("/", "-").split("-")[0] not in left_out}
    apart = {k: (before.get(k), now.get(k)) for k in {**before, **now} if before.get(k) != now.get(k)}
    for name, (old, new) in sorted(apart.items()):
        print(f"{name}: {old} -> {new}")
    unchanged = len(before) - sum(old is not None for old, _ in apart.values())
    print(f"{unchanged} of {len(before)} as they were, {len(apart)} apart")


if __name__ == "__main__":
    main()
