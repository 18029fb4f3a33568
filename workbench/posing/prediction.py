"""A side in the CT's air: its cells, and what the CT predicts of its wall at the pose, alone and as a comparison.

Loads torch: imported only where a pose is looked for.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.fusion.comparison import Comparison, compare_placed, save_comparison
from endoct.fusion.evidence.side import Side
from endoct.fusion.files.store import COMPARISON_STORE, write_cells
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import save_panorama
from endoct.workbench.posing.result import Made
from endoct.workbench.running.outputs import json_text
from endoct.workbench.running.scheduler import one_blas_thread

ROWS_MM, COLUMNS = 0.05, 1024
"""Samples of a side's comparison with the CT: far finer than a CT."""
PARAMETERS = CompareParameters(dz_mm=ROWS_MM, n_theta=COLUMNS, polarity="dark")
MODALITY = "ct"
ROWS_AT_A_TIME = 256
OUT_OF_PLACE = "parts-out-of-place", "step-along-the-bore"
NOTE = (
    "This side is what the CT has on the wall at the pose that `endoct pose` found: it lies where it does by that "
    "pose, and was not aligned."
)


@dataclass(frozen=True, eq=False)
class SideInAir:
    """A side, and the air around the plan that it is looked for in."""

    air: AirAround
    side: Side

    @cached_property
    def cells(self) -> Segmentation:
        """The cells of the side, found when they are first read, and kept."""
        return segment_side(self.side, PARAMETERS, "dark")


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS and torch to one thread, as a context or a decorator: the order of sums is that of any machine.

    A search and a fit are many steps on small arrays, at which threads wait for one another.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with one_blas_thread():
            yield
    finally:
        torch.set_num_threads(before)


def predicted(air: AirAround, pose: BorePose, side: Side) -> Panorama:
    """Return what the CT has on the wall of ``side``: the share of bone, on its panorama's rows and as many columns."""
    own, behind = side.grid, pose.fit.sides[pose.names.index(side.name)].layers[0].behind_mm
    n_theta, z_mm = min(own.n_theta, COLUMNS), own.z_mm
    grid = replace(own, n_theta=n_theta, dtheta_rad=2 * np.pi / n_theta)
    some = [z_mm[first : first + ROWS_AT_A_TIME] for first in range(0, grid.n_z, ROWS_AT_A_TIME)]
    blocks = [_bone(air, pose, side, grid, rows, behind) for rows in some]
    everywhere = np.ones(grid.shape, np.bool_)
    return Panorama(
        grid=grid,
        intensity=np.concatenate(blocks),
        depth_mm=None,
        valid=everywhere,
        weight=everywhere.astype(np.float32),
        modality=MODALITY,
        handedness_known=True,
        travel_known=True,
        frame_dim="row",
        per_frame={"row_z_mm": PerFrame(z_mm, "mm", "place along the bore")},
        provenance={"parameters": {"what": f"share of bone in the CT, {behind:g} mm behind the wall of {side.name}"}},
    )


def compare_with(prediction: Panorama, pose: BorePose, given: SideInAir) -> Comparison | None:
    """Return a side and what the CT predicts of it as a comparison; None where either shows no cells.

    Its alignment is that of the pose, which nothing was searched for, with the correlation that the pose was found by.
    """
    agreement = pose.fit.agreement[pose.names.index(given.side.name)]
    in_place = replace(IN_PLACE, confidence=max(agreement, 0.0), correlation=agreement)
    try:
        of_ct = Side(MODALITY, prediction)
        cells = given.cells, segment_side(of_ct, PARAMETERS, "dark")
        compared = compare_placed((given.side, of_ct), cells, in_place, PARAMETERS)
    except EndoctError:
        return None
    # doubts about a recording, such as lost frames, do not concern a CT; one about where it lies concerns the side
    doubts = tuple(doubt for doubt in compared.result.doubts if doubt.side != MODALITY or doubt.code in OUT_OF_PLACE)
    return replace(compared, result=compared.result.model_copy(update={"doubts": doubts}))


def save_compared(compared: Comparison, prediction: Panorama, side: Side, made: Made, folder: Path) -> None:
    """Write a comparison with the CT as `endoct compare` writes one, for its page, report and exports."""
    folder.mkdir(parents=True)
    save_comparison(compared, folder / COMPARISON_STORE)
    write_cells(compared.cells, folder / "cells.csv")
    save_panorama(side.panorama, folder / "panoramas" / f"{side.name}.zarr")
    save_panorama(prediction, folder / "panoramas" / f"{MODALITY}.zarr")
    result = compared.result.completed(
        truth={}, raters=None, notes={MODALITY: (NOTE,)}, versions=dict(made.versions), inputs=dict(made.inputs),
        parameters={"compare": {}, side.name: {}, MODALITY: {}}, seconds=dict(made.seconds),
    )  # fmt: skip
    (folder / "result.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")


def _bone(air: AirAround, pose: BorePose, side: Side, grid: SurfaceGrid, z_mm: Coordinates, behind_mm: float) -> Image:
    places = pose.to_lps(side.name, grid.theta_rad, z_mm[:, None], np.array(behind_mm))
    to_plan = np.linalg.inv(pose.plan.to_lps)
    local = torch.as_tensor(places @ to_plan[:3, :3].T + to_plan[:3, 3])
    return np.asarray(1 - air.share(local).numpy(), dtype=np.float32)
