"""Recordings made of smaller ones, and the memory of a program."""

import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile

from benchmarks.unroll_memory import measured, write_recording


@pytest.mark.parametrize(("side", "shape"), [("oct", (8, 20)), ("endoscope", (5, 20, 3))])
def test_a_recording_is_resized_as_its_kind_is(side: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    """A slice keeps its depth; a frame of 2 × 8 becomes one of 5 × 20. Slices go forth and back."""
    (tmp_path / side).mkdir()
    stack = np.full((3, 8, 10) if side == "oct" else (3, 2, 8, 3), 7, np.uint8)
    stack[1], stack[2] = 9, 11
    if side == "oct":
        tifffile.imwrite(tmp_path / side / "pullback.tif", stack, photometric="minisblack")
    else:
        for k, frame in enumerate(stack):
            tifffile.imwrite(tmp_path / side / f"frame_{k}.tif", frame, photometric="rgb")
    (tmp_path / side / "acquisition.toml").write_text(f'modality = "{side}"\n')
    write_recording(tmp_path, side, 7, 20, tmp_path / "made")
    made = tifffile.imread(tmp_path / "made" / "recording.tif")
    assert (made.shape, made.dtype) == ((7, *shape), np.uint8)
    levels = [round(float(each.mean())) for each in made]
    assert levels == ([7, 9, 11, 11, 9, 7, 7] if side == "oct" else [7, 9, 11, 7, 9, 11, 7])
    assert np.ptp(made[0]) == 2, "noise of one up or down"
    assert (tmp_path / "made" / "acquisition.toml").is_file()


def test_memory_is_that_of_the_program_alone() -> None:
    held_here = np.ones(400_000_000, np.uint8)
    peak_mb, seconds, busy = measured([sys.executable, "-c", "bytearray(100_000_000)"])
    assert 100 < peak_mb < held_here.nbytes / 2e6
    assert min(seconds, busy) > 0
