"""Strips of one recording put together into its panorama."""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Calibration, Manifest
from endoct.stitching.blend import blend
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip

OF_THE_SURFACE = frozenset({"intensity", "depth_mm", "valid", "weight", "z", "theta", "z_mm"})
"""Names that figures per frame cannot have: arrays of the panorama in its store."""


def assemble(
    strips: Iterable[Strip],
    calibration: Calibration,
    manifest: Manifest,
    provenance: Mapping[str, Any] | None = None,
) -> Panorama:
    """Return the blended panorama of all ``strips``, not yet settled.

    ``strips``, one a frame, in recording order. Figures per frame are the calibration's and the strips' diagnostics.
    Raises :class:`EndoctError` for a strip off the calibration's grid, and for diagnostics that differ from frame to
    frame or have a name that is taken.
    """
    told: list[Mapping[str, float]] = []

    def heard() -> Iterator[Strip]:
        for strip in strips:
            told.append(strip.diagnostics)
            yield strip

    intensity, depth_mm, valid, weight = blend(heard(), calibration.grid, calibration.row_z_mm)
    of_strips = _by_name(told, {*OF_THE_SURFACE, *calibration.per_frame}, manifest)
    return Panorama(
        grid=calibration.grid,
        z_mm=calibration.row_z_mm,
        intensity=intensity,
        depth_mm=depth_mm,
        valid=valid,
        weight=weight,
        modality=manifest.name,
        handedness_known=calibration.handedness_known,
        travel_known=calibration.travel_known,
        frame_dim=manifest.frame_dim,
        per_frame=_inward({**calibration.per_frame, **of_strips}, manifest.frame_dim),
        provenance=provenance or {},
    )


def _by_name(
    told: Sequence[Mapping[str, float]], taken: Set[str], manifest: Manifest
) -> Mapping[str, NDArray[np.float64]]:
    """Return diagnostics of strips, in recording order, by name."""
    names = list(told[0]) if told else []
    for index, one in enumerate(told):
        if set(one) != set(names):
            raise EndoctError(
                f"the plug-in '{manifest.name}' tells other figures of frame {index} than of the first",
                found=", ".join(sorted(one)) or "none",
                expected=", ".join(sorted(names)) or "none",
            )
    if twice := taken & set(names):
        raise EndoctError(
            f"the plug-in '{manifest.name}' tells figures of frames by names that are taken",
            found=", ".join(sorted(twice)),
            remedy="rename them in the strips' diagnostics",
        )
    return {name: np.array([one[name] for one in told], dtype=np.float64) for name in names}


def _inward(per_frame: Mapping[str, NDArray[Any]], frame_dim: str) -> dict[str, NDArray[Any]]:
    """Return figures per frame by ascending z, with each frame's index in the recording."""
    z_mm = np.asarray(per_frame["z_mm"])
    order = np.argsort(z_mm, kind="stable")
    values = {key: np.asarray(value)[order] for key, value in per_frame.items() if key != "z_mm"}
    return {f"{frame_dim}_z_mm": z_mm[order], f"{frame_dim}_index": order, **values}
