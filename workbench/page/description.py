"""What the page gets before the first tile: one description, of a comparison or of one panorama.

The page's sources have the same names in ``frontend/src/description.ts``.
"""

from dataclasses import asdict, dataclass
from typing import Literal

CellState = Literal["matched", "overlapping", "alone", "not observed", "not aligned"]
"""What the other side has where a cell lies: "alone" means wall."""


@dataclass(frozen=True)
class WallPart:
    """The wall that panes show, in mm; its circle is 2π · ``radius_mm`` long."""

    radius_mm: float
    top_mm: float
    bottom_mm: float


@dataclass(frozen=True)
class ClassPart:
    """A class of samples and its colour, as "#e69f00"."""

    label: str
    colour: str


@dataclass(frozen=True)
class LayerPart:
    """One thing that a pane can show.

    ``key`` stands in the addresses of tiles. ``side`` is None for what concerns both. ``kind``: numbers that the page
    colours, or classes in colours. Numbers have a ``quantity`` and a ``unit``. ``low`` and ``high`` are the values of
    their first and last code, ``shown_low`` to ``shown_high`` is the contrast to begin with. Classes have ``classes``.
    ``finest_level`` is that of its tiles. Its samples lie ``row_mm`` and ``column_mm`` apart.
    """

    key: str
    title: str
    side: str | None
    kind: Literal["scalar", "classes"]
    quantity: str
    unit: str
    low: float
    high: float
    shown_low: float
    shown_high: float
    classes: tuple[ClassPart, ...]
    finest_level: int
    row_mm: float
    column_mm: float


@dataclass(frozen=True)
class OutlinePart:
    """Cells that can be outlined: the ``layer`` and the ``side`` on which they lie, and the ``colour`` of the lines.

    ``title`` says whose they are; those that ``is_drawn`` by hand, or are of the one wall of both, have no numbers.
    """

    layer: str
    side: str
    title: str
    colour: str
    is_drawn: bool


@dataclass(frozen=True)
class CellPart:
    """A row of ``cells.csv``, and in words what the other side has there; ``state`` for filters.

    ``is_real``: whether the truth has a cell there; None where there is none.
    """

    side: str
    id: int
    theta_rad: float
    z_mm: float
    area_mm2: float
    diameter_mm: float
    depth_median_mm: float | None
    depth_p95_mm: float | None
    volume_mm3: float | None
    depth_of: str | None
    contrast: float | None
    touches_edge: bool
    observed_by_other: float
    covered: float | None
    seen_by: str
    partner: int | None
    overlap: float
    depth_error_mm: float | None
    own_depth_mm: float | None
    own_depth_error_mm: float | None
    state: CellState
    why: str
    is_real: bool | None


@dataclass(frozen=True)
class SeriesPart:
    """Numbers per frame: what they are, their ``unit``, the ``usual`` range (None: no limit), and the ``values``.

    Flags are 1 where they speak against their frame, and have ``is_flag``; None where a value is not known.
    """

    name: str
    title: str
    unit: str
    usual: tuple[float | None, float | None] | None
    is_flag: bool
    values: tuple[float | None, ...]


@dataclass(frozen=True)
class BendPart:
    """How the place of a side bends along the bore, as :class:`~endoct.fusion.geometry.alignment.Bend` has it."""

    z_mm: tuple[float, ...]
    shift_mm: tuple[float, ...]
    roll_rad: tuple[float, ...]


@dataclass(frozen=True)
class PlacementPart:
    """How places of a side, in its own frame, lie on the wall that is shown, as
    :class:`~endoct.fusion.geometry.alignment.Alignment` has it.
    """

    theta_shift_rad: float
    mirrored: bool
    z_shift_mm: float
    z_scale: float
    z_reversed: bool
    bend: BendPart | None


@dataclass(frozen=True)
class FramesPart:
    """The frames of one side, in the order of ascending z in its own frame.

    Attributes: what a frame is called; ``z_mm`` of each on the wall; ``pictured``, of which there are pictures;
    ``recording``, where it lies, if it is at hand and can be read for pictures of the others, else "";
    ``placement``, how the side lies on the wall; ``quality``, numbers that say how good each frame is.
    """

    side: str
    frame_dim: str
    z_mm: tuple[float, ...]
    pictured: tuple[int, ...]
    recording: str
    placement: PlacementPart
    quality: tuple[SeriesPart, ...]


@dataclass(frozen=True)
class Description:
    """What the page's program is told besides images.

    Attributes: ``title``, what the page is called; ``verdict``, what is said against it in a figure's caption, "" for
    nothing; ``endoct``, the version that made it; ``panes`` the layers that are shown at first; ``has_common_places``:
    whether a place is the same in every layer; ``has_volume``: whether there is a dense volume.
    """

    title: str
    verdict: str
    endoct: str
    sides: tuple[str, ...]
    wall: WallPart
    layers: tuple[LayerPart, ...]
    outlines: tuple[OutlinePart, ...]
    cells: tuple[CellPart, ...]
    frames: tuple[FramesPart, ...]
    panes: tuple[str, ...]
    has_common_places: bool
    has_volume: bool

    def to_json(self) -> dict[str, object]:
        """Return the description as an object of lists, dicts, texts and numbers only."""
        return asdict(self)
