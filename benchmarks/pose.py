"""How well is a bore found in a CT, and on what does that depend? And is a pose told where there is none?

    endoct simulate -o DIR/2000 --preset patient --seed 2000 --ct --vary ct.voxel_mm=0.3..0.3          and so on
    endoct unroll DIR/2000/oct -o DIR/2000/oct.zarr, and of the endoscope (else recordings are unrolled every time)
    python benchmarks/pose.py curves DIR/2000 DIR/2001 … --csv curves.csv [--only seen_mm]
    python benchmarks/pose.py impossible DIR/2000 DIR/2001 … --csv impossible.csv

- ``curves``: one thing at a time is changed: the length of bore seen, nearest to its end; the share of the wall, a
  sector; the voxels of the CT, scanned anew; how far the plan lies off. Everything else is as ``endoct bench pose`` has
  it. By endoscope, OCT, and both.
- ``impossible``, with sidecars as they are: the recordings of one bore in the CT of the next two, each with its own
  plan; in the mirror image of their own CT and plan; with a plan 5 mm aside; and with the OCT of the next bore, in the
  CT of that.

Judged as by ``endoct bench pose``. ``told`` says whether a pose was given; errors are stated also where it was not.
``cells``: how many cells of at least 0.1 mm² of wall the bore truly meets where it was seen.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.pose.air import AirAround, air_around
from endoct.fusion.pose.finding import PoseAnswer, SidePose, answer, find_alone
from endoct.fusion.pose.observation import Observation, observe
from endoct.fusion.pose.pose import WITHIN, BorePose
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.synthetic.ct_scan import scan
from endoct.synthetic.sample.parameters import Sample
from endoct.workbench.bench.cases.bores import PoseCase, posed_case
from endoct.workbench.bench.tasks.pose import judge, located
from endoct.workbench.pipeline.truth import TruePose, load_truth

SIDES = ("oct", "endoscope")
LEAST_CELL_MM2 = 0.1
SWEEPS: Mapping[str, Sequence[float]] = {
    "as it is": (0,),
    "seen_mm": (5, 10, 15, 20),
    "wall_share": (0.25, 0.5, 0.75),
    "voxel_mm": (0.15, 0.45, 0.6),
    "plan_off": (0, 0.5, 1.5),
}
"""``plan_off``: times 1 mm and 2°."""
Row = dict[str, str | float | bool]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("curves", "impossible"))
    parser.add_argument("specimens", nargs="+", type=Path)
    parser.add_argument("--only", choices=SWEEPS, action="append")
    parser.add_argument("--csv", type=Path)
    given = parser.parse_args()
    torch.set_num_threads(1)
    rows: list[Row] = []
    if given.kind == "curves":
        found = curves(given.specimens, given.only or SWEEPS)
    else:
        found = impossible([_case(one, None, "as it is", 0) for one in given.specimens])
    for row in found:
        rows.append(row)
        words = [f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}" for key, value in row.items()]
        print(*words, flush=True)
        if given.csv:
            pd.DataFrame(rows).to_csv(given.csv, index=False)


def curves(specimens: Sequence[Path], names: Sequence[str]) -> Iterator[Row]:
    """Yield the errors of every specimen at every value of what is changed."""
    for specimen in specimens:
        sample = Sample.model_validate_json((specimen / "truth" / "sample.json").read_text())
        for name in names:
            for value in SWEEPS[name]:
                about: Row = {"specimen": specimen.name, "changed": name, "value": value}
                try:
                    case = _case(specimen, sample, name, value)
                    yield from judged(case, {**about, "cells": _cells(specimen, case)})
                except EndoctError as error:
                    yield {**about, "sides": "", "told": False, "reason": str(error)}


def impossible(cases: Sequence[PoseCase]) -> Iterator[Row]:
    """Yield what is said of the recordings of every case, OCT first, where they cannot be."""
    for number, case in enumerate(cases):
        sides, ct, plan = observed(case), case.given[1], case.given[2]
        for step in (1, 2):
            other = cases[(number + step) % len(cases)]
            yield from _said(sides, other.given[1], other.given[2], f"{case.name} in {other.name}")
        yield from _said(sides, *_mirrored(ct, plan), f"{case.name} mirrored")
        aside = 5 * plan.to_lps[:3, number % 2] * (1 if number % 4 < 2 else -1)
        yield from _said(sides, ct, _moved(plan, aside), f"{case.name} 5 mm aside")
        other = cases[(number + 1) % len(cases)]
        mixed = [observed(other)[0], sides[1]]
        yield from _said(mixed, other.given[1], other.given[2], f"{case.name} with the OCT of {other.name}")


def _case(specimen: Path, sample: Sample | None, name: str, value: float) -> PoseCase:
    changed = {"plan_aside_mm": value, "plan_tilt_deg": 2 * value} if name == "plan_off" else {}
    seed = int("".join(filter(str.isdigit, specimen.name)))
    case = posed_case(specimen, SIDES, seed=seed, **changed)
    if name in ("seen_mm", "wall_share"):
        middle_rad = float(np.random.default_rng([seed, 1]).uniform(0, 2 * np.pi))
        shown = zip(case.given[0], case.truth.sides, strict=True)
        if name == "seen_mm":
            left = [nearest_the_end(panorama, pose, value) for panorama, pose in shown]
        else:
            left = [replace(one, valid=one.valid & sector(one, pose, middle_rad, value)) for one, pose in shown]
        case = replace(case, given=(tuple(left), *case.given[1:]))
    if name != "voxel_mm" or sample is None or sample.ct is None:
        return case
    scanned = scan(sample, sample.ct.model_copy(update={"voxel_mm": value}), drilled=False)
    ct = replace(
        case.given[1], voxels=scanned.hu, origin_mm=scanned.lattice.origin_mm, steps_mm=scanned.lattice.steps_mm
    )
    return replace(case, given=(case.given[0], ct, case.given[2]))


def nearest_the_end(panorama: Panorama, pose: TruePose, seen_mm: float) -> Panorama:
    """Return the rows and frames of ``panorama`` that lie within ``seen_mm`` of the one nearest the bore's end."""
    depth = pose.z_bore(panorama.z_mm)
    kept = depth >= depth.max() - seen_mm
    z_mm = panorama.z_mm[kept]
    places = panorama.per_frame[f"{panorama.frame_dim}_z_mm"].values
    frames = (places >= z_mm[0] - panorama.grid.dz_mm / 2) & (places <= z_mm[-1] + panorama.grid.dz_mm / 2)
    if z_mm.size < 2 or not frames.any():
        raise EndoctError(f"{seen_mm:g} mm of the bore leave nothing of the {panorama.modality} panorama")
    rows = panorama.grid.rows_mm
    uneven = None if rows is None else tuple(z_mm.tolist())
    grid = replace(panorama.grid, n_z=z_mm.size, z0_mm=float(z_mm[0]), rows_mm=uneven)
    return replace(
        panorama,
        grid=grid,
        intensity=panorama.intensity[kept],
        depth_mm=None if panorama.depth_mm is None else panorama.depth_mm[kept],
        valid=panorama.valid[kept],
        weight=panorama.weight[kept],
        per_frame={name: replace(one, values=one.values[frames]) for name, one in panorama.per_frame.items()},
    )


def sector(panorama: Panorama, pose: TruePose, middle_rad: float, share: float) -> Mask:
    """Return which columns lie within a sector of the bore's wall, (1, n_theta)."""
    apart = np.abs(wrap_rad(pose.theta_bore(panorama.grid.theta_rad) - middle_rad))
    return np.asarray(apart <= np.pi * share)[np.newaxis]


def observed(case: PoseCase) -> list[Observation]:
    return [observe(side) for side in two_sides(*case.given[0])]


def judged(case: PoseCase, about: Row) -> Iterator[Row]:
    panoramas, ct, plan = case.given
    air = air_around(ct, plan)
    found = [find_alone(air, side) for side in observed(case)]
    for sides, of in (("oct", found[:1]), ("endoscope", found[1:]), ("both", found)):
        answered = answer(air, plan, of)
        numbers = range(2) if sides == "both" else [SIDES.index(sides)]
        one = replace(
            case,
            given=(tuple(panoramas[number] for number in numbers), ct, plan),
            truth=replace(case.truth, sides=tuple(case.truth.sides[number] for number in numbers)),
        )
        scores = judge(one, located(answered.pose, one.given[0])) | _depths(answered.pose, one)
        yield {**about, "sides": sides, **_row_of(answered, of), **scores}


def _depths(pose: BorePose, case: PoseCase) -> dict[str, float]:
    """Return how many ends the panoramas have, and of how many the 95 % interval of the depth holds the true one."""
    to_lps, held, ends = case.truth.to_lps, 0, 0
    for name, panorama, truth in zip(pose.names, case.given[0], case.truth.sides, strict=True):
        rows = panorama.z_mm[[0, -1]]
        found = (pose.axis_lps(pose.depth_of(name, rows)) - to_lps[:3, 3]) @ to_lps[:3, 2]
        deviations = np.array([pose.depth_deviation_mm(name, float(row)) for row in rows])
        held += int((np.abs(found - truth.z_bore(rows)) < WITHIN * deviations).sum())
        ends += rows.size
    return {"depth_ends": ends, "depth_inside_95": held}


def _said(sides: Sequence[Observation], ct: CtVolume, plan: Trajectory, name: str) -> Iterator[Row]:
    try:
        air: AirAround = air_around(ct, plan)
    except EndoctError as error:
        yield {"case": name, "sides": "", "told": False, "reason": str(error)}
        return
    found = [find_alone(air, side) for side in sides]
    for of in ([found[0]], [found[1]], found):
        names = "both" if len(of) > 1 else of[0].fit.sides[0].name
        yield {"case": name, "sides": names, **_row_of(answer(air, plan, of), of)}


def _row_of(answered: PoseAnswer, of: Sequence[SidePose]) -> Row:
    return {
        "told": answered.reason is None,
        "agreement": max(one.fit.agreement[0] for one in of),
        "standing": max(one.standing for one in of),
        "doubts": len(answered.doubts),
        "reason": answered.reason or "",
    }


def _mirrored(ct: CtVolume, plan: Trajectory) -> tuple[CtVolume, Trajectory]:
    """Return a CT and its plan with left and right exchanged."""
    left = np.array([-1.0, 1.0, 1.0])
    (a, b, c), (d, e, f) = plan.entry_mm, plan.target_mm
    return replace(ct, origin_mm=ct.origin_mm * left, steps_mm=ct.steps_mm * left), Trajectory((-a, b, c), (-d, e, f))


def _moved(plan: Trajectory, by_mm: Coordinates) -> Trajectory:
    (a, b, c), (d, e, f) = (np.add(place, by_mm).tolist() for place in (plan.entry_mm, plan.target_mm))
    return Trajectory((a, b, c), (d, e, f))


def _cells(specimen: Path, case: PoseCase) -> int:
    wall = load_truth(specimen).wall
    first, last = np.sort(case.truth.sides[0].z_bore(case.given[0][0].z_mm[[0, -1]]))
    rows = (wall["z"] >= first) & (wall["z"] <= last)
    sample_mm2 = float(wall["z"][1] - wall["z"][0]) * 2 * np.pi * case.given[0][0].grid.radius_mm / wall["theta"].size
    samples = np.unique(wall["cell_id"][rows][wall["cell"][rows]], return_counts=True)[1]
    return int((samples * sample_mm2 >= LEAST_CELL_MM2).sum())


if __name__ == "__main__":
    main()
