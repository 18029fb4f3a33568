"""Specimens whose cells somebody drew before, by which the error of a new one is bounded."""

from collections.abc import Sequence
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.fusion.files.result_file import read_result
from endoct.fusion.wall.bounds import FEWEST, LEVEL, Calibration, Known


def calibration_by(folders: Sequence[Path]) -> Calibration:
    """Return what comparisons with masks given as truth say of the error of each side's cells.

    Of several masks of one specimen, what most raters drew is the truth. Raises :class:`EndoctError` where there are
    fewer than :data:`FEWEST`, a folder is no comparison, or it says nothing of the error of its cells.
    """
    if len(folders) < FEWEST:
        raise EndoctError(
            f"too few known specimens to bound an error in {LEVEL:.0%} of all",
            found=f"{len(folders)}",
            expected=f"{FEWEST} or more",
            remedy="compare more specimens with masks as --truth, or leave --known out",
        )
    return Calibration(f"{len(folders)} specimens with drawn masks", [_known(folder) for folder in folders])


def _known(folder: Path) -> Known:
    result = read_result(folder)
    drawn = list((result.truth or {}).values())
    sides = result.raters.majority.sides if result.raters else drawn[0] if len(drawn) == 1 else {}
    bounds = result.bounds
    of = {} if bounds is None else {"light": bounds.light.of, "depth": bounds.depth.of}
    truth = {figure: sides[side].jaccard for figure, side in of.items() if side in sides}
    if bounds is None or len(truth) < len(of) or None in truth.values():
        raise EndoctError(
            f"{folder} says nothing of the error of its cells",
            found="no mask given as truth" if bounds is not None else "no wall of both sides, or an older version",
            expected="a comparison by this version, aligned, of OCT and endoscope, with --truth",
        )
    return Known(bounds, {figure: index for figure, index in truth.items() if index is not None})
