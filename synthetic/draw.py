"""Draws the parameters of a specimen. Nothing random happens elsewhere but noise and texture."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.random import Generator

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.drawn_cells import draw_cells
from endoct.synthetic.endoscope.cone import fitting_annulus
from endoct.synthetic.sample.oct_parameters import N_BANDS
from endoct.synthetic.sample.parameter_fields import Stated
from endoct.synthetic.sample.parameters import (
    Bore,
    Ct,
    Debris,
    Density,
    Droplet,
    Endoscope,
    Harmonic,
    LostAscans,
    Network,
    Oct,
    Sample,
    Shadow,
    SheathLine,
    Speck,
    Travel,
    Tube,
    Volume,
)
from endoct.synthetic.sample.presets import PRESETS, Bone, Preset, PresetName
from endoct.synthetic.sample.randomness import Stage, drift, generator
from endoct.synthetic.sample.ranges import NO_RANGES, Drawer, Range, check_ranges, default_ranges

MARGIN_MM = 0.9
LEAST_OFFSET_MM = 0.06
# These are generators of the bore's own: what a phantom draws does not depend on them.
NETWORK_STREAM, CT_STREAM, DENSITY_STREAM, TUBE_STREAM = 2, 4, 7, 8
CONE_BEAM_RANGES: Mapping[str, Range] = {
    "ct.voxel_mm": (0.125, 0.2),
    "ct.psf_mm": (0.25, 0.4),
    "ct.noise_hu": (80.0, 200.0),
}
ROOM_MM = 0.5  # A bore is longer by this than a recording of nominal length, whose steps vary.
MOST_LENGTH_MM = 99.0
TURN_SAMPLES = 360  # The course of the catheter's turn is worked out at so many places.
STICK_ORDERS = 24  # A turn that sticks and slips has so many harmonics.
SLIP_RAD = 0.1  # A catheter that stuck catches up over this.


@dataclass(frozen=True)
class Scans:
    """Which CTs of a specimen's bone there are: before drilling, with slices of a thickness of their own, and after."""

    ct: bool = False
    ct_slice_mm: float | None = None
    cone_beam: bool = False


NO_SCANS = Scans()


def draw(
    preset: PresetName,
    seed: int,
    *,
    bore_seed: int | None = None,
    ranges: Mapping[str, Range] = NO_RANGES,
    volume: Volume | None = None,
    scans: Scans = NO_SCANS,
) -> Sample:
    """Return the sample of ``seed``, drilled into ``volume`` where one is given, with what CTs ``scans`` says.

    The bore depends on ``bore_seed`` alone (by default on ``seed``), so that several specimens can be recordings
    of one bore. ``ranges``, "part.name" → (low, high) or words, replace what the preset draws from. Raises
    :class:`EndoctError` where one names no parameter or goes beyond what it may be.
    """
    check_ranges(ranges)
    size = PRESETS[preset]
    ranges = {**size.ranges, **ranges}
    bore_seed = seed if bore_seed is None else bore_seed
    bore = _bore(
        Drawer(generator(bore_seed, Stage.BORE), ranges),
        Drawer(generator(bore_seed, Stage.BORE, NETWORK_STREAM), ranges),
        Drawer(generator(bore_seed, Stage.BORE, DENSITY_STREAM), ranges),
        Drawer(generator(bore_seed, Stage.BORE, TUBE_STREAM), ranges),
        size,
        volume,
    )
    drawer = Drawer(generator(seed, Stage.DRAW), ranges)
    visible_mm = drawer.number(Endoscope, "visible_length_mm")
    oct_, camera = drawer.numbers(Oct), drawer.numbers(Endoscope) | {"visible_length_mm": visible_mm}
    oct_z, frame_z = _positions(drawer.rng, size, bore.length_mm, oct_, camera)
    if (scans.ct or scans.cone_beam) and bore.bone not in ("network", "volume"):
        raise EndoctError(
            "there is a CT of bone in three dimensions only",
            found=f"bone '{bore.bone}'",
            remedy="simulate with --preset mastoid, or with --bone",
        )
    return Sample(
        ct=_ct(bore_seed, ranges, CT_STREAM).model_copy(update={"slice_mm": scans.ct_slice_mm}) if scans.ct else None,
        cone_beam=_ct(bore_seed, CONE_BEAM_RANGES, CT_STREAM + 1) if scans.cone_beam else None,
        preset=preset,
        seed=seed,
        bore_seed=bore_seed,
        bore=bore,
        oct=_oct(drawer, size, oct_, oct_z, bore.length_mm),
        endoscope=_endoscope(drawer, size, camera, frame_z, bore),
    )


def _listed(values: Coordinates) -> tuple[float, ...]:
    return tuple(values.tolist())


def _pairs(values: Coordinates) -> tuple[tuple[float, float], ...]:
    return tuple((float(first), float(second)) for first, second in values)


def _bore(
    drawer: Drawer, of_network: Drawer, of_density: Drawer, of_tube: Drawer, size: Preset, volume: Volume | None
) -> Bore:
    drawn = drawer.numbers(Bore)
    recorded_mm = size.pitch_mm * max(size.n_slices, size.n_frames)
    # room for two recordings that share no more than they must, with a visible band of up to 1.1 mm
    length_mm = 2 * MARGIN_MM + (2 - size.shared) * recorded_mm + 1.1 + drawer.rng.uniform(0, 0.5)
    drawn["diameter_mm"] = round(drawn["diameter_mm"], 2)
    if volume is not None:
        length_mm = _length_mm(volume, recorded_mm)
        known = {"bone": "volume", "length_mm": length_mm, "volume": volume}
        return Bore.model_validate({**drawn, **known, "density": Density(**of_density.numbers(Density))})
    bone = cast(Bone, drawer.word("bore.bone", dict.fromkeys(size.bone, 1.0)))
    network = _network(of_network) if bone == "network" else None
    density = Density(**of_density.numbers(Density)) if bone == "network" else None
    tube = _tube(of_tube) if bone == "tube" else None
    known = {"bone": bone, "length_mm": length_mm, "network": network, "density": density, "tube": tube}
    bore = Bore.model_validate({**drawn, **known})
    return bore.model_copy(update={"cells": draw_cells(drawer.rng, bore)})


def _ct(bore_seed: int, ranges: Mapping[str, Range], stream: int) -> Ct:
    return Ct(**Drawer(generator(bore_seed, Stage.BORE, stream), ranges).numbers(Ct))


def _network(drawer: Drawer) -> Network:
    """Draw a mastoid, and how the bore lies in the patient: inward, to the front, and about level."""
    side = 1.0 if drawer.rng.random() < 0.5 else -1.0  # to the left of the patient, or to the right
    entry = side * drawer.rng.uniform(45, 60), drawer.rng.uniform(0, 25), drawer.rng.uniform(-10, 25)
    inward = np.array([-side, -drawer.rng.uniform(0.3, 0.8), drawer.rng.uniform(-0.3, 0.3)])
    x, y, z = (float(value) for value in inward / np.linalg.norm(inward))
    drawn = drawer.numbers(Network)
    return Network(**drawn, entry_mm=entry, inward=(x, y, z))


def _tube(drawer: Drawer) -> Tube:
    """Draw a printed tube, and by how much it differs from what is stated of it."""
    errors = dict(
        zip(("bore", "depth", "z", "capillary"), np.clip(drawer.rng.normal(size=4), -3, 3).tolist(), strict=True)
    )
    return Tube(**drawer.numbers(Tube), **{f"{name}_error": value for name, value in errors.items()})


def _length_mm(volume: Volume, recorded_mm: float) -> float:
    """Return the length of the bore through a volume; both recordings have to lie within it."""
    length, least = volume.length_mm, recorded_mm + 2 * MARGIN_MM + ROOM_MM
    if not least <= length < MOST_LENGTH_MM:
        raise EndoctError(
            "entry and target do not lie as far apart as the recordings are long",
            found=f"{length:.1f} mm",
            expected=f"{least:.1f} to {MOST_LENGTH_MM:g} mm",
            remedy="move entry or target along the trajectory, or choose another preset",
        )
    return length


def _positions(
    rng: Generator, size: Preset, length_mm: float, oct_: Mapping[str, float], camera: Mapping[str, float]
) -> tuple[Coordinates, Coordinates]:
    """Return z of slices and of frames, ascending; ``size.shared`` of the shorter recording or more is in both."""
    oct_z = size.pitch_mm * np.arange(size.n_slices) + oct_["pullback_jitter_mm"] * rng.normal(size=size.n_slices)
    oct_z = np.sort(oct_z - oct_z.min())
    feed = size.pitch_mm * (1 + camera["feed_jitter"] * np.clip(rng.normal(size=size.n_frames - 1), -2.5, 2.5))
    feed *= 1 + (rng.random(size.n_frames - 1) < camera["dropped"])
    frame_z = np.concatenate([[0.0], np.cumsum(feed)])
    visible_mm, room_mm = camera["visible_length_mm"], length_mm - 2 * MARGIN_MM
    oct_span = float(oct_z[-1]) + size.pitch_mm  # a helical pullback goes on to the end of its last turn
    frame_span = min(float(frame_z[-1]) + visible_mm, room_mm)
    frame_z *= min(1.0, (frame_span - visible_mm) / float(frame_z[-1]))
    least = max(size.shared * min(oct_span, frame_span), oct_span + frame_span - room_mm)
    shared = rng.uniform(least, min(oct_span, frame_span))
    start = oct_span - shared if rng.random() < 0.5 else shared - frame_span
    mouth = min(0.0, start) - MARGIN_MM - rng.uniform(0, 1) * (room_mm - (oct_span + frame_span - shared))
    return oct_z - mouth, frame_z + start + visible_mm / 2 - mouth


def _oct(drawer: Drawer, size: Preset, drawn: dict[str, float], z_mm: Coordinates, length_mm: float) -> Oct:
    n = size.n_slices
    # a stream for each purpose, so that none depends on how much another takes
    layers, wander, dirt, words, starts, turns, turning, losses, floor = drawer.rng.spawn(9)
    sheath = _sheath(Drawer(layers, drawer.ranges), drawn)

    # the catheter leaves room for the capillary's wall, and that wall takes what room there is
    room = drawn["capillary_outer_diameter_mm"] / 2 - sheath[-1].radius_mm
    thin, thick = default_ranges(Oct)["glass_mm"]
    middle = min(drawn["offset_mean_mm"], room - thin - drawn["offset_drift_mm"])
    low = min(LEAST_OFFSET_MM, middle)
    offset = np.clip(middle + drawn["offset_drift_mm"] * drift(wander, n), low, room - thin)
    drawn["glass_mm"] = float(np.clip(drawn["glass_mm"], thin, np.clip(room - offset.max(), thin, thick)))
    direction = wander.uniform(0, 2 * np.pi) + wander.uniform(0.2, 1.2) * drift(wander, n)

    said = Drawer(words, drawer.ranges)
    travel: Travel = "out" if said.word("oct.travel", {"out": 0.75, "in": 0.25}) == "out" else "in"
    forward = 1 if travel == "in" else -1
    scan = said.word("oct.scan", {"step": 1 - size.helical, "helical": size.helical})
    advance = forward * size.pitch_mm if scan == "helical" else 0.0
    start = said.word("oct.start", {"triggered": 1.0, "free": 0.0})
    jitter = drawn["start_jitter_rad"] * starts.normal(size=n)
    specks = Drawer(dirt, drawer.ranges)
    shadows = (specks.numbers(Shadow) for _ in range(dirt.poisson(0.5 * length_mm)))
    return Oct(
        **drawn,
        floor_bands=_listed(floor.choice([-1, 1], N_BANDS) * floor.uniform(0.4, 1, N_BANDS)),
        sheath=sheath,
        shadows=tuple(Shadow(**s, z_mm=float(dirt.uniform(0, length_mm))) for s in shadows),
        n_glints=int(losses.poisson(6 * length_mm)),
        scan="helical" if scan == "helical" else "step",
        start="free" if start == "free" else "triggered",
        travel=travel,
        sense=1 if words.random() < 0.5 else -1,
        z_mm=_listed(z_mm[::forward] - min(0.0, advance)),
        z_advance_mm=advance,
        offset_mm=_listed(offset),
        offset_direction_rad=_listed(np.mod(direction, 2 * np.pi)),
        start_angle_rad=_listed(starts.uniform(0, 2 * np.pi, n) if start == "free" else jitter),
        turn_length=_listed(1 + drawn["turn_jitter"] * turns.normal(size=n)),
        rotation_error_rad=rotation_error(turning, n, drawn["rotation_error_peak_rad"], drawn["stick_slip"]),
        lost_ascans=lost_ascans(losses, size, drawn["lost_blocks"]),
        states_first_sample=said.yes("oct.states_first_sample", 0.2),
        stated_travel=_stated(said, "oct.stated_travel", travel),
        states_handedness=said.yes("oct.states_handedness", 0.5),
    )


def _sheath(drawer: Drawer, drawn: Mapping[str, float]) -> tuple[SheathLine, ...]:
    rng = drawer.rng
    radii = np.array([0.12, 0.29, 0.355, 0.42]) + rng.uniform(-0.02, 0.02, 4)
    return tuple(
        SheathLine(
            radius_mm=float(radius),
            wobble_mm=float(rng.uniform(3, 5)) * drawn["axial_pixel_mm"],
            phase_rad=float(rng.uniform(0, 2 * np.pi)),
            level_db=(level_db := drawn["sheath_db"] + float(rng.uniform(-4, 4))),
            thickness_mm=drawer.number(SheathLine, "thickness_mm"),
            band_db=level_db + drawn["sheath_band_db"],
        )
        for radius in radii[int(rng.random() < 0.5) :]
    )


def _endoscope(drawer: Drawer, size: Preset, drawn: dict[str, float], z_mm: Coordinates, bore: Bore) -> Endoscope:
    n, rng = z_mm.size, drawer.rng
    width, height = size.image_px[int(rng.integers(len(size.image_px)))]
    outer = drawn["outer_share"] * height
    inner, focal = fitting_annulus(drawn, drawn["inner_share"], outer, bore.diameter_mm / 2)
    wander = drawn["centre_wander_px"] * np.stack([drift(rng, n), drift(rng, n)], axis=1)
    centre = np.array([width / 2, height / 2]) + rng.uniform(-0.015, 0.015, 2) * height + wander
    centre += drawn["centre_jitter_px"] * rng.normal(size=(n, 2))
    roll = rng.uniform(0, 2 * np.pi) + drawn["roll_wander_rad"] * drift(rng, n)
    roll += drawn["roll_jitter_rad"] * rng.normal(size=n)
    probe = drawn["probe_drift_mm"] * np.stack([drift(rng, n), drift(rng, n)], axis=1)
    aside = rng.uniform(0, 2 * np.pi)
    probe += drawn["probe_offset_mm"] * np.array([math.cos(aside), math.sin(aside)])
    travel: Travel = "in" if drawer.word("endoscope.travel", {"in": 0.75, "out": 0.25}) == "in" else "out"
    scale = height / 480  # the drawn sizes of dirt are those of an image of 480 rows

    def on_optics() -> dict[str, float]:
        r, angle = rng.uniform(inner, outer), rng.uniform(0, 2 * np.pi)
        return {"x_px": float(r * np.cos(angle)), "y_px": float(r * np.sin(angle))}

    dirt = tuple(Speck(**_scaled(drawer.numbers(Speck), scale), **on_optics()) for _ in range(int(rng.integers(8, 26))))
    droplets = tuple(
        Droplet(**_scaled(drawer.numbers(Droplet), scale), **on_optics()) for _ in range(int(rng.integers(0, 4)))
    )
    crumbs = (drawer.numbers(Debris) for _ in range(rng.poisson(bore.length_mm)))
    return Endoscope(
        **drawn,
        width_px=width,
        height_px=height,
        colour=drawer.yes("endoscope.colour", 0.65),
        focal_px=focal,
        inner_px=inner,
        outer_px=outer,
        inner_shift_px=(float(rng.normal() * 0.008 * outer), float(rng.normal() * 0.008 * outer)),
        focus_at_outer=drawer.yes("endoscope.focus_at_outer", 0.5),
        ring_px=float(rng.uniform(inner + 0.08 * (outer - inner), outer - 0.08 * (outer - inner))),
        dirt=dirt,
        droplets=droplets,
        debris=tuple(Debris(**crumb, z_mm=float(rng.uniform(0, bore.length_mm))) for crumb in crumbs),
        storage="video" if drawer.word("endoscope.storage", {"png": 1.0, "video": 0.0}) == "video" else "png",
        travel=travel,
        z_mm=_listed(z_mm[:: 1 if travel == "in" else -1]),
        roll_rad=_listed(np.mod(roll, 2 * np.pi)),
        centre_px=_pairs(centre),
        offset_mm=_pairs(probe),
        states_optics=drawer.yes("endoscope.states_optics", 0.5),
        states_annulus=drawer.yes("endoscope.states_annulus", 0.25),
        stated_travel=_stated(drawer, "endoscope.stated_travel", travel),
    )


def _stated(drawer: Drawer, path: str, travel: Travel) -> Stated:
    """Return what the operator says of the travel: mostly what it was, unless the user varies it."""
    word = drawer.word(path, {travel: 0.7, "unknown": 0.3})
    return "in" if word == "in" else "out" if word == "out" else "unknown"


def _scaled(sizes: dict[str, float], scale: float) -> dict[str, float]:
    return {name: value * scale if name.endswith("_px") else value for name, value in sizes.items()}


def rotation_error(rng: Generator, n: int, peak_rad: float, stick_slip: float) -> tuple[tuple[Harmonic, ...], ...]:
    """Return the harmonics of every slice's error: the pattern of a bent, rubbing catheter changes slowly.

    The first few bend it; those of a share ``stick_slip`` of the peak let it stick and slip.
    """
    orders = np.arange(1, 5)
    pattern = rng.normal(size=(orders.size, 2))
    courses = np.stack([drift(rng, n) for _ in range(2 * orders.size)], axis=1).reshape(n, orders.size, 2)
    bending = (pattern + 0.35 * courses + 0.06 * rng.normal(size=courses.shape)) / orders[:, None]
    sticking = _stick_slip(rng, n)
    error = (1 - stick_slip) * np.pad(bending / _peak(bending), ((0, 0), (0, STICK_ORDERS - orders.size), (0, 0)))
    error += stick_slip * sticking / _peak(sticking)
    error *= peak_rad / _peak(error)
    return tuple(tuple((float(cos), float(sin)) for cos, sin in of_slice) for of_slice in error)


def _stick_slip(rng: Generator, n: int) -> Coordinates:
    """Return the harmonics (n, order, 2) of a catheter that sticks at one to three places a turn and slips on.

    From slice to slice the places move a little, and so does how long it sticks.
    """
    turn = 2 * np.pi * np.arange(TURN_SAMPLES) / TURN_SAMPLES
    lag = np.zeros((n, TURN_SAMPLES))
    for _ in range(int(rng.integers(1, 4))):
        begins = rng.uniform(0, 2 * np.pi) + 0.2 * drift(rng, n) + 0.02 * rng.normal(size=n)
        lasts = rng.uniform(0.4, 1.0) * (1 + 0.2 * drift(rng, n))
        depth = rng.uniform(0.5, 1) * (1 + 0.3 * drift(rng, n))
        since = np.mod(turn - begins[:, None], 2 * np.pi)
        behind = np.clip(since / lasts[:, None], 0, 1) - np.clip((since - lasts[:, None]) / SLIP_RAD, 0, 1)
        lag -= depth[:, None] * behind
    spectrum = np.fft.rfft(lag, axis=1)[:, 1 : STICK_ORDERS + 1] * (2 / TURN_SAMPLES)
    spectrum *= np.exp(-0.5 * (2 * np.arange(1, STICK_ORDERS + 1) / STICK_ORDERS) ** 2)
    return np.stack([spectrum.real, -spectrum.imag], axis=2)


def _peak(harmonics: Coordinates) -> float:
    """Return the largest value of all courses (n, order, 2)."""
    orders, turn = np.arange(1, harmonics.shape[1] + 1), np.linspace(0, 2 * np.pi, TURN_SAMPLES, endpoint=False)
    waves = np.stack([np.cos(np.outer(orders, turn)), np.sin(np.outer(orders, turn))], axis=1)
    return float(np.abs(np.einsum("nkc,kct->nt", harmonics, waves)).max())


def lost_ascans(rng: Generator, size: Preset, mean: float) -> tuple[LostAscans, ...]:
    """Return the blocks that the recorder dropped, 0.2–1 % of a turn each, at most one a slice."""
    slices = rng.permutation(size.n_slices)[: min(size.n_slices, int(rng.poisson(mean)))]
    return tuple(
        LostAscans(
            slice_index=int(k),
            ascan=int(rng.integers(1, size.n_ascans)),
            count=max(1, round(rng.uniform(0.002, 0.01) * size.n_ascans)),
        )
        for k in sorted(slices)
    )
