"""What a reader of a comparison should not rely on, in full sentences."""

from collections.abc import Iterator

import numpy as np

from endoct.fusion.result import Line, Result
from endoct.stitching.arrays import Mask
from endoct.workbench.report.findings import Findings, SideFindings

LEAST_VALID_SHARE = 0.9
"""Where less of the wall was observed, the report says so."""

LEAST_DRIFT_MM = 0.1
"""Cells that drift apart by less are no reason to doubt the alignment,"""
SURE_OF_DRIFT = 2.5
"""nor by less than so many standard errors."""


def doubts(findings: Findings) -> list[str]:
    """Return everything that is not to be trusted: the alignment, unobserved wall, frames, and the sides' own notes."""
    return [
        *on_the_whole(findings.result),
        *(sentence for side in findings.sides for sentence in _on_side(findings, side)),
    ]


def doubted_frames(side: SideFindings) -> list[tuple[str, Mask]]:
    """Return what every flag says of the frames it speaks against ("bridged"), and these frames, bool (n_frames,)."""
    flags = (one for _, one in sorted(side.panorama.per_frame.items()) if one.trusted_when is not None)
    return [(one.doubt, one.doubted) for one in flags]


def on_the_whole(result: Result) -> Iterator[str]:
    """Yield what speaks against the comparison as a whole."""
    if not result.aligned:
        yield f"The two sides were not aligned: {without_stop(result.reason)}."
        return
    if result.forced:
        yield "The alignment was believed because that was asked for, however little it stood out."
    if twist := result.twist:
        without, corrected = _jaccard_text(twist.jaccard_without), _jaccard_text(twist.jaccard_with)
        yield (
            f"The rows of {result.sides[1]} were turned to where they fit {result.sides[0]} best, as was asked "
            f"for. That raises the score by itself: the Jaccard index is {without} without it, {corrected} with it."
        )
    if result.valid_fraction < LEAST_VALID_SHARE:
        yield f"Both sides observed only {result.valid_fraction:.1%} of the wall over the length that they share."
    if drift := result.scores.drift if result.scores else None:
        for what, line in (("along the bore", drift.z_mm), ("around the bore", drift.arc_mm)):
            if grown_mm := _grown_mm(line, drift.length_mm):
                yield (
                    f"Cells that both sides show drift apart {what}, by {abs(grown_mm):.2f} mm over "
                    f"{drift.length_mm:.1f} mm of it: the alignment may be wrong, or not rigid."
                )
    if result.jaccard is None:
        yield "Neither side shows a cell where both observed the wall, so there is nothing to score."


def _jaccard_text(jaccard: float | None) -> str:
    return "not known" if jaccard is None else f"{jaccard:.3f}"


def _grown_mm(line: Line, length_mm: float) -> float | None:
    """Return by how much matched cells drift apart over the length on which there are any; None where they do not."""
    grown_mm = line.per_mm * length_mm
    sure = abs(line.per_mm) > SURE_OF_DRIFT * line.per_mm_error
    return grown_mm if sure and abs(grown_mm) > LEAST_DRIFT_MM else None


def _on_side(findings: Findings, side: SideFindings) -> Iterator[str]:
    share = float(side.panorama.valid.mean())
    if share < LEAST_VALID_SHARE:
        yield f"{side.name}: only {share:.1%} of its own panorama is observed wall."
    for doubt, frames in doubted_frames(side):
        if frames.any():
            yield f"{side.name}: {_sentence(side, doubt, frames)}"
    for note in findings.result.notes.get(side.name, ()):
        yield f"{side.name}: {note}"


def without_stop(text: str | None) -> str:
    """Return a sentence without its full stop, to be put into another."""
    return (text or "").strip().rstrip(".")


def _sentence(side: SideFindings, what: str, frames: Mask) -> str:
    """Return "3 of 40 slices (3, 17–18; z = 0.60, 3.40–3.60 mm): bridged."."""
    dim = side.panorama.frame_dim
    where = [(int(run[0]), int(run[-1])) for run in _runs(frames)]
    said = ", ".join(_span(str(first), str(last)) for first, last in where)
    z_mm = side.frame_z_mm
    if z_mm.size == frames.size:
        said += f"; z = {', '.join(_span(f'{z_mm[a]:.2f}', f'{z_mm[b]:.2f}') for a, b in where)} mm"
    return f"{np.count_nonzero(frames)} of {frames.size} {dim}s ({said}): {what}."


def _runs(frames: Mask) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    indices = np.flatnonzero(frames)
    return np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)


def _span(first: str, last: str) -> str:
    return first if first == last else f"{first}–{last}"
