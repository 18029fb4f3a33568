"""What ``endoct compare`` leaves for its report, made up: cells, some over the seam, and what was not observed."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from endoct.fusion.files.store import save_comparison
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import ByLi, Overlap, OwnRows, PairScores, Result, StoredAlignment, Threshold
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.modalities.contract import Picture
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import save_panorama
from endoct.workbench.report.pictures import save_pictures

GRID = SurfaceGrid.full_circle(60, 256, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
FRAME_Z_MM = 0.2 * np.arange(15)
BRIDGED = (3, 8, 9)


@dataclass(frozen=True)
class Kind:
    """What one side of a mock comparison has."""

    name: str
    depth: bool = True
    drawn: bool = False


def write_comparison(folder: Path, a: Kind, b: Kind, *, aligned: bool = True, **changed: Any) -> Result:
    """Write what ``endoct compare`` leaves for the report, with fields of the result changed; return that."""
    rng = np.random.default_rng(1)
    theta, z = np.meshgrid(GRID.theta_rad, GRID.z_mm)
    cells = np.hypot(1.25 * (theta - 2.0), z - 1.5) < 0.5
    cells |= np.hypot(1.25 * (np.mod(theta + np.pi, 2 * np.pi) - np.pi), z - 0.7) < 0.3  # over the seam
    valid = np.ones((2, *GRID.shape), np.bool_)
    valid[0, :6], valid[1, 40:43] = False, False
    depth_mm = np.where(cells, 0.6, 0.0).astype(np.float32) + rng.normal(0, 0.01, GRID.shape).astype(np.float32)
    intensity = np.where(cells, 40, 150).astype(np.float32) + rng.normal(0, 5, GRID.shape).astype(np.float32)
    mask = np.stack([cells, np.roll(cells, 2, axis=1)]) & valid
    depths = np.stack([np.where(valid[k] & side.depth, depth_mm, np.nan) for k, side in enumerate((a, b))])
    seen = valid.all(axis=0)
    both, either = (mask.all(axis=0) & seen).sum(), (mask.any(axis=0) & seen).sum()
    jaccard = float(both / max(either, 1))
    names = (a.name, b.name)
    folder.mkdir(parents=True)
    intensities = np.stack([mask[k] if side.drawn else intensity for k, side in enumerate((a, b))])
    result = _result(names, jaccard if aligned else None).model_copy(update=changed)
    one, two = (
        PlacedSide(name=names[k], intensity=intensities[k], depth_mm=depths[k], mask=mask[k], valid=valid[k])
        for k in (0, 1)
    )
    save_comparison(Comparison(GRID, (one, two), None, None, result), folder / "comparison.zarr")
    for k, side in enumerate((a, b)):
        save_panorama(_panorama(side, intensities[k], depths[k], valid[k]), folder / "panoramas" / f"{side.name}.zarr")
        if not side.drawn:
            save_pictures(folder / "pictures", side.name, "0007", mock_pictures())
    (folder / "result.json").write_text(json.dumps(result.to_json()), encoding="utf-8")
    return result


def _result(names: tuple[str, str], jaccard: float | None) -> Result:
    """Return a result, not aligned where there is no Jaccard index."""
    aligned = jaccard is not None
    dice = 2 * jaccard / (1 + jaccard) if aligned else None
    alignment = Alignment(1.5, -0.4321, 1.0123, mirrored=True, confidence=0.629, correlation=0.934, ratio=3.06)
    of_rows = OwnRows(rows_of=names[1], jaccard=0.8765, dice=dice, both_mm2=1.25, only_a_mm2=0.1)
    of_li = ByLi(grid=_overlap(0.4321), own_rows=of_rows.model_copy(update={"jaccard": 0.4567}), threshold={})
    return Result(
        sides=names,
        aligned=aligned,
        reason=None if aligned else "The best place is only 1.1 times as good as the runner-up.",
        alignment=StoredAlignment.of(alignment) if aligned else None,
        jaccard=jaccard,
        dice=dice,
        threshold={names[0]: Threshold(value=0.4123, unit="1", of="darkness <capped>")},
        scores=None if jaccard is None else PairScores(grid=_overlap(jaccard), own_rows=of_rows, by_li=of_li),
        valid_fraction=0.943,
        overlap_mm=2.7,
        doubts=(),
        notes={names[0]: (), names[1]: ("Depth rows 92–93 hold fixed lines & were interpolated.",)},
        versions={"endoct": "0.1.0", "numpy": "2.4.0"},
        inputs={"specimen/oct/pullback.tif": "cd" * 32},
        parameters={"compare": {"n_theta": 2048, "odd": "<script>alert(1)</script>"}},
        seconds={"align": 1.25, "write": 0.5},
    )


def _overlap(jaccard: float) -> Overlap:
    interval = (jaccard - 0.05, jaccard + 0.05)
    dice = 2 * jaccard / (1 + jaccard)
    return Overlap(jaccard=jaccard, dice=dice, both_mm2=1.25, only_a_mm2=0.1, jaccard_interval=interval)


def _panorama(side: Kind, intensity: Any, depth_mm: Any, valid: Any) -> Panorama:
    per_frame = {
        "slice_z_mm": FRAME_Z_MM,
        "slice_index": np.arange(15),
        "residual_mm": PerFrame(0.004 + 0.001 * np.sin(FRAME_Z_MM), "mm", "misfit of the face", usual=(0.0, 0.0045)),
        "signal": PerFrame(np.full(15, 20.0), "dB", "signal", usual=(12.0, math.inf)),
        "phase_rad": np.mod(6.2 + 0.02 * np.arange(15), 2 * np.pi),
        "omega": np.ones(15),
        "bridged": np.isin(np.arange(15), BRIDGED),
        "pair_trusted": np.ones(15, np.bool_),
    }
    return Panorama(
        GRID, intensity, depth_mm if side.depth else None, valid, valid.astype(np.float32),
        "mask" if side.drawn else side.name.split("-")[0], True, True, "slice", {} if side.drawn else per_frame,
    )  # fmt: skip


def mock_pictures() -> tuple[Picture, ...]:
    angle = np.linspace(0, 6.2, 100)
    curve = np.stack([angle, 1 + 0.2 * np.sin(angle)], axis=1)
    curve[10:20] = np.nan
    noise = np.random.default_rng(2).random((50, 100)).astype(np.float32)
    labels = {"x_label": "rotation (rad)", "y_label": "depth (mm)", "x_extent": (0.0, 6.2), "y_extent": (0.0, 2.5)}
    return (
        Picture("raw", "B-scan as recorded", noise, **labels, curves={"outer face": curve}, about="Lines: the sheath."),
        Picture("flat", "B-scan undistorted", noise, **labels, curves={}),
    )
