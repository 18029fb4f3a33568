"""The network fitted to varied examples, by cross-entropy, which makes its answers probabilities, and overlap."""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from endoct.base.compute.parallel import Advance
from endoct.fusion.segmentation.learned.network import Eye
from endoct.workbench.training.variation import Example, varied

RATE, DECAY, LEAST_RATE = 2e-3, 1e-3, 2e-6
WARM_UP = 100
OVERLAP = 0.3
"""Weight of the overlap (Dice) beside the cross-entropy."""
LARGEST_GRADIENT = 1.0


def fitted(examples: list[Example], steps: int, batch: int, seed: int, device: str, advance: Advance) -> Eye:
    """Return a network after ``steps`` steps over ``batch`` pieces each.

    On the CPU the same ``seed`` gives the same weights; a GPU adds up in another order.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    there = [Example(one.channels.to(device), one.cell.to(device)) for one in examples]
    eye = Eye().to(device)
    optimiser = torch.optim.AdamW(eye.parameters(), RATE, weight_decay=DECAY)
    for step in range(steps):
        for group in optimiser.param_groups:
            cooling = 0.5 * (1 + np.cos(np.pi * step / steps))
            group["lr"] = LEAST_RATE + RATE * cooling * min(1.0, (step + 1) / WARM_UP)
        channels, cell = varied(there, batch, rng)
        with torch.autocast("cuda", torch.bfloat16, enabled=device.startswith("cuda")):
            logits = eye(channels)
        optimiser.zero_grad()
        loss = loss_of(logits.float(), cell, channels[:, 3])
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(eye.parameters(), LARGEST_GRADIENT)
        optimiser.step()
        advance((step + 1) / steps)
    return eye.eval()


def loss_of(logits: Tensor, cell: Tensor, observed: Tensor) -> Tensor:
    """Return what is to be as small as possible; only ``observed`` samples count. All (batch, n_z, n_theta)."""
    entropy = binary_cross_entropy_with_logits(logits, cell, reduction="none")
    found, true = torch.sigmoid(logits) * observed, cell * observed
    both = (found * true).sum(dim=(1, 2))
    # with 50 samples more in both, a piece without cells says something too
    overlap = (2 * both + 50) / (found.sum(dim=(1, 2)) + true.sum(dim=(1, 2)) + 50)
    return (entropy * observed).sum() / observed.sum().clamp(min=1) + OVERLAP * (1 - overlap).mean()
