"""Whether the last fraction of a sample is found better by automatic differentiation than by our Gauss–Newton.

    python benchmarks/refinement.py [--seeds 0-19] [--csv FILE]

Pairs of the task "alignment" (`endoct bench alignment`), 2048 × 1024. Every method starts where the exhaustive search
ends, and sees the same evidence at the same blurs and samples:

- ``numpy``: :func:`endoct.fusion.registration.refinement.refine`.
- ``lbfgs``, ``lbfgs64`` (float64), ``adam``: torch. A is padded around the circle and interpolated by ``grid_sample``
  at B's samples; turn, shift, scale, then a shear too, minimise the share of B's variance that a polynomial of A's
  values leaves, of the same degree as ours.

A line a pair and method: mean landmark error, px; wall and processor seconds of the refinement alone; and by how much
the answer differs when it is run again with one thread in place of all, px (0: the same bits). Needs torch.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from threadpoolctl import threadpool_limits

from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.evidence import Evidence, blurred, brightness, clipped, prepare
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment
from endoct.fusion.registration.refinement import (
    BLURS_MM,
    FINE_TONE,
    FINER_MM,
    SAMPLES_A_BLUR,
    TONE,
    refine,
    sampled,
)
from endoct.fusion.registration.search import search
from endoct.workbench.bench.runner import parse_seeds
from endoct.workbench.bench.tasks.alignment import PX_MM, RADIUS_MM, RANGES, cases, judge

Z_SCALES = 0.95, 1.05
LBFGS_ROUNDS = 30
ADAM_ROUNDS, ADAM_STEP_PX = 60, 0.3
Method = Callable[[Evidence, Evidence, Alignment], Alignment]


def ours(a: Evidence, b: Evidence, start: Alignment) -> Alignment:
    """Refine with NumPy."""
    return refine(a, b, start, Z_SCALES)


def with_torch(a: Evidence, b: Evidence, start: Alignment, optimiser: str, dtype: torch.dtype) -> Alignment:
    """Refine by automatic differentiation, from coarse to fine; the shear joins at the finer blurs and is left out."""
    direction, sense = (-1.0 if start.z_reversed else 1.0), (-1.0 if start.mirrored else 1.0)
    middle_mm = direction * float(b.z_mm[[0, -1]].mean())
    half_mm = float(np.ptp(b.z_mm)) / 2
    # unknowns in mm at the ends: turn, shift about B's middle, scale, shear
    unknowns = torch.zeros(4, dtype=torch.float64)
    for sigma_mm in (*BLURS_MM, *FINER_MM):
        fine, coarse = (
            blurred(sampled(side, sigma_mm / samples), sigma_mm)
            for side, samples in zip((a, b), SAMPLES_A_BLUR, strict=True)
        )
        degree, free = (FINE_TONE, 4) if sigma_mm in FINER_MM else (TONE, 3)
        n_z, n_theta = fine.values.shape
        # one column more at either end: θ is a circle
        image = torch.as_tensor(np.pad(fine.values, ((0, 0), (1, 1)), mode="wrap"), dtype=dtype)[None, None]
        target = torch.as_tensor(coarse.values, dtype=dtype)
        theta_rad = torch.as_tensor(
            sense * (coarse.theta0_rad + 2 * np.pi / coarse.values.shape[1] * np.arange(coarse.values.shape[1]))
        )
        off_mm = torch.as_tensor(direction * coarse.z_mm - middle_mm)

        def left(
            of: torch.Tensor,
            image: torch.Tensor = image,
            target: torch.Tensor = target,
            theta_rad: torch.Tensor = theta_rad,
            off_mm: torch.Tensor = off_mm,
            fine: Evidence = fine,
            degree: int = degree,
            size: tuple[int, int] = (n_z, n_theta),
        ) -> torch.Tensor:
            turn = start.theta_shift_rad + (of[0] + of[3] * off_mm / half_mm)[:, None] / a.radius_mm + theta_rad
            z_mm = start.z_shift_mm + start.z_scale * middle_mm + of[1]
            z_mm = z_mm + (start.z_scale + of[2] / half_mm) * off_mm
            column = torch.remainder((turn - fine.theta0_rad) * size[1] / (2 * np.pi), size[1]) + 1
            row = ((z_mm - fine.z_mm[0]) / fine.dz_mm)[:, None].expand_as(column)
            at = torch.stack([2 * column / (size[1] + 1) - 1, 2 * row / (size[0] - 1) - 1], dim=-1).to(image.dtype)
            value = torch.nn.functional.grid_sample(image, at[None], align_corners=True)[0, 0]
            met = ((row >= 0) & (row <= size[0] - 1)).detach()
            x, y = value[met], target[met]
            x, y = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
            powers = torch.stack([x**k for k in range(degree + 1)])
            fit = torch.linalg.solve(powers @ powers.T, powers @ y)
            return ((y - fit @ powers) ** 2).mean()

        moved = unknowns[:free].clone().requires_grad_()
        rest = unknowns[free:]

        def loss(moved: torch.Tensor = moved, rest: torch.Tensor = rest) -> torch.Tensor:
            return left(torch.cat([moved, rest]))

        _minimise(loss, moved, optimiser)
        unknowns = torch.cat([moved.detach(), rest])
    turn_mm, shift_mm, stretch_mm, _ = unknowns.tolist()
    scale = start.z_scale + stretch_mm / half_mm
    return Alignment(
        theta_shift_rad=float(np.mod(start.theta_shift_rad + turn_mm / a.radius_mm, 2 * np.pi)),
        z_shift_mm=start.z_shift_mm + start.z_scale * middle_mm + shift_mm - scale * middle_mm,
        z_scale=scale,
        mirrored=start.mirrored,
        z_reversed=start.z_reversed,
    )


def _minimise(loss: Callable[[], torch.Tensor], moved: torch.Tensor, optimiser: str) -> None:
    if optimiser == "lbfgs":
        found = torch.optim.LBFGS(
            [moved], max_iter=LBFGS_ROUNDS, line_search_fn="strong_wolfe", tolerance_change=1e-10, tolerance_grad=1e-9
        )

        def closure() -> torch.Tensor:
            found.zero_grad()
            value = loss()
            value.backward()
            return value

        found.step(closure)
        return
    steps = torch.optim.Adam([moved], lr=ADAM_STEP_PX * PX_MM)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(steps, ADAM_ROUNDS)
    for _ in range(ADAM_ROUNDS):
        steps.zero_grad()
        loss().backward()
        steps.step()
        falling.step()


METHODS: dict[str, Method] = {
    "numpy": ours,
    "lbfgs": lambda a, b, start: with_torch(a, b, start, "lbfgs", torch.float32),
    "lbfgs64": lambda a, b, start: with_torch(a, b, start, "lbfgs", torch.float64),
    "adam": lambda a, b, start: with_torch(a, b, start, "adam", torch.float32),
}


def evaluate(seed: int, methods: list[str]) -> list[dict[str, float | str]]:
    """Return the rows of one pair."""
    case = cases(seed, 0, RANGES)
    a, b = (prepare(side) for side in case.given)
    start = search(clipped(a), clipped(b), ALL_ORIENTATIONS, Z_SCALES)
    if start is None:
        return []
    one, two = clipped(a), clipped(brightness(b) if start.correlation < 0 else b)
    rows: list[dict[str, float | str]] = []
    for name in methods:
        method = METHODS[name]
        answers: list[Alignment] = []
        wall, cpu = list[float](), list[float]()
        for threads in (None, 1):
            before = torch.get_num_threads()
            torch.set_num_threads(threads or before)
            begun, begun_cpu = time.perf_counter(), time.process_time()
            with threadpool_limits(threads):
                answers.append(method(one, two, start))
            wall.append(time.perf_counter() - begun)
            cpu.append(time.process_time() - begun_cpu)
            torch.set_num_threads(before)
        error_px = judge(case, answers[0])["landmark_px"]
        rows.append(
            {
                "pair": case.name,
                "method": name,
                "error_px": error_px,
                "wall_s": wall[0],
                "cpu_s": cpu[0],
                "one_thread_px": _apart_px(*answers, b.z_mm),
            }
        )
    return rows


def _apart_px(first: Alignment, other: Alignment, z_mm: np.ndarray) -> float:
    turn_mm = RADIUS_MM * float(np.abs(wrap_rad(first.theta_shift_rad - other.theta_shift_rad)))
    return max(turn_mm, float(np.abs(first.z_to_a(z_mm) - other.z_to_a(z_mm)).max())) / PX_MM


def summarise(rows: list[dict[str, float | str]]) -> str:
    """Return a line a method: what it got over all pairs."""
    lines = []
    for name, own in pd.DataFrame(rows).groupby("method", sort=False):
        error, wall, cpu = own["error_px"], own["wall_s"], own["cpu_s"]
        apart_px = own["one_thread_px"].max()
        lines.append(
            f"{name}: {error.size} pairs, error mean {error.mean():.4f}, median {error.median():.4f}, "
            f"most {error.max():.4f} px; wall {wall.median():.2f}, most {wall.max():.2f} s; "
            f"cpu {cpu.median():.2f}, most {cpu.max():.2f} s; with one thread at most {apart_px:.1g} px apart"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the methods over the pairs and print what they got."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-19", help="first-last")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    rows: list[dict[str, float | str]] = []
    for seed in parse_seeds(arguments.seeds):
        rows += evaluate(seed, arguments.methods)
        for row in rows[-len(arguments.methods) :]:
            print("  ".join(f"{k}={v:.4g}" if isinstance(v, float) else str(v) for k, v in row.items()), flush=True)
    print(summarise(rows))
    if arguments.csv and rows:
        pd.DataFrame(rows).to_csv(arguments.csv, index=False)


if __name__ == "__main__":
    main()
