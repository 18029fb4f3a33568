"""The task "alignment": two panoramas of one bore as two instruments would show it, at any place on each other.

Both sides have 2048 × 1024 samples of one size, so that pixels mean the same along z and around. The scene is blobs,
cells without depth. It is a smooth function of the wall, which either side samples where it lies, so no image is ever
interpolated. Side B shows it through a gamma, with a light of its own, perhaps inverted, and under speckle. It is
turned, shifted and stretched, perhaps mirrored, perhaps recorded from its other end. No method is told any of that.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.files.json_values import number
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.comparison import place_sides
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.fusion.parameters import CompareParameters
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.cases.specimens import load_side
from endoct.workbench.bench.program import read_answer, write_answer, write_panoramas
from endoct.workbench.bench.task import Case, Declined, Exchange, Range, Task, draw, rng_of
from endoct.workbench.pipeline.truth import TrueMap, load_truth, true_pose

N_THETA, N_Z = 2048, 1024
RADIUS_MM = 1.25
PX_MM = 2 * np.pi * RADIUS_MM / N_THETA
BLOB_PX = (15.0, 70.0)
"""Radii of blobs, drawn evenly in their logarithm: 0.12 to 0.54 mm across."""
EDGE_PX = 2.0
"""A blob's edge is blurred over this distance."""
SPECKLE: Mapping[str, float] = {"low": 0.1, "middle": 0.3, "high": 0.6}
"""Contrast of the speckle, scatter over mean of the intensity, by what the condition "noise" says."""
SUCCESS_PX = 2.0

AlignmentCase = Case[tuple[Panorama, Panorama], Alignment | TrueMap]
RANGES: Mapping[str, Range] = {
    "theta_shift_rad": (0.0, 2 * np.pi),
    "overlap": (0.5, 1.0),
    "z_scale": (0.95, 1.05),
    "orientation": ("upright", "mirrored", "reversed", "turned"),
    "polarity": ("dark", "bright"),
    "noise": tuple(SPECKLE),
    "cell_area": (0.05, 0.40),
    "gamma": (0.5, 2.0),
}


@dataclass(frozen=True, eq=False)
class Blobs:
    """Ellipses on the cylinder: centres (px along z and around), radii (px), flatness and direction, all (n,)."""

    z_px: Coordinates
    theta_px: Coordinates
    radius_px: Coordinates
    flatness: Coordinates
    direction_rad: Coordinates

    def render(self, z_px: Coordinates, theta_px: Coordinates) -> Image:
        """Return how much cell is at every row × column, float32 in [0, 1]; ``theta_px`` is a circle of 2048."""
        scene = np.zeros((z_px.size, theta_px.size), np.float32)
        for z0, theta0, radius, flatness, direction in zip(
            self.z_px, self.theta_px, self.radius_px, self.flatness, self.direction_rad, strict=True
        ):
            reach = radius + 4 * EDGE_PX
            around = np.mod(theta_px - theta0 + N_THETA / 2, N_THETA) - N_THETA / 2
            rows, columns = np.flatnonzero(np.abs(z_px - z0) < reach), np.flatnonzero(np.abs(around) < reach)
            down, across = (z_px[rows] - z0)[:, np.newaxis], around[columns]
            along = down * np.cos(direction) + across * np.sin(direction)
            aside = across * np.cos(direction) - down * np.sin(direction)
            off = radius * (1 - np.hypot(along / radius, aside / (radius * flatness)))
            block = np.ix_(rows, columns)
            scene[block] = np.maximum(scene[block], 1 / (1 + np.exp(-off / (EDGE_PX / 2))))
        return scene


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> AlignmentCase:
    """Draw the two panoramas and where B lies on A."""
    drawn = draw(seed, index, {**RANGES, **ranges})
    number = {name: float(value) for name, value in drawn.items() if not isinstance(value, str)}
    mirrored, z_reversed = (drawn["orientation"] in (word, "turned") for word in ("mirrored", "reversed"))
    direction, sense = (-1.0 if z_reversed else 1.0), (-1.0 if mirrored else 1.0)
    scale = number["z_scale"]
    length_px = scale * (N_Z - 1)  # of B, in A's frame
    shared_px = number["overlap"] * min(length_px, N_Z - 1)
    random = rng_of(seed, index, "scene")
    low_px = N_Z - 1 - shared_px if random.random() < 0.5 else shared_px - length_px  # B's lower end in A's frame
    shift_px = low_px + (length_px if z_reversed else 0.0)
    truth = Alignment(number["theta_shift_rad"], shift_px * PX_MM, scale, mirrored, z_reversed)
    blobs = _blobs(random, number["cell_area"], min(0.0, low_px), max(N_Z - 1, low_px + length_px))
    own_px = np.arange(N_THETA, dtype=np.float64)
    theta_px = number["theta_shift_rad"] / (2 * np.pi) * N_THETA + sense * own_px
    z_px = shift_px + scale * direction * np.arange(N_Z, dtype=np.float64)
    contrast = SPECKLE[str(drawn["noise"])]
    a = _image(blobs.render(np.arange(N_Z, dtype=np.float64), own_px), random, 1.0, contrast / 3, inverted=False)
    b = _image(blobs.render(z_px, theta_px), random, number["gamma"], contrast, inverted=drawn["polarity"] == "bright")
    return Case(f"{seed}-{index}", (_panorama(a), _panorama(b)), truth, drawn)


def _blobs(random: np.random.Generator, area: float, low_px: float, high_px: float) -> Blobs:
    """Draw blobs between two places until they cover the share ``area`` of the wall, overlaps counted once."""
    low_px, high_px = low_px - BLOB_PX[1], high_px + BLOB_PX[1]
    wanted_px = -np.log1p(-area) * (high_px - low_px) * N_THETA  # what discs laid at random must sum to
    drawn: list[tuple[float, float]] = []
    while np.pi * sum(radius**2 * flatness for radius, flatness in drawn) < wanted_px:
        drawn.append((float(np.exp(random.uniform(*np.log(BLOB_PX)))), float(random.uniform(0.6, 1.0))))
    n = len(drawn)
    radius, flatness = np.array(drawn).T
    z_px, theta_px = random.uniform(low_px, high_px, n), random.uniform(0, N_THETA, n)
    return Blobs(z_px, theta_px, radius, flatness, random.uniform(0, np.pi, n))


def _image(scene: Image, random: np.random.Generator, gamma: float, contrast: float, *, inverted: bool) -> Image:
    """Return the scene as an instrument shows it: cells dark unless ``inverted``, under a light of its own."""
    theta_rad = 2 * np.pi / N_THETA * np.arange(N_THETA)
    light = 1 + 0.3 * np.cos(theta_rad - random.uniform(0, 2 * np.pi))
    wall = 0.2 + 0.7 * (scene if inverted else 1 - scene)
    looks = 1 / contrast**2  # averaged over so many looks, speckle is gamma distributed with mean 1
    speckle = random.standard_gamma(looks, scene.shape, dtype=np.float32) / np.float32(looks)
    return np.asarray(100 * wall ** np.float32(gamma) * light * speckle, dtype=np.float32)


def _panorama(image: Image) -> Panorama:
    grid = SurfaceGrid.full_circle(N_Z, N_THETA, z0_mm=0.0, dz_mm=PX_MM, radius_mm=RADIUS_MM)
    valid = np.ones(image.shape, np.bool_)
    return Panorama(grid, image, None, valid, valid.astype(np.float32), "blobs", False, False)


def own_cases(specimen: Path) -> list[AlignmentCase]:
    """Return a simulated specimen's endoscope (A) and OCT (B), unrolled by us, as a case.

    A panorama that is stored next to its recording, as ``oct.zarr``, is taken in place of unrolling it.

    Raises :class:`EndoctError` where there is no pair, or no truth that says where it lies.
    """
    truth = load_truth(specimen)
    recordings = [specimen / name for name in ("endoscope", "oct")]
    if not all(path.is_dir() for path in recordings):
        raise EndoctError(f"{specimen} holds no pair", expected="both oct/ and endoscope/ in it")
    a, b = (load_side(specimen, path.name) for path in recordings)
    true = TrueMap(a.z_mm, true_pose(a, truth), true_pose(b, truth))
    return [Case(specimen.name, (a, b), true, {"specimen": specimen.name})]


def judge(case: AlignmentCase, answer: Alignment | NotAligned) -> Mapping[str, float]:
    """Score an alignment by where it puts landmarks: 32 × 32 places of B's wall that A shows as well."""
    if isinstance(answer, NotAligned):
        raise Declined(answer.reason)
    a, b = case.given
    truth = case.truth
    px_mm = max(max(side.grid.dz_mm, side.grid.dtheta_mm) for side in (a, b))
    z_mm = np.linspace(b.z_mm[0], b.z_mm[-1], 512)
    z_true_mm = truth.z_to_a(z_mm)
    shared_mm = z_mm[(z_true_mm >= a.z_mm[0]) & (z_true_mm <= a.z_mm[-1])]
    shared_mm = shared_mm[np.linspace(0, shared_mm.size - 1, 32).astype(int)]
    theta_rad = 2 * np.pi / 32 * np.arange(32)
    off_z_mm = answer.z_to_a(shared_mm) - truth.z_to_a(shared_mm)
    turned_rad = answer.theta_to_a(theta_rad, shared_mm[:, np.newaxis])
    off_theta_mm = a.grid.radius_mm * wrap_rad(turned_rad - truth.theta_to_a(theta_rad))
    error_mm = float(np.hypot(off_z_mm[:, np.newaxis], off_theta_mm).mean())
    return {
        "landmark_px": error_mm / px_mm,
        "landmark_mm": error_mm,
        "success": float(error_mm / px_mm < SUCCESS_PX),
    }


def _write_alignment(answer: Alignment | NotAligned, folder: Path) -> None:
    names = "theta_shift_rad", "z_shift_mm", "z_scale", "mirrored", "z_reversed"
    if isinstance(answer, NotAligned):
        write_answer(folder, {"declined": answer.reason})
    else:
        write_answer(folder, {name: getattr(answer, name) for name in names})


def _read_alignment(_given: tuple[Panorama, Panorama], folder: Path) -> Alignment:
    answer, names = read_answer(folder), ("theta_shift_rad", "z_shift_mm", "z_scale")
    theta_rad, z_mm, scale = (number(answer, name, -1e4, 1e4, "the answer") for name in names)
    return Alignment(theta_rad, z_mm, scale, answer.get("mirrored") is True, answer.get("z_reversed") is True)


TASK = Task(
    name="alignment",
    title="two panoramas of one bore, 2048 × 1024, at any place on each other",
    signature=(
        "method(a: Panorama, b: Panorama) -> Alignment | NotAligned\n"
        "Says where B lies in A's frame (endoct.fusion.geometry.alignment). All four orientations are open unless "
        "handedness_known and travel_known of the panoramas say otherwise; cells may be dark or bright to either; θ is "
        "a circle."
    ),
    cases=cases,
    judge=judge,
    ranges=RANGES,
    scores={
        "landmark_px": "mean landmark error, px (the larger step of the coarser side; 3.8 µm of toy pairs)",
        "landmark_mm": "mean landmark error, mm",
    },
    own=own_cases,
    exchange=Exchange(
        write=lambda given, folder: write_panoramas(dict(zip("ab", given, strict=True)), folder),
        read=_read_alignment,
        answer=_write_alignment,
    ),
    success=f"a mean landmark error of less than {SUCCESS_PX:g} px, the larger step of the coarser side",
)


def ours(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """Align as a comparison does: by the evidence of both, and by the cells that a learned eye sees."""
    outcome = place_sides(*two_sides(a, b), CompareParameters()).outcome
    return outcome.alignment or NotAligned(outcome.reason, outcome.best)
