"""Masks given as truth: they are read, each side is scored against every one, and several raters against each other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomlkit

from endoct.base.arrays import Mask
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.side import DrawnMask, Side
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.files.masks import (
    DRAWN_STORE,
    MAJORITY,
    mask_on,
    on_comparison,
    read_mask,
    save_drawings,
    score_surface,
)
from endoct.fusion.files.outlines import OUTLINE_SUFFIXES
from endoct.fusion.result import Consensus, DrawnBy, MaskScores, Raters
from endoct.fusion.scoring.overlap import Surface
from endoct.fusion.scoring.raters import MOST_DRAWINGS, Drawing, majority, rater_agreement, staple
from endoct.fusion.sides import Comparison
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

METHODS = {
    "majority": "cell where more than half of the raters drew one, each by the mean over the sessions",
    "staple": "STAPLE (Warfield 2004), every drawing a rater of its own",
}
MOST_DRAWN = 0.5
"""A mask with more of the wall may be drawn black on white."""


@dataclass(frozen=True, eq=False)
class Against:
    """The scores against masks given as truth: by the mask's path, then by side; the masks on the comparison's grid.

    Where there are several masks, how raters agree, and the mask of the majority.
    """

    truth: dict[str, dict[str, MaskScores]]
    drawings: tuple[Drawing, ...] = ()
    raters: Raters | None = None
    consensus: Mask | None = None


def check_truth(path: Path) -> None:
    """Raise :class:`EndoctError` for a truth that cannot be read; only a panorama shows what outlines enclose."""
    simulated = (path / "recording.json").is_file()
    if not simulated and not (path.is_file() and path.suffix.lower() in OUTLINE_SUFFIXES):
        read_drawing(path, None)


def truth_on(path: Path, a: Panorama) -> DrawnMask:
    """Return a mask drawn on ``a``, or what a simulated specimen's truth folder says ``a`` should show."""
    if not (path / "recording.json").is_file():
        return read_mask(path, like=a)
    truth = load_truth(path.parent)
    return mask_on(true_cells(truth, true_pose(a, truth), a), a, path)


def score_drawings(comparison: Comparison, drawn: Mapping[str, DrawnMask], tolerance_mm: float) -> Against:
    """Score each side against the masks ``drawn``, by path; of two and more, how raters agree too.

    Raises :class:`EndoctError` where two masks are of one rater and session, or there are too many.
    """
    if not drawn:
        return Against({})
    surfaces = {path: on_comparison(comparison, mask) for path, mask in drawn.items()}
    truth = {path: score_surface(comparison, surface, tolerance_mm) for path, surface in surfaces.items()}
    drawings = tuple(
        Drawing(mask.rater, mask.session, surfaces[path].mask, surfaces[path].valid) for path, mask in drawn.items()
    )
    if len(drawn) == 1:
        return Against(truth, drawings)
    _check(drawings)
    covered = np.logical_and.reduce([drawing.valid for drawing in drawings])
    by_majority = majority(drawings) & covered
    by_staple, performance = staple(drawings, covered)
    raters = Raters(
        drawings=tuple(
            DrawnBy(path=path, rater=d.rater, session=d.session) for path, d in zip(drawn, drawings, strict=True)
        ),
        **dict(rater_agreement(drawings, comparison.grid, tolerance_mm)),
        consensus={
            name: Consensus(
                method=METHODS[name], sides=score_surface(comparison, Surface("consensus", mask, covered), tolerance_mm)
            )
            for name, mask in (("majority", by_majority), ("staple", by_staple))
        },
        performance=performance,
    )
    return Against(truth, drawings, raters, by_majority)


def doubts_of_drawings(sides: Sequence[Side], against: Against) -> Iterator[Doubt]:
    """Yield the doubt about each mask, a side or given as truth, that has most of the wall as cell."""
    masks = [(side.drawing.file, side.drawing.mask) for side in sides if side.drawing is not None]
    drawn = zip(against.truth, against.drawings, strict=True)
    masks += [(Path(path).name, drawing.mask[drawing.valid]) for path, drawing in drawn]
    for name, mask in masks:
        if (share := np.count_nonzero(mask) / max(mask.size, 1)) > MOST_DRAWN:
            what = f"In the mask {name} {share:.0%} of the wall is cell; it may be drawn black on white."
            yield Doubt("mask-mostly-cells", what, value=share, unit="1", expected=(0.0, MOST_DRAWN))


def write_drawings(against: Against, grid: SurfaceGrid, folder: Path) -> None:
    """Write the masks, with what most raters drew where there are several, for whoever looks at the comparison."""
    drawings = against.drawings
    if against.consensus is not None:
        covered = np.logical_and.reduce([drawing.valid for drawing in drawings])
        drawings = (*drawings, Drawing(MAJORITY, "1", against.consensus, covered))
    if drawings:
        save_drawings(drawings, grid, folder / DRAWN_STORE)


def write_mask(mask: Mask, grid: SurfaceGrid, path: Path) -> None:
    """Write ``mask`` on ``grid`` as an image with the sidecar that lets it be a side or a truth again."""
    turned = np.roll(mask, round(float(grid.column_of(0.0))) * -1, axis=1)
    path.write_bytes(cv2.imencode(".png", turned.astype(np.uint8) * 255)[1].tobytes())
    keys = {
        "modality": "mask",
        "bore_diameter_mm": 2 * grid.radius_mm,
        "z0_mm": grid.z0_mm,
        "dz_mm": grid.dz_mm,
        "rater": "consensus",
    }
    path.with_suffix(".toml").write_text(tomlkit.dumps(keys), encoding="utf-8")


def _check(drawings: Sequence[Drawing]) -> None:
    named = [(drawing.rater, drawing.session) for drawing in drawings]
    twice = next((name for name in named if named.count(name) > 1), None)
    if twice is not None:
        raise EndoctError(
            "two masks are of one rater and session",
            found=f"rater {twice[0]}, session {twice[1]}",
            expected="each once",
            remedy="name the files RATER_SESSION.png, or give rater and session in their sidecars",
        )
    if len(drawings) > MOST_DRAWINGS:
        raise EndoctError("too many masks", found=str(len(drawings)), expected=f"{MOST_DRAWINGS} at most")
