"""Sound results of endoct: panoramas, comparison folders, summaries of them, the truth of simulated specimens."""

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from benchmarks.fuzz.seed_drawings import pictures
from benchmarks.fuzz.trees import Seed, Special, read_tree
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.files.masks import DRAWN_STORE, mask_on, save_drawings
from endoct.fusion.files.session import Identity, Session
from endoct.fusion.files.store import save_comparison
from endoct.fusion.geometry.alignment import Alignment, LandmarkPair, Place, SearchOutcome
from endoct.fusion.registration.by_hand import KnownBore, judge
from endoct.fusion.result import (
    Drift,
    Limits,
    Line,
    MaskScores,
    PairScores,
    Result,
    StoredAlignment,
)
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.scoring.raters import Drawing
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.pipeline.hand_masks import score_drawings

GRID = SurfaceGrid.full_circle(24, 32, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
N_FRAMES = 6

PAIRS = (
    LandmarkPair(Place(0.25, 1.5), Place(6.25, 1.5), "check", "rim", 0.02),
    LandmarkPair(Place(1.0, 0.5), Place(1.1, 0.75)),
)

P = TypeVar("P", bound=BaseModel)


def panorama(modality: str = "oct") -> Panorama:
    """Return a panorama with two cells, as either plug-in leaves it."""
    rng = np.random.default_rng(3)
    theta, z = np.meshgrid(GRID.theta_rad, GRID.z_mm)
    cells = np.hypot(1.25 * (theta - 2.0), z - 1.2) < 0.5
    cells |= np.hypot(1.25 * (theta - 4.5), z - 0.7) < 0.35
    valid = np.ones(GRID.shape, np.bool_)
    valid[:2] = False
    is_oct = modality == "oct"
    dim = "slice" if is_oct else "frame"
    of_frames = np.linspace(0.0, 2.2, N_FRAMES)
    own: Mapping[str, Any] = (
        {"start_angle_rad": 0.1 * of_frames, "bridged": np.arange(N_FRAMES) == 2, "residual_mm": 0.01 + 0 * of_frames}
        if is_oct
        else {"roll_rad": 0.1 * of_frames, "pair_trusted": np.ones(N_FRAMES, np.bool_)}
    )
    provenance = {
        "inputs": {"oct/pullback.tif": "cd" * 32},
        "acquisition": {"handedness": "mirrored", "modality": modality}, "parameters": {"n_theta": 32}, "versions": {},
    }  # fmt: skip
    return Panorama(
        GRID, np.where(cells, 40, 150) + rng.normal(0, 5, GRID.shape).astype(np.float32),
        (np.where(cells, 0.6, 0.0) + rng.normal(0, 0.01, GRID.shape)).astype(np.float32) if is_oct else None,
        valid, valid.astype(np.float32), modality, True, True, dim,
        {f"{dim}_z_mm": of_frames, f"{dim}_index": np.arange(N_FRAMES), **own}, provenance,
        ("Depth rows hold fixed lines.",),
    )  # fmt: skip


def panorama_seeds() -> Iterator[Seed]:
    """Yield panoramas."""
    for modality in ("oct", "endoscope"):
        with tempfile.TemporaryDirectory() as folder:
            save_panorama(panorama(modality), Path(folder) / "x.zarr")
            yield Seed(f"panorama of {modality}", "x.zarr", read_tree(Path(folder)))


@cache
def comparison_files(*, aligned: bool = True) -> dict[str, bytes]:
    """Return the files of a comparison folder, all that reports read in it, figures left out."""
    a, b = panorama("endoscope"), panorama("oct")
    drawn_cells = a.intensity < 90
    shifted = mask_on(np.roll(drawn_cells, 1, axis=1), a, Path("oct_1.png"))
    found = compare_panoramas(a, shifted, CompareParameters(n_theta=64))
    truth = {
        f"drawn/{name}.png": mask_on(np.roll(drawn_cells, turn, axis=0), a, Path(f"{name}.png"))
        for name, turn in (("anna_1", 0), ("anna_2", 1), ("ben_1", 2))
    }
    against = score_drawings(found, truth, 0.1)
    result = found.result.completed(
        truth=against.truth,
        raters=against.raters,
        notes={"endoscope": (), "mask": ("Depth rows 92–93 hold fixed lines & were interpolated.",)},
        versions={"endoct": "0.1.0", "numpy": "2.4.0"},
        inputs={"specimen/oct/pullback.tif": "cd" * 32},
        parameters={"compare": {"n_theta": 64, "force": True}, "oct": {"undistort": "sine"}},
        seconds={"align": 1.25, "write": 0.5},
    )
    result = _filled(result)
    if not aligned:
        best = StoredAlignment.of(Alignment(0.1, 0.2))
        unaligned = {"aligned": False, "reason": "Nothing stood out.", "jaccard": None, "dice": None}
        result = result.model_copy(update={**unaligned, "alignment": None, "best_unbelieved": best})
    # the mask stands for a side of the other modality
    renamed = Result.model_validate(json.loads(json.dumps(result.to_json()).replace('"mask"', '"oct"')))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        endoscope, drawn = found.sides
        cells = tuple(replace(cell, **_renamed(cell)) for cell in found.cells)
        sides = endoscope, replace(drawn, name="oct")
        save_comparison(replace(found, sides=sides, result=renamed, cells=cells), folder / "comparison.zarr")
        for side in (a, b):
            save_panorama(side, folder / "panoramas" / f"{side.modality}.zarr")
        (folder / "result.json").write_text(json.dumps(renamed.to_json()), encoding="utf-8")
        pictured = {f"pictures/{name}": data for side in ("oct", "endoscope") for name, data in pictures(side).items()}
        return read_tree(folder) | pictured


INTERVAL = 0.25, 0.75
LINE = Line(mean=0.0, per_mm=0.2, per_mm_error=0.01)
LIMITS = Limits(pairs=6, bias=0.1, low=-0.3, high=0.5, bias_interval=INTERVAL)
UNKNOWN: Mapping[str, Any] = {
    "area_mm2": LIMITS,
    "depth_mm": LIMITS,
    "drift": Drift(pairs=6, length_mm=2.0, z_mm=LINE, arc_mm=LINE),
}
"""What so few cells do not give."""


def _filled(result: Result) -> Result:
    """Return a result in which everything is known, also from so few cells; strata once, not for every truth."""
    assert result.scores is not None
    assert result.truth is not None
    assert result.raters is not None
    consensus = {name: c.model_copy(update={"sides": _plain(c.sides)}) for name, c in result.raters.consensus.items()}
    against = {path: _plain(sides) for path, sides in result.truth.items()}
    changed = {
        "scores": _known(result.scores),
        "budget": result.budget and _known(result.budget),
        "by_hand": judge(
            PAIRS, SearchOutcome(Alignment(0.1, 0.2)), KnownBore(GRID.radius_mm, ((False, False),), (0.95, 1.05))
        ).said,
        "truth": against,
        "raters": result.raters.model_copy(update={"consensus": consensus}),
    }
    return result.model_copy(update=changed)


def _plain(sides: Mapping[str, MaskScores]) -> dict[str, MaskScores]:
    """Return scores against a mask, all known, without strata."""
    stated = {name: _known(scores).model_dump(exclude={"strata"}, by_alias=True) for name, scores in sides.items()}
    return {name: MaskScores.model_validate(scores) for name, scores in stated.items()}


def _known(part: P) -> P:
    """Return ``part`` with every interval, limit and drift known."""
    changed: dict[str, Any] = {}
    for name, value in part:
        if value is None:
            changed[name] = UNKNOWN.get(name, INTERVAL if "interval" in name else None)
        else:
            changed[name] = _deeper(value)
    return part.model_copy(update=changed)


def _deeper(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return _known(value)
    return tuple(map(_deeper, value)) if isinstance(value, tuple) else value


def _renamed(cell: Cell) -> dict[str, str]:
    return {name: "oct" for name in ("side", "depth_of", "seen_by") if getattr(cell, name, None) == "mask"}


def comparison_seeds() -> Iterator[Seed]:
    """Yield comparison folders, aligned and not."""
    for aligned in (True, False):
        yield Seed(f"comparison, {'aligned' if aligned else 'not aligned'}", "", comparison_files(aligned=aligned))


def comparison_store_seeds() -> Iterator[Seed]:
    """Yield ``comparison.zarr`` with the result next to it."""
    kept = "comparison.zarr/", "result.json"
    files = {name: data for name, data in comparison_files().items() if name.startswith(kept)}
    yield Seed("comparison store", "comparison.zarr", files)


def summary_seeds() -> Iterator[Seed]:
    """Yield folders of results as ``endoct summarise`` takes them: two sets, two specimens, two repeats each."""
    whole = Result.model_validate(json.loads(comparison_files()["result.json"]))
    result = Result(
        sides=whole.sides, aligned=True, alignment=whole.alignment, jaccard=None, dice=whole.dice, budget=whole.budget,
        scores=whole.scores and PairScores(**{name: part for name, part in whole.scores if name != "strata"}),
        valid_fraction=whole.valid_fraction, overlap_mm=whole.overlap_mm, truth={"drawn/anna_1.png": {}},
    )  # fmt: skip
    files = {}
    for k, place in enumerate(f"{of}/{specimen}/{repeat}" for of in "ab" for specimen in "xy" for repeat in "12"):
        one = result.model_copy(update={"jaccard": 0.5 + 0.01 * k, "inputs": {"oct.tif": f"digest {place[2:]}"}})
        files[f"{place}/result.json"] = json.dumps(one.to_json()).encode()
    yield Seed("summary", "", files)


def result_seeds() -> Iterator[Seed]:
    """Yield comparison folders of which only ``result.json`` is there, and the folder that they are known by."""
    for aligned in (True, False):
        files = {"result.json": comparison_files(aligned=aligned)["result.json"], "comparison.zarr": Special("folder")}
        yield Seed(f"result, {aligned}", "", files)


def session_seeds() -> Iterator[Seed]:
    """Yield a session file with pairs, and one without."""
    sides = Identity("endoscope", "a" * 64, "b" * 64), Identity("oct", "c" * 64, "d" * 64)
    for name, placed in (("pairs", PAIRS), ("none", ())):
        yield Seed(name, "session.json", {"session.json": Session(sides, placed).to_bytes()})


def drawn_seeds() -> Iterator[Seed]:
    """Yield the masks of two people as `endoct compare` keeps them."""
    grid = SurfaceGrid.full_circle(6, 16, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    mask = np.indices(grid.shape).sum(axis=0) % 3 == 0
    drawings = [Drawing(rater, "1", mask, np.ones_like(mask)) for rater in ("anna", "ben")]
    with tempfile.TemporaryDirectory() as scratch:
        save_drawings(drawings, grid, Path(scratch) / DRAWN_STORE)
        yield Seed("two raters", "", read_tree(Path(scratch)))


def truth_seeds() -> Iterator[Seed]:
    """Yield simulated specimens' truth next to a panorama of one of their recordings."""
    recording = {
        "bore_radius_mm": 1.25,
        "oct": {
            "z_mm": np.linspace(2.2, 0, N_FRAMES).tolist(), "z_advance_mm": 0.1, "theta_origin_rad": 0.4,
            "theta_sense": -1,
            "start_angle_rad": [0.1] * N_FRAMES, "turn_length": [1.0] * N_FRAMES, "handedness": "mirrored",
            "travel": "out",
        },
        "endoscope": {
            "z_mm": np.linspace(0, 2.2, N_FRAMES).tolist(), "roll_rad": [0.1] * N_FRAMES, "travel": "in",
            "offset_mm": [[0.0, 0.1]] * N_FRAMES,
        },
    }  # fmt: skip
    for modality in ("oct", "endoscope"):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            (folder / "truth").mkdir()
            write_wall(folder / "truth" / "wall.zarr")
            save_panorama(panorama(modality), folder / "panorama.zarr")
            (folder / "truth" / "recording.json").write_text(json.dumps(recording))
            yield Seed(f"truth of {modality}", "", read_tree(folder))


def write_wall(path: Path) -> None:
    """Write the truth of a wall as the simulator does."""
    rng, dims = np.random.default_rng(5), ("z", "theta")
    arrays = {
        "relief_mm": Named(dims, rng.random((10, 16), np.float32), {"units": "mm"}),
        "cell": Named(dims, rng.random((10, 16)) < 0.3),
        "cell_id": Named(dims, rng.integers(0, 3, (10, 16), np.int32)),
        "z": Named(("z",), 0.25 * np.arange(10.0), {"units": "mm"}),
        "theta": Named(("theta",), np.arange(16) * 2 * np.pi / 16, {"units": "rad"}),
    }
    write_arrays(path, arrays, {})
