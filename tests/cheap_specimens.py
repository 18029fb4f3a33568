"""A maker of specimens that takes milliseconds, for tests of what happens around it."""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tifffile
import zarr

from endoct.workbench.dataset.plan import DatasetPlan, Job


@dataclass(frozen=True)
class Cheap:
    """Writes a specimen that can be read, and a line into ``log`` when it begins and when it is done."""

    log: Path
    seconds: float = 0.0
    extra_bytes: int = 0

    def __call__(self, folder: Path, plan: DatasetPlan, job: Job) -> None:
        self._note(f"begin {job.index} {os.getpid()}")
        rng = np.random.default_rng([job.seed, job.bore_seed])
        for part in ("oct", "endoscope", "truth"):
            (folder / part).mkdir(parents=True)
            (folder / part / "acquisition.toml").write_text(f'modality = "{part}"\n')
        tifffile.imwrite(folder / "oct" / "pullback.tif", rng.integers(0, 255, (2, 8, 6), np.uint8))
        for i in range(2):
            png = cv2.imencode(".png", rng.integers(0, 255, (6, 8), np.uint8))[1]
            (folder / "endoscope" / f"frame_{i:04d}.png").write_bytes(png.tobytes())
        wall = zarr.open_group(folder / "truth" / "wall.zarr", mode="w")
        wall.create_array("relief_mm", data=rng.random((6, 8), np.float32))
        wall.create_array("cell", data=rng.random((6, 8)) < 0.5)
        wall.create_array("cell_id", data=rng.integers(0, 3, (6, 8), np.int32))
        sample = {
            "bore": {"bone": "phantom", "length_mm": 0.1, "cells": []},
            "oct": {"wall_db": float(rng.random()), "states_handedness": True},
            "endoscope": {"width_px": 8},
        }
        (folder / "truth" / "sample.json").write_text(json.dumps(sample))
        (folder / "truth" / "recording.json").write_text("{}")
        (folder / "truth" / "more").write_bytes(bytes(self.extra_bytes))
        time.sleep(self.seconds)
        self._note(f"end {job.index} {os.getpid()}")

    def _note(self, line: str) -> None:
        with self.log.open("a") as file:
            file.write(line + "\n")

    def noted(self, name: str) -> list[int]:
        """Return the indices of the specimens that were begun or ended, in that order."""
        lines = self.log.read_text().split("\n") if self.log.exists() else []
        return [int(line.split()[1]) for line in lines if line.startswith(name)]


def contents(root: Path) -> dict[str, bytes]:
    """Return all that must not depend on who made the set: every file but records (which hold times) and hidden ones.

    What was damaged and set aside does not count either.
    """
    files = [path for path in root.rglob("*") if path.is_file() and not path.name.startswith(".")]
    apart = root / "records", root / "damaged"
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in files
        if not any(path.is_relative_to(one) for one in apart)
    }


def leftovers(root: Path) -> list[Path]:
    """Return what is hidden in the set, beside its lock and its digests."""
    return [path for path in root.rglob(".*") if path.name not in (".lock", ".written.json")]
