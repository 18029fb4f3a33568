"""The frames of a side for the page: where they lie on the wall, how good they are, of which there are pictures."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.description import FramesPart, PlacementPart, SeriesPart
from endoct.workbench.page.recorded import recording_of
from endoct.workbench.report.pictures import pictured_places

DIGITS = 5
"""Significant ones, of numbers per frame."""


def frames_part(side: str, outline: PanoramaOutline, where: Alignment | None, pictures: Path | None) -> FramesPart:
    """Return the frames of ``side``, moved by ``where`` onto the wall; ``pictures`` is the folder of theirs."""
    stored = outline.per_frame.get(f"{outline.frame_dim}_z_mm")
    own_mm = np.empty(0) if stored is None else np.asarray(stored.values, np.float64)
    z_mm = own_mm if where is None else where.z_to_a(own_mm)
    recording = recording_of(outline)
    return FramesPart(
        side=side,
        frame_dim=outline.frame_dim,
        z_mm=tuple(np.round(z_mm, 6).tolist()),
        pictured=() if pictures is None else tuple(k for k in pictured_places(pictures, side) if k < own_mm.size),
        recording="" if recording is None else str(recording.path),
        placement=_placement(where or IN_PLACE),
        quality=tuple(_quality(outline)),
    )


def _placement(where: Alignment) -> PlacementPart:
    return PlacementPart(where.theta_shift_rad, where.mirrored, where.z_shift_mm, where.z_scale, where.z_reversed)


def _quality(outline: PanoramaOutline) -> Iterator[SeriesPart]:
    """Yield what says how good frames are: numbers with a usual range first, then flags that speak against any."""
    series = sorted(outline.per_frame.items())
    for name, one in series:
        if one.usual is not None and one.values.ndim == 1:
            yield _series(name, one)
    for name, one in series:
        if one.trusted_when is not None and one.doubted.any():
            values = tuple(float(value) for value in one.doubted)
            yield SeriesPart(name, one.doubt, "", None, is_flag=True, values=values)


def _series(name: str, one: PerFrame) -> SeriesPart:
    limits = None if one.usual is None else tuple(float(v) if math.isfinite(v) else None for v in one.usual)
    values = tuple(float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in one.values.astype(float).tolist())
    usual = None if limits is None else (limits[0], limits[1])
    return SeriesPart(name, one.title, one.unit, usual, is_flag=False, values=values)
