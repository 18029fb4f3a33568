"""What recordings of a bore would show before it is drilled: its wall by the CT, with the errors of instruments."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.circle import gaussian, masked_gaussian
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import (
    ALIKE_BY_CELLS_MM,
    ALIKE_BY_DEPTH_MM,
    ALONG_BY_CELLS_MM,
    ALONG_BY_DEPTH_MM,
    BLUR_MM,
    COLUMNS,
    DRIVEN_STRETCH_MM,
    HIDDEN_MM,
    LAYERS_MM,
    LEAST_KNOWN,
    RIMS_BY_CELLS_MM,
    RIMS_BY_DEPTH_MM,
    ROWS_MM,
    STITCHED_STRETCH_MM,
    Layer,
    Observation,
)
from endoct.fusion.pose.wall import DEPTH, EDGE, OF_SIDE, RIMS, SHARED, TURN, Sense, prior_deviations, wall_places

ASIDE_MM, TILT_RAD, ALONG_MM = 1.0, float(np.radians(2.0)), 1.0
"""How far a bore misses its plan at most: at the entry, in direction, and along itself."""
STEP_MM = 0.05
"""Distance of the cylinders behind the wall, up to the one where light meets bone."""
STEEPNESS = 4.0
"""How much sharper the edges of a recording are than those of a clinical CT."""
STRETCH_MM, STRETCH_ASIDE_MM = 1.0, 0.06
"""Length of a stretch of bore, and how far it seems to lie aside after unrolling and segmentation. From 97 simulated
bores of the preset 'patient', seeds 2000 to 2099, and ten in real bone."""
MISSED, PATCH_MM = 0.17, 0.3
"""Share of the CT's air on the wall that recordings do not show, and σ of the field whose crests are such patches. The
share is that of twelve simulated bores of the preset 'patient', seeds 100 to 111, by OCT and endoscope alike."""


@dataclass(frozen=True)
class Instrument:
    """A kind of instrument, by what it gets wrong.

    It shows air at ``layers_mm`` behind the wall. The others are those of an
    :class:`~endoct.fusion.pose.observation.Observation`.
    """

    name: str
    layers_mm: tuple[float, ...]
    stretch_mm: float
    alike_mm: float
    along_mm: float
    rims_mm: float


WITH_DEPTH = Instrument("depth", LAYERS_MM, DRIVEN_STRETCH_MM, ALIKE_BY_DEPTH_MM, ALONG_BY_DEPTH_MM, RIMS_BY_DEPTH_MM)
"""An instrument like OCT."""
BY_CELLS = Instrument("cells", (0.0,), STITCHED_STRETCH_MM, ALIKE_BY_CELLS_MM, ALONG_BY_CELLS_MM, RIMS_BY_CELLS_MM)
"""An instrument like an endoscope."""


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """What an instrument would show of a bore, and the ``parameters`` (SHARED + OF_SIDE,) of where that lies."""

    shown: Observation
    parameters: torch.Tensor


def rehearse(
    air: AirAround, instrument: Instrument, radius_mm: float, seen_mm: float, generator: np.random.Generator
) -> Rehearsal:
    """Return what ``instrument`` would show of ``seen_mm`` of a bore that misses its plan by chance."""
    rows = np.arange(0, seen_mm + 1e-9, ROWS_MM)
    blank = np.zeros((rows.size, COLUMNS), np.float32)
    side = Observation(
        name=instrument.name,
        z_mm=rows,
        radius_mm=radius_mm,
        layers=tuple(Layer(behind, blank, blank) for behind in instrument.layers_mm),
        stretch_mm=instrument.stretch_mm,
        alike_mm=instrument.alike_mm,
        along_mm=instrument.along_mm,
        rims_mm=instrument.rims_mm,
        handed=True,
        directed=True,
    )
    parameters = _drawn(side, air.length_mm, generator)
    return Rehearsal(replace(side, layers=_layers(air, instrument, side, parameters, generator)), parameters)


def _drawn(side: Observation, length_mm: float, generator: np.random.Generator) -> torch.Tensor:
    """Return parameters drawn at random: the pose of a bore that misses its plan, and errors of a recording."""
    deviations = prior_deviations((side,)).numpy()
    drawn = generator.normal(size=SHARED + OF_SIDE) * deviations
    entry, tilt = ASIDE_MM * _within_circle(generator), TILT_RAD * _within_circle(generator)
    # x grows with a turn about y, y falls with one about x
    drawn[:2], drawn[2:SHARED] = entry + length_mm / 2 * np.array([tilt[1], -tilt[0]]), tilt
    first_mm = generator.uniform(0, max(length_mm - side.length_mm, 0.0)) + ALONG_MM * generator.uniform(-1, 1)
    drawn[SHARED + DEPTH], drawn[SHARED + TURN] = first_mm + side.length_mm / 2, generator.uniform(0, 2 * np.pi)
    return torch.as_tensor(drawn)


def _within_circle(generator: np.random.Generator) -> Coordinates:
    """Return a random point (2,) of the unit disc, each place equally likely."""
    angle = generator.uniform(0, 2 * np.pi)
    return np.asarray(np.sqrt(generator.random()) * np.array([np.cos(angle), np.sin(angle)]))


def _layers(
    air: AirAround, instrument: Instrument, side: Observation, parameters: torch.Tensor, generator: np.random.Generator
) -> tuple[Layer, ...]:
    """Return what is shown of the air: a place behind the wall is open where no bone lies before it."""
    column_mm = 2 * np.pi * side.radius_mm / COLUMNS
    shape = side.layers[0].air.shape
    edge_mm, rims_mm = float(parameters[SHARED + EDGE]), float(parameters[SHARED + RIMS])
    moved = torch.as_tensor(_aside(instrument, side, generator), dtype=torch.float64)[:, None]
    behind = STEP_MM * np.arange(1 + round(max(instrument.layers_mm) / STEP_MM))
    open_at = []
    for one in behind.tolist():
        places, _ = wall_places(side, Sense(), air.length_mm / 2, parameters, one)
        share, gradient = air.share_and_gradient(places + moved)
        outward = edge_mm * gradient.norm(dim=0) + rims_mm * gradient[2].abs()  # the bore runs nearly along z
        open_at.append((share + outward).cpu().numpy())
    sharp = np.clip(0.5 + STEEPNESS * (np.minimum.accumulate(open_at) - 0.5), 0, 1).astype(np.float32)
    sharp *= _kept(shape, column_mm, generator)
    sigmas = BLUR_MM / ROWS_MM, BLUR_MM / column_mm
    layers = []
    for one in instrument.layers_mm:
        before = round((one - HIDDEN_MM) / STEP_MM)
        open_before = np.ones(shape, np.bool_) if before < 0 else sharp[before] > 0.5
        known = gaussian(open_before.astype(np.float32), *sigmas)
        shown = np.clip(masked_gaussian(sharp[round(one / STEP_MM)], known > LEAST_KNOWN, *sigmas), 0, 1)
        layers.append(Layer(one, shown, known))
    return tuple(layers)


def _aside(instrument: Instrument, side: Observation, generator: np.random.Generator) -> Coordinates:
    """Return how far each row seems to lie off, (n_z, 3): across by stretches of the bore, along as a whole."""
    knots = np.arange(0, side.length_mm + STRETCH_MM, STRETCH_MM)
    across = STRETCH_ASIDE_MM * generator.normal(size=(2, knots.size))
    off = np.full((side.z_mm.size, 3), instrument.along_mm * generator.normal())
    for axis in range(2):
        off[:, axis] = np.interp(side.z_mm, knots, across[axis])
    return off


def _kept(shape: tuple[int, ...], column_mm: float, generator: np.random.Generator) -> Image:
    """Return 0 on patches of the wall whose air is not shown, else 1, (n_z, n_theta)."""
    noise = generator.normal(size=shape).astype(np.float32)
    field = gaussian(noise, PATCH_MM / ROWS_MM, PATCH_MM / column_mm)
    return (field < np.quantile(field, 1 - MISSED)).astype(np.float32)
