"""Bores in a CT, with a plan that lies off them: of simulated specimens, and of the user's own data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.json_values import number, read_object
from endoct.modalities.ct.ct_volume import CtVolume, read_ct
from endoct.modalities.ct.stored import SIGNS, SUFFIXES
from endoct.modalities.ct.trajectory import Trajectory, as_point, read_line
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama
from endoct.workbench.bench.cases.specimens import load_side
from endoct.workbench.bench.task import Case
from endoct.workbench.pipeline.truth import TruePose, load_truth, true_pose
from endoct.workbench.posing.plan import read_plan

PLAN_ASIDE_MM, PLAN_TILT_DEG = 1.0, 2.0
"""A plan lies at most this far off the bore, where nothing else is wanted."""
PLAN_FILE, TRUE_LINE = "plan.mrk.json", "bore.mrk.json"
MOST_SIDES = 2
MOST_SAMPLE_BYTES = 16_000_000
Given = tuple[tuple[Panorama, ...], CtVolume, Trajectory]


@dataclass(frozen=True, eq=False)
class TrueBore:
    """Where a bore is: ``to_lps`` (4, 4) of the bore frame, z inward from its mouth, and its ``length_mm``.

    ``sides``: where the rows and columns of each panorama lie in that frame; empty where only the line is known.
    """

    to_lps: Coordinates
    length_mm: float
    sides: tuple[TruePose, ...] = ()

    def axis_lps(self, z_mm: float) -> Coordinates:
        """Return the point of the axis at a depth, (3,) LPS."""
        return np.asarray(self.to_lps[:3, :3] @ np.array([0.0, 0.0, z_mm]) + self.to_lps[:3, 3])


PoseCase = Case[Given, TrueBore]


def posed_case(
    specimen: Path,
    sides: Sequence[str | Panorama],
    *,
    seed: int,
    plan_aside_mm: float = PLAN_ASIDE_MM,
    plan_tilt_deg: float = PLAN_TILT_DEG,
) -> PoseCase:
    """Return a simulated specimen with a CT as a case, without conditions, by the name of its folder.

    ``sides`` are names of recordings, or their panoramas where these are at hand; of a name SIDE, ``SIDE.zarr`` is
    read, or the recording ``SIDE`` unrolled. ``seed`` draws how the plan lies off the bore: up to ``plan_aside_mm``
    across it and along it, and up to ``plan_tilt_deg``. Raises :class:`EndoctError` where the specimen has no CT or no
    truth.
    """
    truth = load_truth(specimen)
    to_lps, length_mm = _true_axis(specimen, truth.recording)
    whole = [side if isinstance(side, Panorama) else load_side(specimen, side) for side in sides]
    poses = [true_pose(panorama, truth) for panorama in whole]
    plan = plan_off(to_lps, length_mm, plan_aside_mm, plan_tilt_deg, np.random.default_rng(seed))
    return Case(
        name=specimen.name,
        given=(tuple(whole), read_ct(ct_of(specimen)), plan),
        truth=TrueBore(to_lps, length_mm, tuple(poses)),
        conditions={},
    )


def plan_off(
    to_lps: Coordinates, length_mm: float, aside_mm: float, tilt_deg: float, rng: np.random.Generator
) -> Trajectory:
    """Return a plan off the bore: its entry evenly on a disc, its direction evenly on another, its depth evenly."""
    aside, at = aside_mm * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    tilt, towards = np.deg2rad(tilt_deg) * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    entry = np.array([aside * np.cos(at), aside * np.sin(at), aside_mm * rng.uniform(-1, 1)])
    inward = np.array([np.tan(tilt) * np.cos(towards), np.tan(tilt) * np.sin(towards), 1.0])
    begins = to_lps[:3, :3] @ entry + to_lps[:3, 3]
    ends = begins + length_mm * (to_lps[:3, :3] @ inward) / np.linalg.norm(inward)
    return Trajectory(as_point(begins), as_point(ends))


def own_cases(folder: Path) -> list[PoseCase]:
    """Return the cases in one folder of the user's own: by both sides where there are two, and by each alone.

    It holds one recording or panorama, or two; a CT, ``ct.nii.gz``, ``ct.nrrd`` and so on or ``ct/`` with a DICOM
    series, there or in ``truth``; ``plan.mrk.json``; and the truth: of a simulated specimen, or the true line
    ``truth/bore.mrk.json``. A simulated specimen needs no plan: it is drawn then. Raises :class:`EndoctError` where
    something is missing.
    """
    names = _sides_in(folder)
    line, simulated = folder / "truth" / TRUE_LINE, folder / "truth" / "recording.json"
    if not (line.is_file() or simulated.is_file()):
        raise EndoctError(f"{folder} has no truth", expected=f"that of a simulated specimen, or truth/{TRUE_LINE}")
    combinations = [tuple(names), *((name,) for name in names)] if len(names) == MOST_SIDES else [tuple(names)]
    panoramas = {name: load_side(folder, name) for name in names}
    cases: list[PoseCase] = []
    for chosen in combinations:
        sides = "both" if len(chosen) == MOST_SIDES else chosen[0]
        name, conditions = f"{folder.name}-{sides}", {"specimen": folder.name, "sides": sides}
        if line.is_file() and not simulated.is_file():
            given = (tuple(panoramas[side] for side in chosen), *_planned(folder))
            true = read_line(line)[0]
            cases.append(Case(name, given, TrueBore(true.to_lps, true.length_mm), conditions))
            continue
        case = posed_case(folder, [panoramas[side] for side in chosen], seed=_seed_of(folder))
        case = replace(case, name=name, conditions=conditions)
        has_plan = (folder / PLAN_FILE).is_file()
        cases.append(replace(case, given=(case.given[0], *_planned(folder))) if has_plan else case)
    return cases


def ct_of(folder: Path) -> Path:
    """Return the CT of a folder: a file or a folder of DICOM called ``ct``, in it or in its ``truth``."""
    for place in (folder, folder / "truth"):
        for path in (*(place / f"ct{suffix}" for suffix in SUFFIXES), place / "ct"):
            if path.exists():
                return path
    raise EndoctError(
        f"{folder} holds no CT", expected="ct.nii.gz, ct.nrrd, …, or ct/ with a DICOM series, in it or truth"
    )


def _sides_in(folder: Path) -> list[str]:
    recordings = [path.name for path in folder.iterdir() if (path / "acquisition.toml").is_file()]
    panoramas = [path.stem for path in folder.glob("*.zarr") if is_panorama(path)]
    names = sorted({*recordings, *panoramas})
    if not 1 <= len(names) <= MOST_SIDES:
        raise EndoctError(
            f"{folder} does not hold one side or two of a bore",
            found=", ".join(names) or "no recording and no panorama",
            expected="oct/ or endoscope/ with an acquisition.toml, or oct.zarr or endoscope.zarr",
        )
    return names


def _planned(folder: Path) -> tuple[CtVolume, Trajectory]:
    if not (folder / PLAN_FILE).is_file():
        raise EndoctError(f"{folder} holds no plan", expected=f"{PLAN_FILE}, a line of 3D Slicer from entry to target")
    planned = read_plan(ct_of(folder), None, None, folder / PLAN_FILE, None)
    return planned.ct, planned.plan


def _true_axis(specimen: Path, recording: Mapping[str, Any]) -> tuple[Coordinates, float]:
    """Return the transform (4, 4) of a simulated bore to LPS, and its length in mm."""
    with refusing(f"{specimen} does not say where its bore lies", expected="a simulated specimen with a CT"):
        world = recording["world"]
        to_lps = np.diag([*SIGNS[world["coordinates"]], 1.0]) @ np.array(world["bore_to_world"], dtype=np.float64)
        sample = read_object(specimen / "truth" / "sample.json", MOST_SAMPLE_BYTES)
        return to_lps, number(sample["bore"], "length_mm", 1.0, 1e3, "the sample")


def _seed_of(folder: Path) -> int:
    """Return the seed of a simulated specimen, which draws its plan too."""
    sample = read_object(folder / "truth" / "sample.json", MOST_SAMPLE_BYTES)
    return int(number(sample, "seed", 0, 2**53, "the sample"))
