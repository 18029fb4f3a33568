"""What a user has is there after every command, whatever output it was told to overwrite.

Run as a script (``python tests/workbench/test_destroyed_data.py [ENDOCT]``) it prints what was there before and after,
for this endoct or for another one whose command is given.
"""

import contextlib
import io
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile

SIDECAR = """modality = "oct"
axial_pixel_mm = 0.005
pullback_pitch_mm = 0.2
bore_diameter_mm = 2.5
capillary_outer_diameter_mm = 1.7
# measured by me with a calliper
"""


SIMULATED: list[Path] = []
"""A recording that can be unrolled, where one was made; refusing one takes no more than noise."""


def recording(folder: Path) -> Path:
    if SIMULATED:
        shutil.copytree(SIMULATED[0], folder)
        return folder
    folder.mkdir(parents=True)
    noise = np.random.default_rng(0).normal(60, 12, (4, 384, 512)).clip(0, 255)
    tifffile.imwrite(folder / "pullback.tif", noise.astype(np.uint8), photometric="minisblack")
    (folder / "acquisition.toml").write_text(SIDECAR)
    return folder


def study(folder: Path) -> Path:
    """A study with two patients and a thesis."""
    recording(folder / "study" / "patient1" / "oct")
    recording(folder / "study" / "patient2" / "oct")
    (folder / "study" / "thesis.tex").write_text("years of work")
    return folder / "study"


def _in(folder: Path) -> str:
    return str(study(folder) / "patient1" / "oct")


def _linked(folder: Path) -> list[str]:
    source = _in(folder)
    (folder / "way").symlink_to(folder / "study")
    return ["unroll", source, "-o", str(folder / "way"), "--overwrite"]


def _hard(folder: Path) -> list[str]:
    """An output of the bench beside which something lies that is called like what it keeps."""
    (folder / "results.unfinished").mkdir()
    (folder / "results.unfinished" / "thesis.tex").write_text("years of work")
    conditions = ["bench", "stitching", "--methods", "endoct", "--seeds", "0"]
    return [*conditions, "-o", str(folder / "results"), "--overwrite"]


def _bench_over_data(folder: Path) -> list[str]:
    source = study(folder)
    (source / "patient1" / "truth").mkdir()
    (source / "patient1" / "truth" / "oct.png").write_text("drawn for weeks")
    return ["bench", "oct", "--methods", "endoct", "--data", str(source), "-o", str(source), "--overwrite"]


def _summary_over_input(folder: Path) -> list[str]:
    source = folder / "comparison"
    source.mkdir()
    (source / "result.json").write_text('{"aligned": false, "sides": ["a", "b"]}')
    (source / "thesis.tex").write_text("years of work")
    return ["summarise", str(source), "-o", str(source), "--overwrite"]


def _report(folder: Path) -> list[str]:
    from mock_comparison import Kind, write_comparison

    write_comparison(folder / "result", Kind("endoscope", depth=False), Kind("oct"))
    (folder / "result" / "figures").mkdir()
    (folder / "result" / "figures" / "for the thesis.png").write_text("drawn for weeks")
    return ["report", str(folder / "result")]


ATTACKS: dict[str, Callable[[Path], list[str]]] = {
    "simulate over a thesis": lambda f: ["simulate", "-o", str(study(f)), "--preset", "learning", "--overwrite"],
    "unroll over the input's parent": lambda f: ["unroll", _in(f), "-o", str(f / "study"), "--overwrite"],
    "unroll over its input": lambda f: ["unroll", source := _in(f), "-o", source, "--overwrite"],
    "unroll over a file of its input": lambda f: [
        "unroll", source := _in(f), "-o", f"{source}/pullback.tif", "--overwrite",
    ],
    "unroll into its input": lambda f: ["unroll", source := _in(f), "-o", f"{source}/x.zarr", "--overwrite"],
    "unroll over the present folder": lambda f: ["unroll", _in(f), "-o", ".", "--overwrite"],
    "unroll through a link": _linked,
    "compare over its inputs": lambda f: [
        "compare", _in(f), str(f / "study/patient2/oct"), "-o", str(f / "study"), "--overwrite",
    ],
    "compare over another folder": lambda f: [
        "compare", source := _in(f), source, "-o", str(f / "study/patient2"), "--overwrite",
    ],
    "demo over a study": lambda f: ["demo", "-o", str(study(f).rename(f / "specimen").parent), "--overwrite"],
    "dataset over a study": lambda f: ["dataset", "-o", str(study(f)), "--count", "1"],
    "bench over its data": _bench_over_data,
    "bench beside a folder of the user's": _hard,
    "summarise over its input": _summary_over_input,
    "a report over figures of the user's": _report,
    "a sidecar over the user's own": lambda f: ["info", _in(f), "--write-sidecar", "--overwrite"],
}  # fmt: skip


def tree(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def in_process(arguments: list[str]) -> tuple[int, str]:
    from endoct.workbench import cli

    stderr, argv = io.StringIO(), sys.argv
    sys.argv = ["endoct", *arguments]
    try:
        with contextlib.redirect_stderr(stderr), contextlib.redirect_stdout(io.StringIO()):
            cli.main()
    except SystemExit as leave:
        return int(leave.code or 0), stderr.getvalue()
    finally:
        sys.argv = argv
    return -1, stderr.getvalue()


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_a_user_has_stays(attack: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ATTACKS[attack](tmp_path)
    monkeypatch.chdir(tmp_path)
    before = tree(tmp_path)
    status, said = in_process(arguments)
    after = tree(tmp_path)
    assert after.items() >= before.items()
    assert status == 1
    lines = [line for line in said.splitlines() if line.startswith("endoct: ")]
    assert len(lines) == 1
    if attack != "bench beside a folder of the user's":  # what it has finished is kept
        assert after == before


def main() -> None:
    """Print the table."""
    made = Path(tempfile.mkdtemp()) / "specimen"
    subprocess.run(
        [Path(sys.executable).with_name("endoct"), "simulate", "-o", made, "--preset", "learning"], check=True
    )
    SIMULATED.append(made / "oct")
    command = sys.argv[1] if len(sys.argv) > 1 else str(Path(sys.executable).with_name("endoct"))
    print("| command | files before | of them after | status | said |\n|---|---|---|---|---|")
    for attack, make in ATTACKS.items():
        folder = Path(tempfile.mkdtemp())
        arguments = make(folder)
        before = tree(folder)
        ran = subprocess.run([command, *arguments], cwd=folder, capture_output=True, text=True, check=False)
        after = tree(folder) if folder.exists() else {}
        kept = sum(after.get(name) == data for name, data in before.items())
        lines = [line for line in ran.stderr.splitlines() if line.startswith("endoct: ")]
        said = " ".join(lines).replace(str(folder), "DIR").replace("|", "/")
        print(f"| {attack} | {len(before)} | {kept} | {ran.returncode} | {said} |", flush=True)
        os.chdir("/")
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
