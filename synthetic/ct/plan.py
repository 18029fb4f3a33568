"""The true line of a bore in its CT, and the plan that a surgeon would have had, as markups of 3D Slicer."""

import math
from pathlib import Path

import numpy as np

from endoct.modalities.ct.trajectory import Trajectory, as_point, write_line
from endoct.synthetic.bone.anatomy import target_mm
from endoct.synthetic.bone.grown import world_of
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.randomness import Stage, generator

PLAN_STREAM = 8  # of the bore's generators
MOST_OFF_MM, MOST_OFF_RAD = 1.0, math.radians(2.0)


def write_lines(folder: Path, sample: Sample) -> None:
    """Write the true line to ``truth/bore.mrk.json`` of a specimen's ``folder``, and its plan to ``plan.mrk.json``."""
    write_line(true_line(sample), "true bore", folder / "truth" / "bore.mrk.json")
    write_line(drawn_plan(sample), "plan", folder / "plan.mrk.json")


def true_line(sample: Sample) -> Trajectory:
    """Return the line from the mouth of the bore to what the drill aims at, LPS."""
    to_lps = world_of(sample)
    return Trajectory(as_point(to_lps[:3, 3]), as_point(to_lps[:3, :3] @ target_mm(sample.bore) + to_lps[:3, 3]))


def drawn_plan(sample: Sample) -> Trajectory:
    """Return a line as long as the true one: its entry up to 1 mm off, anywhere in a ball, tilted by up to 2°.

    It depends on the bore's seed alone, so that all recordings of one bore have one plan.
    """
    rng, line = generator(sample.bore_seed, Stage.BORE, PLAN_STREAM), true_line(sample)
    off = rng.normal(size=3)
    off *= MOST_OFF_MM * rng.random() ** (1 / 3) / np.linalg.norm(off)
    tilt, towards = MOST_OFF_RAD * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)
    aside = math.sin(tilt)
    inward = np.array([aside * math.cos(towards), aside * math.sin(towards), math.cos(tilt)])
    axes = line.to_lps
    entry = axes[:3, :3] @ off + axes[:3, 3]
    return Trajectory(as_point(entry), as_point(entry + line.length_mm * (axes[:3, :3] @ inward)))
