"""Strips of one recording put together into its panorama."""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.modalities.contract import Calibration, Manifest
from endoct.stitching.blend import blend
from endoct.stitching.panorama import SURFACE, Panorama
from endoct.stitching.per_frame import per_frame
from endoct.stitching.strip import Strip

OF_THE_SURFACE = frozenset({*SURFACE, "z_mm"})
"""Values per frame cannot have these names, which belong to the panorama's arrays."""


def assemble(
    strips: Iterable[Strip], calibration: Calibration, manifest: Manifest, provenance: Mapping[str, Any] | None = None
) -> Panorama:
    """Return the blended panorama of all ``strips``, not yet settled.

    ``strips``, one a frame, in recording order. Numbers per frame are the calibration's and the strips' diagnostics.
    Raises :class:`EndoctError` for a strip off the calibration's grid, and for diagnostics that differ from frame to
    frame or have a name that is taken.
    """
    diagnostics: list[Mapping[str, float]] = []

    def noting_diagnostics() -> Iterator[Strip]:
        for strip in strips:
            diagnostics.append(strip.diagnostics)
            yield strip

    intensity, depth_mm, valid, weight = blend(noting_diagnostics(), calibration.grid, calibration.row_z_mm)
    of_strips = _by_name(diagnostics, {*OF_THE_SURFACE, *calibration.per_frame}, manifest)
    return Panorama(
        grid=calibration.grid.with_rows(calibration.row_z_mm),
        intensity=intensity,
        depth_mm=depth_mm,
        valid=valid,
        weight=weight,
        modality=manifest.name,
        handedness_known=calibration.handedness_known,
        travel_known=calibration.travel_known,
        frame_dim=manifest.frame_dim,
        per_frame=per_frame(_inward({**calibration.per_frame, **of_strips}, manifest.frame_dim), manifest.per_frame),
        provenance=provenance or {},
        notes=tuple(calibration.notes),
    )


def _by_name(
    diagnostics: Sequence[Mapping[str, float]], taken: Set[str], manifest: Manifest
) -> Mapping[str, NDArray[np.float64]]:
    """Return diagnostics of strips, in recording order, by name."""
    names = list(diagnostics[0]) if diagnostics else []
    for index, of_strip in enumerate(diagnostics):
        if set(of_strip) != set(names):
            raise EndoctError(
                f"the plug-in '{manifest.name}' gives other diagnostics of frame {index} than of the first",
                found=", ".join(sorted(of_strip)) or "none",
                expected=", ".join(sorted(names)) or "none",
            )
    if twice := taken & set(names):
        raise EndoctError(
            f"the plug-in '{manifest.name}' gives diagnostics by names that are taken",
            found=", ".join(sorted(twice)),
            remedy="rename them in the strips' diagnostics",
        )
    return {name: np.array([of_strip[name] for of_strip in diagnostics], dtype=np.float64) for name in names}


def _inward(values: Mapping[str, NDArray[Any]], frame_dim: str) -> dict[str, NDArray[Any]]:
    """Return numbers per frame by ascending z, with each frame's index in the recording."""
    z_mm = np.asarray(values["z_mm"])
    order = np.argsort(z_mm, kind="stable")
    ordered = {name: np.asarray(of_frames)[order] for name, of_frames in values.items() if name != "z_mm"}
    return {f"{frame_dim}_z_mm": z_mm[order], f"{frame_dim}_index": order, **ordered}
