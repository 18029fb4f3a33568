"""A network that learned on the training half of the published set, as a program that the bench can submit.

    python -m benchmarks.trained_unet learn DATA -o unet.pt        # 20 minutes, with other work on two cores
    endoct bench submit segmentation DATA -o unet.json --program "unet=python -m benchmarks.trained_unet unet.pt"

It is what somebody would train who has nothing but the set: a U-Net (Ronneberger et al. 2015) for each of both
instruments on patches of the 12 training bores, turned, mirrored and in other light. They are padded as a circle.
"""

import argparse
import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits, interpolate, pad

from endoct.base.numeric.circle import masked_gaussian
from endoct.workbench.bench.published.examples import Examples

COLUMNS, ROW_MM = 384, 0.02
"""Columns of what a network sees, about as wide as the rows of an endoscope are high."""
LIGHT_MM = 0.6
WIDTHS = 16, 32, 64, 128
ROWS = {"endoscope": 192, "oct": 32}
STEPS, BATCH, FASTEST = 500, 4, 3e-3
SEED = 1


class UNet(nn.Module):
    """Four scales; θ is padded by what lies on the other side of the seam."""

    def __init__(self) -> None:
        super().__init__()
        down = [2, *WIDTHS]
        self.down = nn.ModuleList(_twice(a, b) for a, b in pairwise(down))
        self.up = nn.ModuleList(_twice(a + b, a) for a, b in pairwise(WIDTHS))
        self.last = nn.Conv2d(WIDTHS[0], 1, 1)

    def forward(self, view: torch.Tensor) -> torch.Tensor:
        passed = []
        for level, block in enumerate(self.down):
            view = block(nn.functional.max_pool2d(view, 2, ceil_mode=True) if level else view)
            passed.append(view)
        for level in reversed(range(len(self.up))):
            larger = interpolate(view, passed[level].shape[2:], mode="bilinear")
            view = self.up[level](torch.cat([passed[level], larger], dim=1))
        out: torch.Tensor = self.last(view)
        return out


class _Around(nn.Conv2d):
    def forward(self, view: torch.Tensor) -> torch.Tensor:
        around = pad(pad(view, (1, 1, 0, 0), mode="circular"), (0, 0, 1, 1), mode="replicate")
        return super().forward(around)


def _twice(before: int, after: int) -> nn.Sequential:
    each = [(before, after), (after, after)]
    return nn.Sequential(*(m for a, b in each for m in (_Around(a, b, 3, bias=False), nn.BatchNorm2d(b), nn.ReLU())))


def given(values: np.ndarray, valid: np.ndarray, dz_mm: float, *, depth: bool) -> torch.Tensor:
    """Return what a network sees, (2, rows, COLUMNS): depth in half mm, or light over that around; and valid."""
    known = np.where(valid, values, 0).astype(np.float32)
    if depth:
        known = np.clip(known, -0.5, 1.5) * 2
    else:
        column_mm = 2 * np.pi * 1.25 / valid.shape[1]
        around = masked_gaussian(known, valid, LIGHT_MM / dz_mm, LIGHT_MM / column_mm)
        known = np.clip(known / np.maximum(around, 1e-6), 0, 3) - 1
    rows = valid.shape[0] if depth else max(16, round(valid.shape[0] * dz_mm / ROW_MM))
    both = torch.tensor(np.stack([np.where(valid, known, 0), valid]).astype(np.float32))[None]
    return interpolate(both, (rows, COLUMNS), mode="area")[0]


def learn(data: str, steps: int) -> dict[str, Any]:
    """Return the weights of both networks, trained on the training half of the set in ``data``."""
    examples, weights = Examples(data, "segmentation", split="train"), dict[str, Any]()
    for side, height in ROWS.items():
        torch.manual_seed(SEED)
        rng = np.random.default_rng(SEED)
        walls = []
        for one in (examples[k] for k in range(len(examples))):
            depth = bool(one["has_depth"])
            if depth == (side == "oct"):
                values = one["depth_mm" if depth else "intensity"]
                view = given(values, one["valid"], _row_mm(one), depth=depth)
                cell = torch.tensor(one["cell"].astype(np.float32))[None, None]
                walls.append(torch.cat([view, interpolate(cell, view.shape[1:], mode="area")[0]]))
        net = UNet().train()
        optimiser = torch.optim.AdamW(net.parameters(), FASTEST, weight_decay=1e-4)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, FASTEST, total_steps=steps)
        for step in range(steps):
            batch = torch.stack([_patch(walls[rng.integers(len(walls))], height, rng) for _ in range(BATCH)])
            found, cell, valid = net(batch[:, :2])[:, 0], batch[:, 2], batch[:, 1]
            loss = binary_cross_entropy_with_logits(found, cell, weight=valid)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            if step % 50 == 49:
                print(side, step + 1, f"{float(loss.detach()):.3f}", file=sys.stderr)
        weights[side] = net.state_dict()
    return weights


def _row_mm(example: Any) -> float:
    return float(np.ptp(example["z_mm"]) / (len(example["z_mm"]) - 1))


def _patch(wall: torch.Tensor, height: int, rng: np.random.Generator) -> torch.Tensor:
    """Return rows of a wall, turned, mirrored and in other light, (3, height, COLUMNS)."""
    first = int(rng.integers(max(1, wall.shape[1] - height + 1)))
    piece = wall[:, first : first + height].roll(int(rng.integers(COLUMNS)), 2)
    piece = pad(piece, (0, 0, 0, height - piece.shape[1]))
    for axis in (1, 2):
        piece = piece.flip(axis) if rng.random() < 0.5 else piece
    piece = piece.clone()
    piece[0] = piece[0] * rng.uniform(0.7, 1.4) + torch.randn(piece[0].shape) * rng.uniform(0, 0.1)
    return piece


def answer(weights: Path, given_folder: Path, answer_folder: Path) -> None:
    """Answer one case of the task "segmentation"."""
    facts = json.loads((given_folder / "given.json").read_text(encoding="utf-8"))
    depth = (given_folder / "depth_mm.npy").exists()
    values = np.load(given_folder / ("depth_mm.npy" if depth else "intensity.npy"))
    valid = np.load(given_folder / "valid.npy").astype(bool)
    net = UNet().eval()
    net.load_state_dict(torch.load(weights, weights_only=True)["oct" if depth else "endoscope"])
    with torch.inference_mode():
        found = net(given(values, valid, _row_mm(facts), depth=depth)[None])
        mask = interpolate(found, valid.shape, mode="bilinear")[0, 0].numpy() > 0
    np.save(answer_folder / "mask.npy", mask & valid)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trained_unet", description=__doc__)
    if sys.argv[1:2] == ["learn"]:
        parser.add_argument("learn")
        parser.add_argument("data")
        parser.add_argument("-o", "--output", type=Path, required=True)
        parser.add_argument("--steps", type=int, default=STEPS)
        chosen = parser.parse_args()
        torch.save(learn(chosen.data, chosen.steps), chosen.output)
    else:
        for name in ("weights", "given", "answer"):
            parser.add_argument(name, type=Path)
        chosen = parser.parse_args()
        answer(chosen.weights, chosen.given, chosen.answer)


if __name__ == "__main__":
    main()
