"""Train an eye from nothing: make examples, fit the network, and write its weights with a card that says on what.

Cross-entropy makes the network's answers probabilities; the overlap is added to it.
"""

import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from endoct.base.compute.parallel import Advance
from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.fusion.segmentation.learned.network import Eye, save_eye
from endoct.modalities.device import Device, check_device
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.running.progress import Stages
from endoct.workbench.training.examples import Example, bores, examples_of, varied

RATE, DECAY, LEAST_RATE = 2e-3, 1e-3, 2e-6
WARM_UP = 100
OVERLAP = 0.3
"""The overlap (Dice) has this weight, the cross-entropy 1."""
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
    """Return the loss over the ``observed`` samples; all arguments are (batch, n_z, n_theta)."""
    entropy = binary_cross_entropy_with_logits(logits, cell, reduction="none")
    found, true = torch.sigmoid(logits) * observed, cell * observed
    both = (found * true).sum(dim=(1, 2))
    # with 50 samples more in both, a piece without cells says something too
    overlap = (2 * both + 50) / (found.sum(dim=(1, 2)) + true.sum(dim=(1, 2)) + 50)
    return (entropy * observed).sum() / observed.sum().clamp(min=1) + OVERLAP * (1 - overlap).mean()


KIND = "eye"
MODALITY = "endoscope"
WEIGHTS, CARD = f"{MODALITY}.safetensors", "card.json"


def train(
    output: Path, *, n_bores: int, steps: int, batch: int, seed: int, device: Device, overwrite: bool, stages: Stages
) -> dict[str, object]:
    """Train an eye for the endoscope into the folder ``output``; return its card.

    On the CPU the same arguments give the same weights on one kind of machine. Raises :class:`EndoctError` where the
    output or the device cannot be used.
    """
    for name, number in (("bores", n_bores), ("steps", steps), ("batch", batch)):
        if number < 1:
            raise EndoctError(f"an eye cannot be trained by {number} {name}", expected="at least 1")
    check_device(device)
    chosen = bores(n_bores)
    with new_output(output, KIND, overwrite=overwrite) as folder:
        folder.mkdir(exist_ok=True)
        with stages.stage("examples") as advance:
            examples = list(examples_of(chosen, advance))
        with stages.stage("fit") as advance:
            eye = fitted(examples, steps, batch, seed, device, advance)
        card: dict[str, object] = {
            "modality": MODALITY,
            "trained_on": [f"{preset} {of}" for preset, of in chosen],
            "steps": steps,
            "batch": batch,
            "seed": seed,
            "device": device,
            "versions": versions("torch"),
        }
        save_eye(eye, folder / WEIGHTS, card)
        (folder / CARD).write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
    return card
