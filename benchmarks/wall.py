"""The one wall of both sides: its networks trained, and it held against truth beside either side and plain rivals.

    python -m benchmarks.wall make sound:9300:9310 quick:9300:9308 --into PAIRS [--workers 2]
    python -m benchmarks.wall train cell depth --pairs PAIRS [--into fusion/evidence/networks.safetensors]
    python -m benchmarks.wall judge --pairs OTHER_PAIRS

Sets are presets of the simulator and those of the independent generator. ``make`` unrolls both sides of each specimen,
places them as `endoct compare` does, and keeps what they show with the truth on the common grid: 12 s of one core each.
``train`` leaves the weights of a network as they are that is not named.
"""

import argparse
import os
import pickle
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file
from torch import nn

from benchmarks.pairs import RecordedPair, recorded, seeds_of
from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian
from endoct.fusion.comparison import place_sides
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.wall.both_sides import BothSides, both_sides_of, cell_features
from endoct.fusion.wall.wall import BY_BOTH, BY_DEPTH, BY_LIGHT, depth_features, known_depth, wall_from
from endoct.workbench.bench.task import Case, load_method, method_names
from endoct.workbench.bench.tasks.depth import Depths
from endoct.workbench.bench.tasks.wall import TASK, ShownPair, believed_side

EPOCHS, BATCH, RATE = 20, 2048, 3e-3
WIDTHS = {"cell": 32, "depth": 64}
SAMPLES_A_PAIR, SAMPLES_WORSE, SAMPLES_FAR_FROM_ROWS = 6000, 750, 600
FOREIGN, PATCH_MM = (0.4, 0.7), 1.0
"""Which share of a worsened side is another bore's, and how large patches are."""
FAR_MM = 1000.0
DEPTHS_MM = ((0.03, 0.1), (0.1, 0.3), (0.3, 0.7), (0.7, 1.5))
DOUBTS = (0.0, 0.02), (0.02, 0.1), (0.1, 0.3), (0.3, 0.51)
REACHED_MM = 0.7
"""Deeper floors often lie beyond what OCT reaches."""
DECIDED = ((BY_LIGHT, "light"), (BY_DEPTH, "depth"), (BY_BOTH, "both"))
SMALLER_BY = 0.01
OURS = "endoct"


@dataclass(frozen=True, eq=False)
class Known:
    """What both sides show of a specimen, with its true cells and relief on the same grid.

    ``believed`` is the side of which endoct doubts less, by its place; the one with light where it doubts both alike.
    """

    name: str
    seed: int
    sides: BothSides
    believed: int
    cell: Mask
    relief_mm: Image


def known_of(pair: RecordedPair, name: str, seed: int) -> Known | None:
    """Return a pair placed, with the truth on the same grid; None where it is not aligned."""
    cell, relief_mm = pair.cell, pair.relief_mm
    try:
        placed = place_sides(*two_sides(pair.a, pair.b), CompareParameters())
    except EndoctError:
        return None
    if (sides := both_sides_of(placed)) is None:
        return None
    onto = placed.samplings[0].onto(placed.grid)
    true, _ = onto.mask(cell, np.ones(cell.shape, np.bool_))
    return Known(name, seed, sides, believed_side(placed, sides), true, onto.known(relief_mm, np.isfinite(relief_mm)))


def made(name: str, seed: int, into: Path) -> str:
    """Make, place and keep a specimen; say how that ended."""
    path = into / f"{name}-{seed}.pkl"
    if path.exists():
        return f"{path.name} is there"
    known = known_of(recorded(name, seed), name, seed)
    if known is None:
        return f"{path.name}: not aligned"
    keep(known, path)
    return f"{path.name}: {known.sides.grid.shape}"


def keep(known: Known, path: Path) -> None:
    """Write a specimen at one stroke."""
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(known, protocol=5))
    part.rename(path)


def kept(folder: Path) -> Iterator[Known]:
    """Yield the specimens in a folder, one at a time."""
    for path in sorted(folder.glob("*.pkl")):
        yield pickle.loads(path.read_bytes())


def train(networks: Sequence[str], folder: Path, into: Path) -> None:
    """Train ``networks``, cell and depth, on the specimens in ``folder``, and write their weights beside others."""
    rng = np.random.default_rng(0)
    cells, depths = [], []
    paths = sorted(folder.glob("*.pkl"))
    for known in kept(folder):
        if "cell" in networks:
            other: Known = pickle.loads(paths[rng.integers(len(paths))].read_bytes())
            worse = worsened(known.sides, other.sides, rng)
            cells += [_of_cells(known, known.sides, SAMPLES_A_PAIR, rng), _of_cells(known, worse, SAMPLES_WORSE, rng)]
        if "depth" in networks:
            far = _far_from_rows(known.sides)
            depths += _of_depths(known, known.sides, SAMPLES_A_PAIR, rng)
            depths += _of_depths(known, far, SAMPLES_FAR_FROM_ROWS, rng)
    samples = {"cell": (cells, 1), "depth": (depths, 2)}
    save_networks({name: fitted(samples[name][0], WIDTHS[name], samples[name][1]) for name in networks}, into)


Samples = tuple[NDArray[np.float32], NDArray[np.float32]]


def _of_cells(known: Known, sides: BothSides, n: int, rng: np.random.Generator) -> Samples:
    """Return what tells a cell at ``n`` samples by ``sides``, and whether each truly is one."""
    near, features = cell_features(sides)
    some = rng.choice(features.shape[1], n)
    return features[:, some], known.cell[near][some].astype(np.float32)[None]


def _of_depths(known: Known, sides: BothSides, n: int, rng: np.random.Generator) -> list[Samples]:
    """Return what tells depth at ``n`` samples of cells by ``sides``, how far that is off; or nothing."""
    depth_mm = known_depth(sides)
    told = (sides.cells[0] | sides.cells[1]) & known.cell & np.isfinite(depth_mm)
    if not told.any():
        return []
    some = rng.choice(np.flatnonzero(told), n)
    return [(depth_features(sides, told)(some), (known.relief_mm - depth_mm).flat[some][None])]


def worsened(sides: BothSides, other: BothSides, rng: np.random.Generator) -> BothSides:
    """Return ``sides`` where the one with light shows the cells of an ``other`` bore in patches.

    An endoscope may both miss cells and show some that are none, as in a saturated recording. Few bores are like that,
    so a network has to be shown more of them to learn how little such a side is worth.
    """
    grid, k = sides.grid, sides.light_side
    noise = rng.standard_normal(grid.shape).astype(np.float32)
    noise = gaussian(noise, PATCH_MM / grid.dz_mm, PATCH_MM / grid.dtheta_mm)
    foreign = noise < np.quantile(noise, rng.uniform(*FOREIGN))
    rows = (rng.integers(other.grid.n_z) + np.arange(grid.n_z)) % other.grid.n_z
    columns = (rng.integers(grid.n_theta) + np.arange(grid.n_theta)) % other.grid.n_theta
    elsewhere = np.ix_(rows, columns)
    lit = np.where(foreign, other.cells[other.light_side][elsewhere], sides.cells[k]) & sides.observed[k]
    return replace(
        sides,
        cells=(lit, sides.cells[1]) if k == 0 else (sides.cells[0], lit),
        probability=np.where(foreign, other.probability[elsewhere], sides.probability),
    )


def fitted(samples: Sequence[Samples], width: int, n_answers: int) -> nn.Sequential:
    """Return a network that answers what is wanted of ``samples``, (given, wanted) each.

    One answer is trained as log odds. Two are a value and the logarithm of its scale.
    """
    torch.manual_seed(0)
    given, wanted = (torch.from_numpy(np.concatenate(part, axis=1).T.copy()) for part in zip(*samples, strict=True))
    middle, spread = given.mean(0), given.std(0) + 1e-6
    layers = (nn.Linear(given.shape[1], width), nn.ReLU(), nn.Linear(width, width), nn.ReLU())
    network = nn.Sequential(*layers, nn.Linear(width, n_answers))
    scaled = (given - middle) / spread
    optimizer = torch.optim.Adam(network.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, EPOCHS)
    for _ in range(EPOCHS):
        for some in torch.randperm(len(scaled)).split(BATCH):
            answer, true = network(scaled[some]), wanted[some]
            if n_answers == 1:
                loss = nn.functional.binary_cross_entropy_with_logits(answer, true)
            else:  # a Student's t, 4 degrees of freedom: where a floor is another cell's, errors are large
                log_error = answer[:, 1:].clamp(-6, 1)
                z = (true - answer[:, :1]) / log_error.exp()
                loss = (log_error + 2.5 * torch.log1p(z**2 / 4)).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        schedule.step()
    first = network[0]
    with torch.no_grad():  # the scaling of what is given becomes part of the first layer
        first.weight /= spread
        first.bias -= first.weight @ middle
    return network


def save_networks(networks: Mapping[str, nn.Sequential], into: Path) -> None:
    """Write the weights of ``networks``, by name, beside those that lie in the file already."""
    weights = load_file(into) if into.exists() else {}
    for name, network in networks.items():
        weights |= {f"{name}.{key}": value.contiguous() for key, value in network.state_dict().items()}
    save_file(weights, into)


def _far_from_rows(sides: BothSides) -> BothSides:
    """Return ``sides`` as if depth had been measured nowhere near."""
    rows = replace(sides.rows, z_mm=sides.rows.z_mm + FAR_MM)
    return replace(sides, relief_mm=np.full_like(sides.relief_mm, np.nan), rows=rows)


Row = dict[str, float]


def judged(known: Known) -> Row:
    """Return what the wall and the methods of the bench's task come to on a specimen, and how its errors hold."""
    sides, wall = known.sides, wall_from(known.sides)
    case = Case("", ShownPair(sides, sides.darkness, known.believed), Depths(known.relief_mm, known.cell), {})
    answers = {name: load_method(TASK, name)(case.given) for name in method_names(TASK)}
    row = {name: TASK.judge(case, answer)["jaccard"] for name, answer in answers.items()}
    row["better side"] = max(row["endoscope"], row["oct"])
    both = sides.observed[0] & sides.observed[1] & np.isfinite(known.relief_mm)
    wrong = wall.cells != known.cell
    stated = np.minimum(wall.probability, 1 - wall.probability)
    for low, high in DOUBTS:
        part = both & (stated >= low) & (stated < high)
        row[f"wrong, stated {low:g}–{high:g}"], row[f"wrong, in truth {low:g}–{high:g}"] = (
            stated[part].mean(),
            wrong[part].mean(),
        )
    right = wall.cells & known.cell & both & np.isfinite(wall.relief_mm)
    error = wall.relief_mm - known.relief_mm
    row["volume"] = float(
        wall.relief_mm[wall.cells & both & np.isfinite(wall.relief_mm)].sum() / known.relief_mm[known.cell & both].sum()
    )
    depths = {"linear": sides.relief_mm, "kriged": answers["oct-kriged"].relief_mm}
    parts = {
        f"{low:g}–{high:g}": right & (known.relief_mm > low) & (known.relief_mm < high)
        for low, high in (*DEPTHS_MM, (0.0, REACHED_MM), (0.0, 9.0))
    }
    parts |= {f"{by} decided by {of}": right & (wall.decided == by) for by, of in DECIDED}
    for name, part in parts.items():
        if part.sum() > 500:
            off, sigma = error[part], wall.error_mm[part]
            row |= {f"{name} mean |error|": float(np.abs(off).mean()), f"{name} bias": float(np.median(off))}
            row[f"{name} median |error|"] = float(np.median(np.abs(off)))
            row |= {f"{name} in {k} sigma": float((np.abs(off) <= k * sigma).mean()) for k in (1, 2)}
            for rival, depth_mm in depths.items():
                row[f"{name} {rival}"] = float(np.abs(np.nan_to_num(depth_mm[part]) - known.relief_mm[part]).mean())
    return row


def table(rows: Sequence[tuple[str, Row]]) -> Iterator[str]:
    """Yield, by set, medians, means and the worst of cells, the rivals that the wall loses to first; then of depths."""
    for name in dict.fromkeys(of for of, _ in rows):
        mine = [row for of, row in rows if of == name]
        wall = np.array([row[OURS] for row in mine])
        names = {"better side", *method_names(TASK)} - {OURS}
        rivals = {key: np.array([row[key] for row in mine]) for key in names}
        of_wall = f"{np.median(wall):.3f} (mean {wall.mean():.3f}, worst {wall.min():.3f})"
        yield f"{name}: {len(mine)} aligned; wall {of_wall}"
        for key, v in sorted(rivals.items(), key=lambda of: float(np.median(wall - of[1]))):
            lost = int((wall < v - SMALLER_BY).sum())
            of_rival = f"{np.median(v):.3f} (mean {v.mean():.3f}, worst {v.min():.3f})"
            yield f"    {key}: {of_rival}; ahead of the wall by over {SMALLER_BY} in {lost}"
        for key in dict.fromkeys(
            key for row in mine for key in row if key[0].isdigit() or key == "volume" or key.startswith("wrong")
        ):
            v = np.array([row[key] for row in mine if key in row])
            yield f"    {key}: {np.median(v):.3f} (mean {v.mean():.3f}, {v.min():.3f} to {v.max():.3f})"


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wall", description=__doc__)
    parser.add_argument("act", choices=("make", "train", "judge"))
    parser.add_argument("sets", nargs="*")
    parser.add_argument("--pairs", type=Path)
    parser.add_argument("--into", type=Path, default=Path("fusion/evidence/networks.safetensors"))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.act == "train":
        train(options.sets, options.pairs, options.into)
    elif options.act == "judge":
        with ProcessPoolExecutor(options.workers) as pool:
            rows = list(pool.map(_judged, sorted(options.pairs.glob("*.pkl"))))
        print("\n".join(table(rows)))
    else:
        options.into.mkdir(exist_ok=True)
        with ProcessPoolExecutor(options.workers) as pool:
            for said in pool.map(partial(_made, options.into), seeds_of(options.sets)):
                print(said, flush=True)


def _made(into: Path, case: tuple[str, int]) -> str:
    return made(*case, into)


def _judged(path: Path) -> tuple[str, Row]:
    known: Known = pickle.loads(path.read_bytes())
    return known.name, judged(known)


if __name__ == "__main__":
    main()
