"""Every kind of unusable input ends in one clear line, status 1, and nothing half-written.

Run as a script (``python tests/workbench/test_bad_input.py``) it prints the table of what was tried and said.
"""

import contextlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from endoct.workbench import cli

OCT_SIDECAR = """modality = "oct"
axial_pixel_mm = 0.005
pullback_pitch_mm = 0.2
bore_diameter_mm = 2.5
capillary_outer_diameter_mm = 1.7
"""
ENDOSCOPE_SIDECAR = """modality = "endoscope"
bore_diameter_mm = 2.5
feed_pitch_mm = 0.2
visible_length_mm = 1.0
"""
SLICES, DEPTH, A_SCANS = 4, 384, 512
FRAMES, ROWS, COLUMNS = 4, 240, 320


def oct_folder(folder: Path, volume: np.ndarray | None, sidecar: str = OCT_SIDECAR) -> Path:
    folder.mkdir()
    if volume is not None:
        tifffile.imwrite(folder / "pullback.tif", volume, photometric="minisblack")
    (folder / "acquisition.toml").write_text(sidecar)
    return folder


def endoscope_folder(folder: Path, frames: list[np.ndarray], sidecar: str = ENDOSCOPE_SIDECAR) -> Path:
    folder.mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"frame_{k:04d}.png"), frame)
    (folder / "acquisition.toml").write_text(sidecar)
    return folder


def oct_noise(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(60, 12, (SLICES, DEPTH, A_SCANS)).clip(0, 255).astype(np.uint8)


def endoscope_noise(seed: int = 0) -> list[np.ndarray]:
    noise = np.random.default_rng(seed).integers(0, 255, (FRAMES, ROWS, COLUMNS))
    return list(noise.astype(np.uint8))


def flat_frames(value: int) -> list[np.ndarray]:
    return [np.full((ROWS, COLUMNS), value, np.uint8)] * FRAMES


def _oct(volume: Callable[[], np.ndarray | None], sidecar: str = OCT_SIDECAR) -> Callable[[Path], list[str]]:
    return lambda t: ["unroll", str(oct_folder(t / "oct", volume(), sidecar)), "-o", str(t / "out.zarr")]


def _endoscope(frames: Callable[[], list[np.ndarray]], sidecar: str = ENDOSCOPE_SIDECAR) -> Callable[[Path], list[str]]:
    return lambda t: ["unroll", str(endoscope_folder(t / "endo", frames(), sidecar)), "-o", str(t / "out.zarr")]


def _with_file(name: str, data: bytes) -> Callable[[Path], list[str]]:
    def make(t: Path) -> list[str]:
        folder = oct_folder(t / "oct", None)
        (folder / name).write_bytes(data)
        return ["unroll", str(folder), "-o", str(t / "out.zarr")]

    return make


def _truncated_tiff(t: Path) -> list[str]:
    folder = oct_folder(t / "oct", oct_noise())
    data = (folder / "pullback.tif").read_bytes()
    (folder / "pullback.tif").write_bytes(data[: len(data) // 2])
    return ["unroll", str(folder), "-o", str(t / "out.zarr")]


def _nan(t: Path) -> list[str]:
    volume = oct_noise().astype(np.float32)
    volume[2, 100, 100] = np.nan
    return ["unroll", str(oct_folder(t / "oct", volume)), "-o", str(t / "out.zarr")]


def _nan_npy(t: Path) -> list[str]:
    folder = oct_folder(t / "oct", None)
    volume = oct_noise().astype(np.float32)
    volume[0, 0, 0] = np.inf
    np.save(folder / "pullback.npy", volume)
    return ["unroll", str(folder), "-o", str(t / "out.zarr")]


def _five_axes(t: Path) -> list[str]:
    folder = oct_folder(t / "oct", None)
    np.save(folder / "pullback.npy", np.zeros((2, 3, 4, 5, 6), np.uint8))
    return ["unroll", str(folder), "-o", str(t / "out.zarr")]


def _one_frame_differs(t: Path) -> list[str]:
    frames = endoscope_noise()
    frames[2] = frames[2][:, :-10]
    return ["unroll", str(endoscope_folder(t / "endo", frames)), "-o", str(t / "out.zarr")]


def _broken_png(t: Path) -> list[str]:
    folder = endoscope_folder(t / "endo", endoscope_noise())
    data = (folder / "frame_0001.png").read_bytes()
    (folder / "frame_0001.png").write_bytes(data[:200])
    return ["unroll", str(folder), "-o", str(t / "out.zarr")]


def _output_exists(t: Path) -> list[str]:
    (t / "out.zarr").mkdir()
    return _oct(oct_noise)(t)


def _output_below_a_file(t: Path) -> list[str]:
    (t / "file").write_text("")
    return [*_oct(oct_noise)(t)[:-1], str(t / "file" / "out.zarr")]


def _no_sidecar(t: Path) -> list[str]:
    folder = oct_folder(t / "oct", oct_noise())
    (folder / "acquisition.toml").unlink()
    return ["unroll", str(folder), "--modality", "oct", "-o", str(t / "out.zarr")]


def _two_bores(t: Path) -> list[str]:
    a = oct_folder(t / "oct", oct_noise())
    b = endoscope_folder(
        t / "endo", endoscope_noise(), ENDOSCOPE_SIDECAR.replace("bore_diameter_mm = 2.5", "bore_diameter_mm = 1.8")
    )
    return ["compare", str(a), str(b), "-o", str(t / "out.zarr")]


def _two_masks(t: Path) -> list[str]:
    for name in "ab":
        cv2.imwrite(str(t / f"{name}.png"), np.eye(20, 30, dtype=np.uint8) * 255)
    return ["compare", str(t / "a.png"), str(t / "b.png"), "-o", str(t / "out.zarr")]


def _settings_for_a_mask(t: Path) -> list[str]:
    return [*_two_masks(t), "--set-b", "undistort=sine"]


def _missing_truth(t: Path) -> list[str]:
    a = oct_folder(t / "oct", oct_noise())
    b = endoscope_folder(t / "endo", endoscope_noise())
    return ["compare", str(a), str(b), "-o", str(t / "out.zarr"), "--truth", str(t / "nowhere.png")]


CASES: dict[str, Callable[[Path], list[str]]] = {
    "missing path": lambda t: ["unroll", str(t / "nowhere"), "-o", str(t / "out.zarr")],
    "empty folder": lambda t: ["unroll", str(oct_folder(t / "oct", None)), "-o", str(t / "out.zarr")],
    "empty file": _with_file("pullback.tif", b""),
    "text named .tif": _with_file("pullback.tif", b"this is no image"),
    "truncated TIFF": _truncated_tiff,
    "truncated PNG": _broken_png,
    "five axes": _five_axes,
    "one frame of another size": _one_frame_differs,
    "OCT with NaN": _nan,
    "OCT with infinity (.npy)": _nan_npy,
    "OCT all black": _oct(lambda: np.zeros((SLICES, DEPTH, A_SCANS), np.uint8)),
    "OCT saturated": _oct(lambda: np.full((SLICES, DEPTH, A_SCANS), 255, np.uint8)),
    "OCT constant": _oct(lambda: np.full((SLICES, DEPTH, A_SCANS), 90, np.uint16)),
    "OCT pure noise, no capillary": _oct(oct_noise),
    "OCT far too small": _oct(lambda: np.zeros((1, 4, 4), np.uint8)),
    "frames all black": _endoscope(lambda: flat_frames(0)),
    "frames saturated": _endoscope(lambda: flat_frames(255)),
    "frames constant": _endoscope(lambda: flat_frames(90)),
    "frames pure noise, no annulus": _endoscope(endoscope_noise),
    "no sidecar": _no_sidecar,
    "sidecar not TOML": _oct(oct_noise, "modality = oct"),
    "sidecar key misspelt": _oct(oct_noise, OCT_SIDECAR.replace("axial_pixel_mm", "axial_pixle_mm")),
    "sidecar key missing": _oct(oct_noise, OCT_SIDECAR.replace("axial_pixel_mm = 0.005\n", "")),
    "sidecar pitch of 0": _oct(oct_noise, OCT_SIDECAR.replace("pitch_mm = 0.2", "pitch_mm = 0.0")),
    "sidecar travel impossible": _oct(oct_noise, OCT_SIDECAR + 'travel = "up"\n'),
    "sidecar capillary wider than the bore": _oct(oct_noise, OCT_SIDECAR.replace("= 1.7", "= 2.7")),
    "sidecar with too few positions": _oct(oct_noise, OCT_SIDECAR + "positions_mm = [0.0, 0.2]\n"),
    "sidecar without any z of the view": _endoscope(
        endoscope_noise, ENDOSCOPE_SIDECAR.replace("visible_length_mm = 1.0\n", "")
    ),
    "unknown modality": lambda t: [*_oct(oct_noise)(t), "--modality", "ultrasound"],
    "setting misspelt": lambda t: [*_oct(oct_noise)(t), "--set", "undistrot=sine"],
    "setting impossible": lambda t: [*_oct(oct_noise)(t), "--set", "undistort=cosine"],
    "output exists": _output_exists,
    "output below a file": _output_below_a_file,
    "two bore diameters": _two_bores,
    "two masks without a scale": _two_masks,
    "settings for a mask": _settings_for_a_mask,
    "truth that is missing": _missing_truth,
    "info of nothing": lambda t: ["info", str(t / "nowhere")],
    "report of nothing": lambda t: ["report", str(t / "nowhere")],
    "page of nothing": lambda t: ["serve", str(t / "nowhere")],
    "page of a folder": lambda t: ["serve", str(t)],
    "replay of nothing": lambda t: ["simulate", "-o", str(t / "out.zarr"), "--replay", str(t / "nowhere.json")],
}


def tried(case: str, folder: Path) -> tuple[int, str, list[str]]:
    """Return status, what was printed to stderr beside progress, and the paths that were left behind."""
    arguments = CASES[case](folder)
    before = sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))
    stderr = io.StringIO()
    argv, sys.argv = sys.argv, ["endoct", *arguments]
    try:
        with contextlib.redirect_stderr(stderr), contextlib.redirect_stdout(io.StringIO()):
            cli.main()
    except SystemExit as leave:
        status = int(leave.code or 0)
    finally:
        sys.argv = argv
    lines = [line for line in stderr.getvalue().splitlines() if line.startswith("endoct:")]
    after = sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))
    return status, "\n".join(lines), [p for p in after if p not in before]


@pytest.mark.parametrize("case", CASES)
def test_one_clear_line_and_nothing_left(case: str, tmp_path: Path) -> None:
    status, said, left = tried(case, tmp_path)
    assert status == 1
    assert said.startswith("endoct: ")
    assert "\n" not in said
    assert len(said) > 30
    assert left == []


@pytest.mark.parametrize(("case", "told"), [("settings for a mask", "undistort"), ("truth that is missing", "nowhere")])
def test_what_was_asked_for_in_vain_is_named(case: str, told: str, tmp_path: Path) -> None:
    assert told in tried(case, tmp_path)[1]


def test_wrong_usage_is_status_2(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["endoct", "unroll"])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert leave.value.code == 2
    assert "output" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_an_interrupt_leaves_nothing_and_is_status_130(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", "from endoct.workbench.cli import main; main()", "demo", "-o", str(tmp_path / "demo")],
        stderr=subprocess.PIPE,
        text=True,
    )
    while not any(tmp_path.iterdir()):  # until the output has been begun
        time.sleep(0.05)
        assert process.poll() is None
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "interrupted" in said
    assert list(tmp_path.iterdir()) == []


def main() -> None:
    """Print the table of bad inputs."""
    print("| input | status | line printed |\n|---|---|---|")
    for case in CASES:
        folder = Path(tempfile.mkdtemp())
        status, said, _ = tried(case, folder)
        print(f"| {case} | {status} | {said.replace(str(folder), 'DIR').replace('|', '/')} |")
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
