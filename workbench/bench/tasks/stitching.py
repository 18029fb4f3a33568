"""The task "stitching": where the strips of an endoscope lie along the bore, and how far the probe rolled.

Cases are strips of a toy wall, sampled where the probe truly was, or strips of simulated recordings, unrolled one by
one. The toy wall (:mod:`endoct.workbench.bench.cases.toy_strips`) shares nothing with the unroller. To say "I do not
know" of a pair is better than to be wrong, and counted apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.stitching.motion.feed import estimate_feed
from endoct.stitching.strip import Strip
from endoct.workbench.bench.cases import toy_strips
from endoct.workbench.bench.cases.specimens import PRESET_WORDS, simulated
from endoct.workbench.bench.program import read_answer, write_answer, write_given
from endoct.workbench.bench.task import SUCCESS, Case, Declined, Exchange, Range, Task, draw
from endoct.workbench.pipeline.truth import load_truth
from endoct.workbench.sides.recordings import open_recording

MADE = "made"
RIGHT_MM, RIGHT_DEG = 0.03, 1.0
"""A pair is right where feed and roll are within these; 1° is 0.02 mm along the wall."""
MOST_WRONG, LEAST_RIGHT = 0.02, 0.8
"""An answer succeeds with at most the first share of pairs wrong, and at least the second right."""


@dataclass(frozen=True, eq=False)
class StripPoses:
    """What a method answers, arrays (n,): ``z_mm`` and ``roll_rad``, float64, of every strip against the first.

    θ of the wall is θ of the strip + roll. ``trusted``, bool: whether the step from the strip before was measured;
    False means "I do not know", and is True for the first.
    """

    z_mm: Coordinates
    roll_rad: Coordinates
    trusted: Mask


@dataclass(frozen=True, eq=False)
class Places:
    """Where the strips truly lie, float64 (n,)."""

    z_mm: Coordinates
    roll_rad: Coordinates


StitchingCase = Case[tuple[Sequence[Strip], float], Places]


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> StitchingCase:
    """Return a case: strips and the nominal pitch, and their true places."""
    drawn = draw(seed, index, ranges)
    name, recipe = f"{seed}-{index}", str(drawn["recipe"])
    if recipe == MADE:
        numbers = {key: float(value) for key, value in drawn.items() if key in toy_strips.RANGES}
        strips, z_mm, roll_rad = toy_strips.toy_strips(seed, index, numbers)
        return Case(name, (strips, toy_strips.PITCH_MM), Places(z_mm, roll_rad), {"recipe": recipe, **numbers})
    with simulated(recipe, seed, index) as folder:
        return replace(_of_recording(Path(folder) / "specimen"), name=name, conditions={"recipe": recipe})


def own_cases(specimen: Path) -> list[StitchingCase]:
    """Return the case of a folder laid out as a simulated specimen."""
    return [_of_recording(specimen)]


def _of_recording(specimen: Path) -> StitchingCase:
    """Return the case of a simulated endoscope recording: its strips as unrolled, each in its own frame."""
    side = open_recording(specimen / "endoscope", modality="endoscope")
    modality: Any = side.manifest.load()
    calibration = modality.survey(side.stream, side.parameters)
    n = len(side.stream)
    alone = replace(calibration, z_mm=np.zeros(n), roll_rad=np.zeros(n), sway_rad=np.zeros((n, 2)))
    strips = tuple(modality.unroll(side.stream[k], alone) for k in range(n))
    true = load_truth(specimen).recording["endoscope"]
    z_mm = np.asarray(true["z_mm"])
    nominal_mm = getattr(side.stream.acquisition, "pitch_mm", None) or toy_strips.PITCH_MM
    pitch_mm = nominal_mm if z_mm[-1] > z_mm[0] else -nominal_mm
    return Case(specimen.name, (strips, pitch_mm), Places(z_mm, np.asarray(true["roll_rad"])), {"recipe": "recording"})


def judge(case: StitchingCase, answer: StripPoses) -> dict[str, float]:
    """Score the places of strips, pair by pair. Raises :class:`EndoctError` for an answer of another shape."""
    true = case.truth
    n = true.z_mm.size
    if any(np.shape(part) != (n,) for part in (answer.z_mm, answer.roll_rad, answer.trusted)):
        raise EndoctError("these are no places of strips", expected=f"z_mm, roll_rad and trusted, each ({n},)")
    known = np.asarray(answer.trusted, np.bool_)[1:]
    if not known.any():
        raise Declined("no pair of strips was trusted")
    feed = np.diff(answer.z_mm) - np.diff(true.z_mm)
    roll = np.rad2deg(wrap_rad(np.diff(answer.roll_rad) - np.diff(true.roll_rad)))
    if not np.isfinite(feed[known]).all() or not np.isfinite(roll[known]).all():
        raise EndoctError("a place that is trusted is no number")
    right = known & (np.abs(feed) <= RIGHT_MM) & (np.abs(roll) <= RIGHT_DEG)
    wrong = known & ~right
    drift = np.asarray(answer.z_mm) - true.z_mm
    return {
        SUCCESS: float(wrong.mean() <= MOST_WRONG and right.mean() >= LEAST_RIGHT),
        "right": float(right.mean()),
        "wrong": float(wrong.mean()),
        "unknown": float((~known).mean()),
        "feed_error_mm": float(np.median(np.abs(feed[known]))),
        "feed_bias_mm": float(np.median(feed[known])),
        "roll_error_deg": float(np.median(np.abs(roll[known]))),
        "place_error_mm": float(np.sqrt(np.mean((drift - drift.mean()) ** 2))),
    }


def ours(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Return feed and roll as the endoscope's survey finds them, from the logarithm of the strips."""
    first = strips[0]
    valid = np.stack([strip.valid & (strip.intensity > 0) for strip in strips])
    logs = np.log(np.where(valid, np.stack([strip.intensity for strip in strips]), 1.0)).astype(np.float32)
    feed = estimate_feed(
        logs,
        float(first.z_mm[1] - first.z_mm[0]),
        toy_strips.RADIUS_MM,
        nominal_pitch_mm * np.arange(len(strips), dtype=np.float64),
        valid=valid,
    )
    return StripPoses(feed.z_mm, feed.roll_rad, feed.trusted)


def _write_strips(given: tuple[Sequence[Strip], float], folder: Path) -> None:
    strips, pitch_mm = given
    facts = {
        "nominal_pitch_mm": pitch_mm,
        "z_mm": strips[0].z_mm.tolist(),
        "theta_rad": strips[0].theta_rad.tolist(),
    }
    intensity = np.stack([strip.intensity for strip in strips])
    write_given(folder, facts, intensity=intensity, valid=np.stack([strip.valid for strip in strips]))


def _write_places(answer: StripPoses, folder: Path) -> None:
    places = {
        name: [float(value) if np.isfinite(value) else None for value in values]
        for name, values in (("z_mm", answer.z_mm), ("roll_rad", answer.roll_rad))
    }
    write_answer(folder, {**places, "trusted": np.asarray(answer.trusted, np.bool_)})


def _read_places(given: tuple[Sequence[Strip], float], folder: Path) -> StripPoses:
    answer, n = read_answer(folder), len(given[0])
    z_mm, roll_rad = (np.asarray(answer.get(name, []), np.float64) for name in ("z_mm", "roll_rad"))
    return StripPoses(z_mm, roll_rad, np.asarray(answer.get("trusted", [True] * n), np.bool_))


TASK = Task(
    name="stitching",
    title="where the strips of an endoscope lie along the bore, and how far the probe rolled",
    signature=(
        "method(strips: Sequence[endoct.stitching.strip.Strip], nominal_pitch_mm: float) -> "
        "endoct.workbench.bench.tasks.stitching.StripPoses. z_mm of a strip is counted from the middle of its own "
        "band, theta_rad is the angle in its image; all have the same rows and columns, and a bore of about 2.5 mm "
        "across. The pitch is negative for a probe that moves out; frames that were lost leave no gap."
    ),
    cases=cases,
    judge=judge,
    ranges={"recipe": (MADE,), **toy_strips.RANGES},
    optional={"recipe": (MADE, *PRESET_WORDS)},
    scores={
        "right": "share of pairs right (within 0.03 mm and 1°)",
        "wrong": "share of pairs wrong",
        "unknown": "share of pairs said not to be known",
        "feed_error_mm": "median error of trusted feeds, mm",
        "feed_bias_mm": "median of trusted feeds minus true ones, mm",
        "roll_error_deg": "median error of trusted rolls, degrees",
        "place_error_mm": "rms error of all places, their mean taken off, mm",
    },
    own=own_cases,
    against="endoct",
    exchange=Exchange(
        write=_write_strips,
        read=_read_places,
        answer=_write_places,
    ),
    success=(
        f"at least {100 * LEAST_RIGHT:g} % of pairs right, within {RIGHT_MM:g} mm and {RIGHT_DEG:g}°, and at most "
        f"{100 * MOST_WRONG:g} % wrong"
    ),
)
