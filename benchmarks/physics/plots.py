"""One function a figure: it measures, draws, and returns what it measured next to what theory or truth says."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import erf

from benchmarks.physics import bscans, mirror
from benchmarks.physics import recordings as real
from benchmarks.physics.drawing import Curve, Panel, save_panels
from benchmarks.physics.estimates import PAINTED, TURNING, Z_SHIFTS_MM, frames, slices, specimen
from benchmarks.physics.inside import inside
from endoct.base.arrays import Coordinates
from tests import tolerances as within


@dataclass(frozen=True)
class Line:
    """A line of the table: what, measured, expected (NaN: nothing), how far apart they may be, and the unit."""

    name: str
    measured: float
    expected: float
    tolerance: float
    unit: str = ""

    @property
    def holds(self) -> bool:
        """Whether it is within its tolerance; so is what nothing is expected of."""
        return not abs(self.measured - self.expected) > self.tolerance


def speckle(folder: Path) -> Iterator[Line]:
    """Histograms of the logarithm of bone and of noise."""
    bone, noise, bone_db, noise_db = bscans.bone_and_noise()
    edges = np.arange(-22.0, 9.01, 1.0)
    middle = (edges[:-1] + edges[1:]) / 2
    curves = []
    for name, level in (("bone", bone_db), ("noise", noise_db)):
        # whole counts do not fill bins of 1 dB evenly
        spread = level + 0.3 * np.random.default_rng(0).uniform(-0.5, 0.5, level.shape)
        density = np.histogram(spread, edges)[0] / level.size
        centred = edges - bscans.RAYLEIGH_BIAS_DB  # of the mean logarithm
        curves.append(Curve(middle, density, np.diff(-np.exp(-(10 ** (centred / 10)))), name))
    panel = Panel("Logarithm of speckle", "level over its mean (dB)", "share per dB", "rest", curves, log=True)
    save_panels(folder / "speckle.png", [panel])
    for name, of in (("bone", bone), ("noise", noise)):
        yield Line(f"speckle contrast, {name}", of.contrast, 1.0, within.SPECKLE_CONTRAST)
        yield Line(f"σ of the logarithm, {name}", of.sigma_db, bscans.RAYLEIGH_DB, within.SPECKLE_SIGMA_DB, "dB")
        yield Line(f"skew of the logarithm, {name}", of.skew, bscans.RAYLEIGH_SKEW, within.SPECKLE_SKEW)


def grain(folder: Path) -> Iterator[Line]:
    """How intensities correlate, in depth and along the wall."""
    deep_mm, deep, along_mm, along = bscans.grain()
    lateral = bscans.plain().oct.lateral_resolution_mm
    panels = []
    for title, lag, value, width in (("in depth", deep_mm, deep, 0.012), ("along the wall", along_mm, along, lateral)):
        found, expected = bscans.gaussian_fwhm(lag, value), np.sqrt(2) * width
        theory = np.exp(-4 * np.log(2) * (lag / expected) ** 2)
        label = "lag (µm)"
        panels.append(
            Panel(f"Grain of speckle {title}", label, "correlation", "rest", [Curve(1e3 * lag, value, theory)])
        )
        yield Line(
            f"grain of speckle {title}", 1e3 * found, 1e3 * expected, 1e3 * expected * within.POINT_SPREAD_REL, "µm"
        )
    save_panels(folder / "grain.png", panels)


def roll_off(folder: Path) -> Iterator[Line]:
    """The level of one reflector over depth."""
    rows = np.arange(20, 505, 20.0)
    curves = []
    for loss in (6.0, 10.0):
        found, theory = bscans.roll_off_curve(rows, loss)
        curves.append(Curve(rows, found, theory, f"{loss:g} dB at full depth"))
        worst = float(np.abs(found - theory).max())
        yield Line(f"roll-off, {loss:g} dB, largest departure", worst, 0.0, within.ROLL_OFF_DB, "dB")
    panel = Panel("Sensitivity: sinc² × Gauss", "depth (rows of 512)", "level (dB)", "rest (dB)", curves)
    save_panels(folder / "roll_off.png", [panel])


def point_spread(folder: Path) -> Iterator[Line]:
    """A face's line in depth, and an edge of bone along the wall."""
    curves = []
    for drawn in (0.0085, 0.012):
        place, value, found = bscans.axial_spread(drawn)
        near = np.abs(place) < 1.2 * drawn
        theory = np.exp(-4 * np.log(2) * (place / drawn) ** 2)
        curves.append(Curve(1e3 * place[near], value[near], theory[near], f"{1e3 * drawn:g} µm drawn"))
        yield Line("axial width (FWHM)", 1e3 * found, 1e3 * drawn, 1e3 * drawn * within.POINT_SPREAD_REL, "µm")
    place, value, found, drawn = bscans.knife_edge()
    yield Line("lateral width (FWHM)", 1e3 * found, 1e3 * drawn, 1e3 * drawn * within.POINT_SPREAD_REL, "µm")
    sigma = drawn / np.sqrt(8 * np.log(2))
    theory = 0.5 * (1 + erf(place / (np.sqrt(2) * sigma)))
    panels = [
        Panel("Point spread in depth", "place (µm of air)", "intensity", "rest", curves),
        Panel(
            f"Edge, {1e3 * drawn:.1f} µm drawn",
            "place along the wall (µm)",
            "intensity",
            "rest",
            [Curve(1e3 * place, value, theory)],
        ),
    ]
    save_panels(folder / "point_spread.png", panels)


def attenuation(folder: Path) -> Iterator[Line]:
    """The level of bone over depth."""
    curves = []
    for length in (0.1, 0.2):
        depth, found, theory = bscans.attenuation(length)
        curves.append(Curve(1e3 * depth, found, theory, f"1/e in {1e3 * length:g} µm"))
        slope = float(np.polyfit(depth, found - theory, 1)[0]) - 10 * np.log10(np.e) / length
        expected = -10 * float(np.log10(np.e)) / length
        yield Line(f"attenuation, 1/e in {length:g} mm", slope, expected, 0.05 * abs(expected), "dB/mm")
    panel = Panel("Attenuation, with the roll-off", "depth in bone (µm)", "level (dB)", "rest (dB)", curves)
    save_panels(folder / "attenuation.png", [panel])


def density(_folder: Path) -> Iterator[Line]:
    """How dense bone is inside, in a CT and in B-scans of one bore."""
    for scale in (0.6, 0.9):
        found, what = inside(scale), f"density over {scale:g} mm"
        yield Line(f"{what}, OCT against CT, slope", found.slope, 1.0, within.DENSITY_SLOPE)
        yield Line(f"{what}, correlation of both", found.correlation, math.nan, math.nan)
        tolerance = within.DENSITY_LENGTH_REL * found.expected_mm
        yield Line(f"{what}, its length in the CT", found.length_mm, found.expected_mm, tolerance, "mm")


def cone(folder: Path) -> Iterator[Line]:
    """z(r), and how far the centres of rings of one z drift."""
    along, rings = [], []
    for angle in (42.0, 45.0, 48.0):
        r, z, expected = mirror.z_of_r(angle)
        along.append(Curve(r[::12], z[::12], expected[::12], f"{angle:g}°"))
        worst = 1e3 * float(np.abs(z - expected).max())
        yield Line(f"z(r), {angle:g}°, largest departure", worst, 0.0, 1e3 * within.RAY_MM, "µm")
        r, drift, expected = mirror.ring_centres(angle)
        rings.append(Curve(r, 1e3 * drift, 1e3 * expected, f"{angle:g}°"))
        worst = 1e3 * float(np.abs(drift - expected).max())
        yield Line(f"ring centres, {angle:g}°, largest departure", worst, 0.0, 1e3 * within.RAY_MM, "µm")
    panels = [
        Panel("Where pixels look", "radius in the image (px)", "z from the apex (mm)", "rest (nm)", along, 1e6),
        Panel(
            "Centres of rings, e 20 µm, τ 4 mrad",
            "radius in the image (px)",
            "centre's drift (µm)",
            "rest (nm)",
            rings,
            1e3,
        ),
    ]
    save_panels(folder / "cone.png", panels)


def light(folder: Path) -> Iterator[Line]:
    """Light along the bore and around it."""
    curves = []
    for angle in (42.0, 45.0, 48.0):
        z, found, expected = mirror.light_along(angle)
        curves.append(Curve(z, found, expected, f"{angle:g}°"))
        yield Line(
            f"light along the bore, {angle:g}°, largest departure",
            float(np.abs(found / expected - 1).max()),
            0.0,
            within.LIGHT_OF_FRAME_REL,
        )
    theta, found, expected = mirror.light_around()
    yield Line(
        "light around a probe 0.15 mm off, largest departure",
        float(np.abs(found / expected - 1).max()),
        0.0,
        within.LIGHT_OF_FRAME_REL,
    )
    panels = [
        Panel("Light along the bore", "z from the apex (mm)", "light (1 in the middle)", "rest", curves),
        Panel(
            "Light around a probe 0.15 mm off",
            "θ (°)",
            "light (mean 1)",
            "rest",
            [Curve(np.rad2deg(theta), found, expected)],
        ),
    ]
    save_panels(folder / "light.png", panels)


def motion_of_oct(folder: Path, seed: int = 1000) -> Iterator[Line]:
    """What an independent estimator finds of the catheter's offset and rotation."""
    found = slices(*specimen("learning", seed, TURNING), range(0, 16, 3))
    offset = np.array([one.offset_mm for one in found])
    true = np.array([one.true_offset_mm for one in found])
    here = np.rad2deg(np.concatenate([one.error_rad[one.tells] for one in found]))
    there = np.rad2deg(np.concatenate([one.true_error_rad[one.tells] for one in found]))
    panels = [
        _panel_of(
            "Catheter's offset, x and y", "µm", 1e3 * np.r_[offset.real, offset.imag], 1e3 * np.r_[true.real, true.imag]
        ),
        _panel_of("Error of rotation", "°", here[::4], there[::4]),
    ]
    save_panels(folder / "motion_oct.png", panels)
    worst = 1e3 * float(np.abs(offset - true).max())
    yield Line("catheter's offset, largest error", worst, 0.0, 1e3 * within.FOUND_OFFSET_MM, "µm")
    rows = float(np.mean([one.wall_px for one in found]))
    yield Line("wall's row, mean error", rows, 0.0, within.FOUND_WALL_PX, "px")
    places = [1e3 * abs(float(Z_SHIFTS_MM[one.at_z.argmax()])) for one in found]
    yield Line("slices on the true wall, largest error of z", max(places), 0.0, 1e3 * within.FOUND_PLACE_MM, "µm")
    error = float(np.median(np.abs(here - there)))
    yield Line("rotation, median error", error, 0.0, float(np.rad2deg(within.FOUND_TURNING_RAD)), "°")
    yield Line("rotation, correlation with the truth", float(np.corrcoef(here, there)[0, 1]), 1.0, 0.1)


def motion_of_endoscope(folder: Path, seed: int = 1000) -> Iterator[Line]:
    """What an independent estimator finds of feed and roll, on cells and on paint."""
    feed, roll = [], []
    for name, ranges, mm, rad in (
        ("cells", TURNING, within.FOUND_FEED_MM, within.FOUND_ROLL_RAD),
        ("paint", PAINTED, within.FOUND_PAINT_MM, within.FOUND_PAINT_RAD),
    ):
        run = frames(*specimen("learning", seed, ranges), range(16))
        feed.append(Curve(1e3 * run.true_feed_mm, 1e3 * run.feed_mm, 1e3 * run.true_feed_mm, name))
        true_roll = np.rad2deg(run.true_roll_rad)
        roll.append(Curve(true_roll, np.rad2deg(run.roll_rad), true_roll, name))
        off_mm, off_rad = run.feed_mm - run.true_feed_mm, run.roll_rad - run.true_roll_rad
        yield Line(f"feed on {name}, mean error", 1e3 * float(np.mean(off_mm)), 0.0, 1e3 * mm, "µm")
        yield Line(f"feed on {name}, rms error", 1e3 * _rms(off_mm), 0.0, 1e3 * mm, "µm")
        yield Line(f"roll on {name}, mean error", float(np.rad2deg(np.mean(off_rad))), 0.0, float(np.rad2deg(rad)), "°")
        yield Line(f"roll on {name}, rms error", float(np.rad2deg(_rms(off_rad))), 0.0, float(np.rad2deg(rad)), "°")
        place_mm, place_rad = (within.FOUND_PLACE_MM, within.FOUND_ROLL_ON_WALL_RAD) if name == "cells" else (mm, rad)
        z_um, turned = 1e3 * float(np.mean(run.z_error_mm)), float(np.rad2deg(np.mean(run.roll_error_rad)))
        yield Line(f"frames on true {name}, mean error of z", z_um, 0.0, 1e3 * place_mm, "µm")
        yield Line(f"frames on true {name}, mean error of roll", turned, 0.0, float(np.rad2deg(place_rad)), "°")
    panels = [
        Panel("Feed between frames", "true (µm)", "found (µm)", "rest (µm)", feed),
        Panel("Roll between frames", "true (°)", "found (°)", "rest (°)", roll),
    ]
    save_panels(folder / "motion_endoscope.png", panels)


def _panel_of(name: str, unit: str, measured: Coordinates, expected: Coordinates) -> Panel:
    return Panel(name, f"true ({unit})", f"found ({unit})", f"rest ({unit})", [Curve(expected, measured, expected)])


def _rms(values: Coordinates) -> float:
    return float(np.sqrt(np.mean(values**2)))


def real_speckle(folder: Path, recordings: Path) -> Iterator[Line]:
    """Skew of the logarithm in real files, and of the cut log-Rayleigh with the same level."""
    regions, db_per_count = real.swept_source(recordings / "axsun-oct")
    mean = np.array([region.mean for region in regions])
    skew, model = np.array([region.skew for region in regions]), np.array([region.model_skew for region in regions])
    panel = Panel(
        "Real files: skew", "mean of the region (counts)", "skew of counts", "rest", [Curve(mean, skew, model)]
    )
    save_panels(folder / "real_speckle.png", [panel])
    for region in regions:
        yield Line(
            f"real: {region.name}: skew (contrast {region.contrast:.2f})",
            region.skew,
            region.model_skew,
            within.REAL_SKEW,
        )
    yield Line("real: a count of axsun-oct", db_per_count, np.nan, np.nan, "dB")
    mean_counts, sigma, of_coronary = real.coronary(recordings / "coronary-oct")
    yield Line(
        f"real: coronary tissue, skew (mean {mean_counts:.0f}, σ {sigma:.0f} counts)", of_coronary, np.nan, np.nan
    )
