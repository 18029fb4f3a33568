"""Cells of one side: evidence above a threshold, cleaned on the circle, and how far they are to be believed.

Depth by parallax corrects cells that were found by their darkness. A shallow floor may be as bright as the wall, but
lies behind it. A stain is as dark as a cell, but lies in the wall. Where depth is not known, darkness alone decides.

How far cells are believed depends on what the wall around them shows.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.doubt import Doubt
from endoct.base.entry_points import answer_by
from endoct.base.errors import EndoctError
from endoct.base.numeric.regions import label, looked_up, quantiles
from endoct.fusion.evidence.evidence import Evidence, Polarity
from endoct.fusion.evidence.relief import ParallaxRelief
from endoct.fusion.result import CuttingPlane, DecidedByDepth
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.li_alone import LEAST_RELIEF_SIGMAS, above_li, spread_of_wall
from endoct.fusion.segmentation.outlines import clearest_regions, enclosed_by_lines
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.stitching.panorama import Panorama

EyeDeclined = Literal["the wall is too grainy for the learned eye", "the learned eye is not sure of this wall"]
"""Why a learned eye does not decide."""
LEAST_DEPTH_MM = 0.05
LEAST_SIGMAS = 1.5
"""What lies behind the wall by more than either, the depth or so many of its standard errors, is a cell."""
FLAT_MM = 0.025
SURE_MM = 0.05
SURE_SHARE = 0.5
MOST_DARKNESS = 0.3
"""A stain lies no farther behind the wall than ``FLAT_MM`` in the median. That is known to ``SURE_MM`` on at least
``SURE_SHARE`` of it. It is no darker than ``MOST_DARKNESS``, −log of the intensity: deep cells are darker."""
MOST_NOISE = 0.04
"""Above this ``noise_share``, Jaccard indices against the truth were under 0.7, mostly under 0.5."""
MOST_CELLS = 0.6
"""A wall of which more than this is cells was probably missed: bores have 0.08 to 0.3."""
MOST_SPREAD = 0.185
MOST_UNCLAIMED = 0.03
"""Walls above either of these two had a Jaccard index of 0.41 to 0.78 against the truth, all others 0.60 and more.
They are 90 endoscope walls of a second generator (benchmarks/independent: sound, seeds 1300–1339 and 1500–1539, few
and many)."""


def decided_by_depth(valid: Mask, known: Mask, added: Mask, dropped: Mask) -> DecidedByDepth:
    """Return how much depth decided, as shares of what is ``valid``."""
    n = max(int(np.count_nonzero(valid)), 1)
    masks = {"known": known & valid, "added": added, "dropped": dropped}
    return DecidedByDepth(**{name: int(np.count_nonzero(mask)) / n for name, mask in masks.items()})


def judged_by_depth(
    cells: Mask, darkness: Evidence, relief: ParallaxRelief, parameters: SegmentParameters
) -> tuple[Mask, DecidedByDepth]:
    """Return ``cells``, bool (n_z, n_theta), with what lies behind the wall and without stains; and how much changed.

    ``darkness`` is the evidence by which they were found; ``relief`` is on the same samples.
    """
    stains = _stains(cells, darkness, relief)
    behind = _behind(darkness, relief, parameters)
    both = clean((cells & ~stains) | behind, darkness.dz_mm, darkness.column_mm, parameters) | (cells & ~stains)
    both &= darkness.valid
    return both, decided_by_depth(darkness.valid, relief.known, both & ~cells, stains & darkness.valid)


def _behind(darkness: Evidence, relief: ParallaxRelief, parameters: SegmentParameters) -> Mask:
    """Return what surely lies behind the wall."""
    least_mm = np.fmax(np.float32(LEAST_DEPTH_MM), np.float32(LEAST_SIGMAS) * relief.error_mm)
    deep = darkness.valid & relief.known & (relief.relief_mm > least_mm)
    return clean(deep, darkness.dz_mm, darkness.column_mm, parameters)


def _stains(cells: Mask, darkness: Evidence, relief: ParallaxRelief) -> Mask:
    """Return the regions of ``cells`` that lie in the wall."""
    labels, n = label(cells)
    sure = relief.known & (relief.error_mm < SURE_MM)
    size = np.bincount(labels.ravel(), minlength=n + 1)
    share = np.bincount(labels[sure], minlength=n + 1) / np.maximum(size, 1)
    depth_mm = quantiles(np.where(sure, relief.relief_mm, np.float32(np.nan)), labels, n, 0.5)
    dark = quantiles(darkness.values, labels, n, 0.5)
    stain = (share >= SURE_SHARE) & (depth_mm < FLAT_MM) & (dark < MOST_DARKNESS)
    stain[0] = False
    return looked_up(stain, labels)


@dataclass(frozen=True)
class Believability:
    """What speaks for cells or against them, as shares.

    Attributes
    ----------
    noise: samples that lie as far in front of the wall as cells lie behind it, over those that do; 0 without cells.
    cells: cells, over what was observed.
    spread: standard deviation of the wall's own evidence, over how far cells stand out of it in the median.
    unclaimed: samples that stand out as cells do but have no outline, over what was observed; 0 without outlines.
    """

    noise: float
    cells: float
    spread: float
    unclaimed: float


def believability_of(
    valid: Mask, smooth: Image, mask: Mask, threshold: float, *, with_outlines: bool, dark: Mask | None = None
) -> Believability:
    """Return how far cells are to be believed.

    ``smooth`` is the evidence that was thresholded, float32 (n_z, n_theta), 0 where it is that of the wall. ``mask``
    are the cells among the ``valid`` samples; ``dark`` those known by how they stand out, without what lines enclose.
    """
    observed, cells = smooth[valid], mask[valid]
    behind, before = int(np.count_nonzero(observed > threshold)), int(np.count_nonzero(-observed > threshold))
    unclaimed = int(np.count_nonzero((observed > threshold) & ~cells)) if with_outlines else 0
    known = cells if dark is None else dark[valid]
    stands_out = float(np.median(observed[known])) if known.any() else np.inf
    return Believability(
        noise=before / max(behind, 1) if cells.any() else 0.0,
        cells=float(cells.mean()),
        spread=spread_of_wall(observed) / max(stands_out, 1e-9),
        unclaimed=unclaimed / cells.size,
    )


def doubts_of_cells(shares: Believability) -> Iterator[Doubt]:
    """Yield why what was segmented is not to be trusted as cells."""
    if shares.noise > MOST_NOISE:
        what = (
            f"What was taken for cells may be noise: for 100 samples of it {100 * shares.noise:.0f} lie as far in "
            "front of the wall, where nothing can be."
        )
        yield Doubt("cells-in-noise", what, value=shares.noise, unit="1", expected=(0.0, MOST_NOISE))
    yield from doubts_of_share(shares.cells)
    if shares.spread > MOST_SPREAD:
        what = (
            f"Cells hardly stand out of the wall: its own standard deviation is {shares.spread:.0%} of what cells "
            "differ from it by in the median. Some may be missed, some stains of the wall."
        )
        yield Doubt("cells-faint", what, value=shares.spread, unit="1", expected=(0.0, MOST_SPREAD))
    if shares.unclaimed > MOST_UNCLAIMED:
        what = (
            f"{shares.unclaimed:.1%} of the wall is as dark as cells, but has no clear outline; cells are "
            f"{shares.cells:.1%} of it. Some may be missed."
        )
        yield Doubt("cells-without-outline", what, value=shares.unclaimed, unit="1", expected=(0.0, MOST_UNCLAIMED))


def doubts_of_share(cells: float) -> Iterator[Doubt]:
    """Yield the doubt about a wall of which the share ``cells`` was taken for cells."""
    if cells > MOST_CELLS:
        what = f"The wall may not have been found: {cells:.0%} of it was taken for cells."
        yield Doubt("wall-mostly-cells", what, value=cells, unit="1", expected=(0.0, MOST_CELLS))


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Cells of one side on its own samples.

    Attributes
    ----------
    mask: bool (n_z, n_theta), False where nothing was observed.
    threshold: in ``unit``, of the evidence that ``of`` describes; None where the mask was given.
    polarity: whether cells are dark or bright; None where depth or a mask says what is a cell.
    by: what found them: threshold and outlines, a learned eye, a method that was chosen by name, or a mask as given.
    polarity_from: how the polarity is known, in words; None where there is none.
    by_depth: how much depth by parallax changed; None where it had no say.
    doubts: why these are not to be trusted as cells.
    probability: float32, of a cell at each sample, by a learned eye that was asked; None where none was.
    planes: those that cut the bore, such as fractures, which are no cells; by their dark lines.
    eye_declined: why a learned eye that could have been asked did not find them; None where there was none, or it did.
    """

    mask: Mask
    threshold: float | None
    unit: str
    of: str
    polarity: Polarity | None
    by: Literal["rules", "eye", "method", "mask"]
    polarity_from: str | None = None
    by_depth: DecidedByDepth | None = None
    doubts: tuple[Doubt, ...] = ()
    eye_declined: EyeDeclined | None = None
    probability: Image | None = None
    planes: tuple[CuttingPlane, ...] = ()


def find_cells(
    evidence: Evidence,
    parameters: SegmentParameters,
    polarity_from: str | None = None,
    relief: ParallaxRelief | None = None,
) -> Segmentation:
    """Return the cells that ``evidence`` shows: Li's threshold, opened, closed, and without small cells.

    ``relief`` by parallax on the same samples, if any, corrects what intensity shows. Evidence that is a mask is taken
    as it is.

    Raises :class:`EndoctError` where all evidence is alike.
    """
    p = parameters
    polarity: Polarity | None = None
    if evidence.kind == "mask":
        return Segmentation(evidence.valid & (evidence.values > 0.5), None, "1", "mask as given", None, "mask")
    li = above_li(evidence, p)
    mask, threshold, smooth = li.mask, li.threshold, li.smooth
    if evidence.kind == "relief":
        unit = "mm"
        of = f"relief behind the wall, floored at {li.low:g} and capped at {li.high:g} mm"
    else:
        polarity, unit = ("dark" if evidence.kind == "darkness" else "bright"), "1"
        sign = "−log" if polarity == "dark" else "log"
        of = f"{sign} of intensity relative to the wall's, floored at {li.low:.2g} and capped at {li.high:g}"
    if li.was_raised:
        of += f", raised to {LEAST_RELIEF_SIGMAS:g} times the spread of a wall without cells"
    clear = None
    if p.outlines and evidence.kind == "darkness":
        clear = clearest_regions(evidence, np.clip(smooth, 0, li.high), threshold, p)
    dark = mask if clear is None else clear
    if clear is not None:
        mask = clear | enclosed_by_lines(evidence, clear, p)
        of += ", cells up to their clearest outline, and what dark lines enclose"
    by_depth = None
    if relief is not None and p.by_depth and polarity is not None:
        mask, by_depth = judged_by_depth(mask, evidence, relief, p)
        of += ", corrected by depth from parallax"
    believability = believability_of(
        evidence.valid, smooth, mask, threshold, dark=dark, with_outlines=clear is not None
    )
    doubts = tuple(doubts_of_cells(believability))
    return Segmentation(mask, threshold, unit, of, polarity, "rules", polarity_from, by_depth, doubts)


def cells_by_method(panorama: Panorama, name: str) -> Segmentation:
    """Return the cells of a panorama by the method ``name``; nothing says how far they can be trusted.

    Raises :class:`EndoctError` where there is no such method, it fails, or answers something else than a mask, bool
    (n_z, n_theta).
    """
    mask = np.asarray(answer_by("segmentation", name, panorama, setting="segmentation_method"))
    if mask.shape != panorama.grid.shape or mask.dtype != np.bool_:
        raise EndoctError(
            f"the segmentation method '{name}' answers no mask",
            found=f"{mask.dtype} {mask.shape}",
            expected=f"bool {panorama.grid.shape}",
        )
    what = f"Cells are those of the method '{name}'; endoct does not judge how far to trust them."
    doubts = (Doubt("cells-by-method", what),)
    of = f"cells by the method '{name}'"
    return Segmentation(mask & panorama.valid, None, "1", of, None, "method", doubts=doubts)
