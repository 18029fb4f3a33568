"""What a result says of its own error: what the truth would give the cells of this specimen, and within what bounds."""

from endoct.fusion.result.scores import Count, Number, Part

LEAST_SPREAD = 0.01
"""However sure the wall is, truths lie this far from it."""
SHARE = 0.95
"""What ``found_from`` and ``sure_from`` promise of an area."""


class Bounded(Part):
    """A figure of ``of``, a side or the wall, as the truth is expected to give it, and its bounds.

    ``low`` and ``high`` are None where nothing is promised.
    """

    of: str
    expected: Number
    low: Number | None = None
    high: Number | None = None

    def text(self, digits: int = 2) -> str:
        """Return "0.93 (0.90–0.95)", or "0.93" where nothing is promised."""
        said = f"{self.expected:.{digits}f}"
        if self.low is None or self.high is None:
            return said
        return f"{said} ({self.low:.{digits}f}–{self.high:.{digits}f})"


class Features(Part):
    """What specimens are held against each other by, besides indices to expect, and the area and number of cells.

    Attributes
    ----------
    jaccard, alignment: of the two sides; what the alignment costs of it, by the budget.
    cell_mm2, outline_per_mm: mean area of a cell of the wall; length of all outlines over the area of all cells.
    depth_mm, wall_spread_mm: median relief in cells; median size of that of the plain wall.
    contrast: how far cells stand out of the wall where light shows them, in its standard deviations.
    """

    jaccard: Number
    alignment: Number
    cell_mm2: Number
    outline_per_mm: Number
    depth_mm: Number
    wall_spread_mm: Number
    contrast: Number


class Bounds(Part):
    """What to expect of cells against the truth, where both sides observed the wall.

    Attributes
    ----------
    light, depth, wall: Jaccard indices of the side that sees light, of that which measures depth, and of the one wall.
    area_mm2: of all true cells.
    level: the share of specimens of which the bounds of each figure hold.
    calibrated_by: what known specimens the bounds rest on; ``specimens``, how many.
    alike: how probable a specimen so unlike the others is, were it one of them.
    found_from: the highest probability of a cell such that :data:`SHARE` of the area of all cells has no lower one.
    sure_from: the lowest such that :data:`SHARE` of the area with no lower one is cell. Both are None where nothing is
        promised, or no probability does it.
    """

    light: Bounded
    depth: Bounded
    wall: Bounded
    area_mm2: Bounded
    features: Features
    level: Number | None = None
    calibrated_by: str | None = None
    specimens: Count | None = None
    alike: Number | None = None
    found_from: Number | None = None
    sure_from: Number | None = None

    @property
    def spread(self) -> float:
        """How far truths may lie from what is expected, relative to other specimens."""
        return max(1.0 - self.wall.expected + self.features.alignment, LEAST_SPREAD)

    @property
    def sentence(self) -> str:
        """What to expect of this specimen, in a sentence."""
        indices = ", ".join(f"{each.of} {each.text()}" for each in (self.light, self.depth, self.wall))
        held = "nothing is promised"
        if self.light.low is not None and self.level is not None:
            held = f"each holds in {self.level:.0%} of such specimens"
        elif self.alike is not None:
            held += f", as it is unlike the {self.specimens} {self.calibrated_by} (p = {self.alike:.2f})"
        area = f"{self.area_mm2.text(1)} mm² of cells"
        if self.found_from is not None and self.sure_from is not None:
            area += (
                f"; {SHARE:.0%} of their area has a probability of {self.found_from:.2f} or more, and {SHARE:.0%} of "
                f"what has {self.sure_from:.2f} or more is cell"
            )
        return f"Jaccard index to expect against the truth: {indices}; {area}; {held}."
