"""Where the disagreement of two sides comes from: 1 − J parted into four causes."""

from endoct.fusion.result.part import Count, Interval, Number, Part, WholeOrNumber


class BudgetPart(Part):
    """What one cause costs: a share of 1, the union of both sides' cells, and its interval over patches of wall."""

    share: Number
    interval: Interval | None


class BudgetParts(Part):
    """The four causes; they sum to 1 − J."""

    alignment: BudgetPart
    sampling: BudgetPart
    visibility: BudgetPart
    segmentation: BudgetPart

    def by_cause(self) -> dict[str, BudgetPart]:
        """Return the parts by name, in the order in which they are taken off."""
        return {
            "alignment": self.alignment,
            "sampling": self.sampling,
            "visibility": self.visibility,
            "segmentation": self.segmentation,
        }


class NotVisible(Part):
    """Cells of one side of which the other has no sign."""

    cells: Count
    area_mm2: WholeOrNumber


class Budget(Part):
    """1 − J by causes; ``not_visible`` and ``not_covered`` (mm²) by the side that does not show the other's cells."""

    one_minus_jaccard: Number
    parts: BudgetParts
    alignment_known: bool
    not_visible: dict[str, NotVisible]
    not_covered: dict[str, WholeOrNumber]
    draws: Count | None = None
