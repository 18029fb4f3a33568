"""Figures of what :mod:`benchmarks.physics.instrument` measures."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.physics import instrument
from benchmarks.physics.drawing import Curve, Panel, save_panels
from benchmarks.physics.plots import Line
from tests import tolerances as within


def speckle_of_bone(folder: Path) -> Iterator[Line]:
    """Speckle over the catheter's speed, over its offset, from slice to slice, and scanned again."""
    speed = instrument.speckle_over_speed()
    around = instrument.speckle_around_an_offset()
    place, pulled = instrument.speckle_over_place(), instrument.helical()
    apart = [
        Curve(1e3 * place.x, place.measured, place.expected, "stopped at"),
        Curve(1e3 * pulled.x, pulled.measured, pulled.expected, "pulled on during the turn"),
    ]
    panels = [
        Panel(
            "Width of speckle",
            "speed over its mean",
            "A-scans",
            "rest",
            [Curve(speed.x, speed.measured, speed.expected)],
        ),
        Panel(
            "Catheter 0.22 mm off axis",
            "direction from the offset (°)",
            "A-scans",
            "rest",
            [Curve(np.rad2deg(around.x), around.measured, around.expected)],
        ),
        Panel("Two slices", "apart (µm)", "correlation", "rest", apart),
    ]
    save_panels(folder / "speckle_of_bone.png", panels)
    for x, measured, expected in zip(speed.x, speed.measured, speed.expected, strict=True):
        name = f"width of speckle at {x:.2f} of the mean speed"
        yield Line(name, measured, expected, within.SPECKLE_OVER_SPEED_REL * expected, "A-scans")
    sticking = instrument.speed_from_speckle()
    off = float(np.sqrt(np.mean((sticking.measured / sticking.expected - 1) ** 2)))
    alike = float(np.corrcoef(sticking.measured, sticking.expected)[0, 1])
    yield Line("speed of a catheter that sticks and slips, by its speckle, rms error", off, 0.0, within.SPEED_REL)
    yield Line("and its correlation with the truth", alike, 1.0, 0.2)
    yield Line("width of speckle around an offset, largest departure", around.worst_rel, 0.0, within.INSTRUMENT_REL)
    for name, found in (("apart", place), ("of a helical scan", pulled)):
        worst = float(np.abs(found.measured - found.expected).max())
        limit = within.SPECKLE_CORRELATION * (1 if found is place else 3)
        yield Line(f"correlation of slices {name}, largest departure", worst, 0.0, limit)
    yield Line("correlation of a slice scanned again", instrument.repeated(), 1.0, 0.05)
    yield Line("and from 50 µm aside", instrument.repeated(0.05), 0.0, 0.1)


def focus(folder: Path) -> Iterator[Line]:
    """Loss of light and width of speckle out of focus."""
    loss, width = [], []
    for lateral_mm in (0.02, 0.03):
        lost, wide = instrument.focus(lateral_mm)
        name = f"{1e3 * lateral_mm:.0f} µm"
        loss.append(Curve(lost.x, lost.measured, lost.expected, name))
        width.append(Curve(wide.x, wide.measured, wide.expected, name))
        at = f"1 mm from the focus, spot of {name}"
        limit = within.INSTRUMENT_REL * lost.expected[2]
        yield Line(f"loss {at}", lost.measured[2], lost.expected[2], max(limit, 0.02), "dB")
        yield Line(f"speckle {at}", wide.measured[2], wide.expected[2], within.INSTRUMENT_REL * wide.expected[2], "µm")
    panels = [
        Panel("Out of focus: light", "from the focus (mm)", "loss (dB)", "rest (dB)", loss),
        Panel("Out of focus: speckle", "from the focus (mm)", "width (µm)", "rest (µm)", width),
    ]
    save_panels(folder / "focus.png", panels)


def reflections(folder: Path) -> Iterator[Line]:
    """Flares, ghosts, the floor's bands and the sheath; a figure of the floor."""
    found = instrument.reflections()
    yield Line("slices whose faces flare twice a turn, share", found.flares / found.slices, 1.0, 0.0)
    yield Line("flares beside the squares, at most", float(np.rad2deg(found.off_rad)), 0.0, 0.6, "°")
    yield Line("ghost of the capillary", *found.ghost_db, within.GHOST_DB, "dB")
    yield Line("double pass", *found.double_pass_db, within.GHOST_DB, "dB")
    bands_db, row_db = instrument.noise_floor(2.6)
    yield Line("noise floor, between depths", bands_db, 2.6, 2.6 * within.INSTRUMENT_REL, "dB")
    rows = np.arange(8.0, 8.0 + row_db.size)
    panel = Panel(
        "Floor of the noise", "depth (rows of 512)", "level (dB)", "rest (dB)", [Curve(rows, row_db, 0 * rows)]
    )
    save_panels(folder / "noise_floor.png", [panel])
    band = instrument.sheath(0.1)
    yield Line("sheath: contrast of its speckle", band.contrast, 1.0, within.SPECKLE_CONTRAST_OF_SHEATH)
    yield Line("sheath: thickness", 1e3 * band.thickness_mm, 100.0, 100 * within.INSTRUMENT_REL, "µm")
    yield Line("sheath: fades within a turn by", band.fades_db, float("nan"), float("nan"), "dB")
