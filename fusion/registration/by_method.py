"""Where one side lies on the other by a method that was chosen by name, next to our own search."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from endoct.base.doubt import Doubt
from endoct.base.entry_points import answer_by
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.evidence import clipped, correlation
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.fusion.registration.rigidity import STEP_MM, in_one_frame


def align_by_method(a: Side, b: Side, name: str) -> Alignment | NotAligned:
    """Return where ``b`` lies on ``a`` by the method ``name``, with how well the two correlate there.

    Raises :class:`EndoctError` where there is no such method, it fails, or answers something else than an alignment by
    which the two share some wall.
    """
    answer = answer_by("alignment", name, a.panorama, b.panorama, setting="alignment_method")
    if isinstance(answer, NotAligned):
        return answer
    if not isinstance(answer, Alignment) or not _is_possible(answer):
        raise EndoctError(
            f"the alignment method '{name}' answers no alignment",
            found=repr(answer)[:100] if isinstance(answer, Alignment) else type(answer).__name__,
            expected="an Alignment of finite turn, shift and scale, or NotAligned",
        )
    along_mm = answer.z_to_a(b.evidence.z_mm)
    first_mm, last_mm = max(a.evidence.z_mm[0], along_mm.min()), min(a.evidence.z_mm[-1], along_mm.max())
    if last_mm - first_mm < 2 * STEP_MM:
        return NotAligned(f"As the method '{name}' lays {b.name} on {a.name}, the two share no wall.")
    there_a, there_b = in_one_frame(clipped(a.evidence), clipped(b.evidence), answer, 0.0)
    shared_mm2 = float((there_a.valid & there_b.valid).sum()) * STEP_MM * there_a.column_mm
    return replace(answer, correlation=correlation(there_a, there_b), overlap_mm2=shared_mm2)


def _is_possible(alignment: Alignment) -> bool:
    placed = alignment.theta_shift_rad, alignment.z_shift_mm, alignment.z_scale
    return bool(np.isfinite(placed).all()) and alignment.z_scale > 0


def doubts_by_method(
    alignment: Alignment, ours: Alignment | NotAligned, name: str, a: Side, b: Side
) -> Iterator[Doubt]:
    """Yield the doubt of an ``alignment`` by the method ``name``, with how far from ``ours`` it is."""
    what = f"The alignment is that of the method '{name}'; endoct does not judge how far it can be trusted."
    if isinstance(ours, NotAligned):
        yield Doubt("aligned-by-method", f"{what} Its own search finds none.")
        return
    if (ours.mirrored, ours.z_reversed) != (alignment.mirrored, alignment.z_reversed):
        yield Doubt("aligned-by-method", f"{what} Its own search has {b.name} the other way around.")
        return
    middle_mm = float(b.grid.z_mm.mean())
    turn_rad = float(wrap_rad(np.float64(alignment.theta_shift_rad - ours.theta_shift_rad)))
    along_mm = float(alignment.z_to_a(middle_mm) - ours.z_to_a(middle_mm))
    apart_mm = float(np.hypot(turn_rad * a.grid.radius_mm, along_mm))
    said = f"{what} In the middle of {b.name} its own search lies {apart_mm:.2f} mm away."
    yield Doubt("aligned-by-method", said, value=apart_mm, unit="mm", expected=0.0)
