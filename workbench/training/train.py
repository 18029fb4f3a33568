"""An eye trained from nothing: examples, fitting, and the weights with a card that says on what."""

import json
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.fusion.segmentation.learned.network import save_eye
from endoct.modalities.device import Device, check_device
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.running.progress import Stages
from endoct.workbench.training.examples import bores, examples_of
from endoct.workbench.training.fitting import fitted

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
