"""An unrolled image of a bore with pits, drawn by hand, and its sidecar."""

from pathlib import Path
from typing import Any

import numpy as np
import tifffile

RADIUS_MM, PITCH_MM, COUNT_MM = 40.0, 4.0, 0.05
N_ROWS, N_COLUMNS = 40, 96


def pits(n_rows: int = N_ROWS, n_columns: int = N_COLUMNS, seed: int = 0) -> np.ndarray:
    """Return where pits are, bool (n_rows, n_columns), a few of them, some across the seam."""
    rng = np.random.default_rng(seed)
    mask = np.zeros((n_rows, n_columns), np.bool_)
    for row, column in [(n_rows // 2, 0), *rng.integers((2, 0), (n_rows - 6, n_columns), (n_rows // 6, 2))]:
        mask[row : row + 4, np.arange(column - 4, column + 4) % n_columns] = True
    return mask


def brightness(mask: np.ndarray, seed: int = 1) -> np.ndarray:
    """Return a grainy wall with dark pits, uint8, smooth across its seam."""
    angle = 2 * np.pi * np.arange(mask.shape[1]) / mask.shape[1]
    wall = 160 + 30 * np.cos(angle) + np.random.default_rng(seed).normal(0, 3, mask.shape)
    return np.where(mask, 40, wall).astype(np.uint8)


def distances(mask: np.ndarray, offset_mm: float = 1.2, direction_rad: float = 2.0, seed: int = 2) -> np.ndarray:
    """Return counts of the distance from a probe off the axis to a wall with pits 3 mm deep, float32."""
    angle = 2 * np.pi * np.arange(mask.shape[1]) / mask.shape[1] - direction_rad
    clear = -offset_mm * np.cos(angle) + np.sqrt(RADIUS_MM**2 - (offset_mm * np.sin(angle)) ** 2)
    noise = np.random.default_rng(seed).normal(0, 0.03, mask.shape)
    return ((clear + 3 * mask + noise) / COUNT_MM).astype(np.float32)


SAID: dict[str, Any] = {
    "modality": "unrolled",
    "bore_diameter_mm": 2 * RADIUS_MM,
    "travel": "in",
    "handedness": "same",
    "theta_origin_rad": 0.0,
    "row_pitch_mm": PITCH_MM,
}
OF_DEPTH: dict[str, Any] = {
    "depth_file": "depth.tif",
    "deeper": "larger",
    "centred": False,
    "depth_mm_per_count": COUNT_MM,
}


def write(folder: Path, intensity: np.ndarray | None = None, depth: np.ndarray | None = None, **keys: Any) -> Path:
    """Write images and the sidecar into ``folder``; ``keys`` replace those of it, or leave them out where None."""
    folder.mkdir(parents=True, exist_ok=True)
    said = dict(SAID)
    if intensity is not None:
        said["intensity_file"] = "wall.tif"
        tifffile.imwrite(folder / "wall.tif", intensity, photometric="rgb" if intensity.ndim == 3 else "minisblack")
    if depth is not None:
        said |= OF_DEPTH
        tifffile.imwrite(folder / "depth.tif", depth, photometric="minisblack")
    lines = [f"{key} = {_toml(value)}\n" for key, value in (said | keys).items() if value is not None]
    (folder / "acquisition.toml").write_text("".join(lines), encoding="utf-8")
    return folder


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else f'"{value}"' if isinstance(value, str) else repr(value)
