"""Frames that a panorama's flags speak against, in words."""

from collections.abc import Iterator

import numpy as np

from endoct.stitching.arrays import Mask
from endoct.workbench.report.side_findings import SideFindings


def flagged_frames(side: SideFindings) -> list[tuple[str, Mask]]:
    """Return what every flag says of the frames it speaks against ("bridged"), and these frames, bool (n_frames,)."""
    flags = (one for _, one in sorted(side.panorama.per_frame.items()) if one.trusted_when is not None)
    return [(one.doubt, one.doubted) for one in flags]


def flag_rows(side: SideFindings) -> Iterator[list[str]]:
    """Yield ["bridged", "3 of 40", "3, 17–18", "0.60, 3.40–3.60 mm"] for every flag that speaks against a frame."""
    z_mm = side.frame_z_mm
    for what, frames in flagged_frames(side):
        if not frames.any():
            continue
        where = [(int(run[0]), int(run[-1])) for run in _runs(frames)]
        places = "–"
        if z_mm.size == frames.size:
            places = ", ".join(_span(f"{z_mm[a]:.2f}", f"{z_mm[b]:.2f}") for a, b in where) + " mm"
        numbers = ", ".join(_span(str(first), str(last)) for first, last in where)
        yield [what, f"{np.count_nonzero(frames)} of {frames.size}", numbers, places]


def _runs(frames: Mask) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    indices = np.flatnonzero(frames)
    return np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)


def _span(first: str, last: str) -> str:
    return first if first == last else f"{first}–{last}"
