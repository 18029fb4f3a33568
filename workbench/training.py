"""Train a learned eye from nothing: make examples, fit the network, write its weights and a card that says on what.

Examples are bores of the simulator, recorded by its endoscope and unrolled like any recording. They are varied far
beyond the simulator: other light, other bone, other mirrors, depth that is worse or missing. A network that was trained
on one world believes in it. So brightness and depth are each spoilt in their own way, and now and then one of the two
must do.

The loss is cross-entropy, which makes the network's answers probabilities, and overlap.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, conv2d, interpolate, pad, relu

from endoct.base.compute.parallel import Advance
from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.fusion.evidence.evidence import on_grid
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.learned.looking import inputs_of
from endoct.fusion.segmentation.learned.network import Eye, save_eye
from endoct.modalities.device import check_device
from endoct.stitching.panorama import Panorama
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import stored_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.specimen_files import write_endoscope
from endoct.synthetic.truth import write_truth
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose
from endoct.workbench.requests import TrainRequest, by_request
from endoct.workbench.running.outputs import versions
from endoct.workbench.running.progress import SilentStages, stages_for
from endoct.workbench.sides.recordings import open_recording, unroll_recording

PRESETS: tuple[PresetName, ...] = ("learning", "quick", "mastoid", "hard")
"""Bores are drawn from these in turn."""
FIRST_SEED = 7000
ROWS = 192
DARKEST, BRIGHTEST = 1.5, -0.75
NEAREST, DEEPEST = -1 / 3, 1.0
RATE, DECAY, LEAST_RATE = 2e-3, 1e-3, 2e-6
WARM_UP = 100
OVERLAP = 0.3
"""The overlap (Dice) has this weight, the cross-entropy 1."""
LARGEST_GRADIENT = 1.0
KIND = "eye"
MODALITY = "endoscope"
WEIGHTS, CARD = f"{MODALITY}.safetensors", "card.json"


@dataclass(frozen=True, eq=False)
class Example:
    """What the network is given, and the truth.

    ``channels``, float32 (4, n_z, n_theta); ``cell``, the share of each sample that is cell, (n_z, n_theta).
    """

    channels: Tensor
    cell: Tensor


@by_request(TrainRequest)
def train(request: TrainRequest) -> dict[str, object]:
    """Train an eye for the endoscope into the folder ``output``; return its card.

    Arguments are those of :class:`~endoct.workbench.requests.TrainRequest`. On the CPU the same arguments give the same
    weights on one kind of machine. Raises :class:`EndoctError` where the output or the device cannot be used.

    A fit that is far too short, in a quarter of a minute:

    >>> from endoct.workbench import train
    >>> card = train("eye", bores=1, steps=2, batch=1)  # doctest: +SKIP
    >>> card["trained_on"]  # doctest: +SKIP
    ['learning 7000']
    """
    steps, batch, seed, device = request.steps, request.batch, request.seed, request.device
    stages = stages_for(request.progress)
    for name, number in (("bores", request.bores), ("steps", steps), ("batch", batch)):
        if number < 1:
            raise EndoctError(f"an eye cannot be trained by {number} {name}", expected="at least 1")
    check_device(device)
    chosen = bores(request.bores)
    with new_output(Path(request.output), KIND, overwrite=request.overwrite) as folder:
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


def fitted(examples: list[Example], steps: int, batch: int, seed: int, device: str, advance: Advance) -> Eye:
    """Return a network after ``steps`` steps over ``batch`` pieces each.

    On the CPU the same ``seed`` gives the same weights; a GPU adds up in another order.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    there = [Example(example.channels.to(device), example.cell.to(device)) for example in examples]
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


def bores(n: int) -> list[tuple[PresetName, int]]:
    """Return presets and seeds of ``n`` bores."""
    return [(PRESETS[k % len(PRESETS)], FIRST_SEED + k) for k in range(n)]


def examples_of(chosen: list[tuple[PresetName, int]], advance: Advance) -> Iterator[Example]:
    """Yield the examples of bores, one each, in their order."""
    for done, (preset, seed) in enumerate(chosen, 1):
        with TemporaryDirectory() as folder:
            yield _example(preset, seed, Path(folder))
        advance(done / len(chosen))


def _example(preset: PresetName, seed: int, folder: Path) -> Example:
    """Return the example of a bore, which is recorded in ``folder``."""
    sample = draw(preset, seed)
    wall = build_wall(sample)
    maps = wall.maps()
    lighting = lighting_of(sample, maps)
    frames = (stored_frame(sample, maps, lighting, k) for k in range(len(sample.endoscope.z_mm)))
    write_endoscope(folder / "endoscope", sample, frames)
    write_truth(folder / "truth", sample, wall)
    panorama = unroll_recording(open_recording(folder / "endoscope"), SilentStages()).panorama
    truth = load_truth(folder)
    return example_of(panorama, true_cells(truth, true_pose(panorama, truth), panorama))


def example_of(panorama: Panorama, cell: np.ndarray) -> Example:
    """Return what the network is given of ``panorama``, and its true cells; ``cell``, bool (n_z, n_theta)."""
    side = Side(panorama.modality, panorama)
    darkness = side.contrast("dark")
    inputs = inputs_of(darkness, side.parallax)
    truth = replace(darkness, values=cell.astype(np.float32), valid=np.ones(cell.shape, np.bool_))
    share = on_grid(truth, inputs.z_mm, inputs.channels.shape[2]).values
    return Example(torch.from_numpy(inputs.channels), torch.from_numpy(share))


def varied(examples: list[Example], batch: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Return ``batch`` pieces of ``examples``, drawn and varied: (batch, 4, ``ROWS``, n_theta), and their cells.

    All are interpolated to as many columns as the first has. Draws of ``rng`` decide everything but noise, which is
    torch's.
    """
    n_theta = examples[0].cell.shape[1]
    pieces = [_piece(examples[int(rng.integers(len(examples)))], n_theta, rng) for _ in range(batch)]
    channels, cell = torch.stack([one for one, _ in pieces]), torch.stack([two for _, two in pieces])
    observed = (channels[:, 3] > 0.5).float()
    darkness = _other_light(channels[:, 0], cell, rng)
    relief, trust = _other_depth(channels[:, 1], channels[:, 2], rng)
    seen = torch.stack([darkness, relief, trust, torch.ones_like(trust)], dim=1) * observed[:, None]
    return seen, cell


def _piece(example: Example, n_theta: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Return some rows, turned, perhaps mirrored or upside down, and stretched along z."""
    both = torch.cat([example.channels, example.cell[None]])
    rows = round(ROWS * float(np.exp(rng.uniform(-0.3, 0.3))))
    if both.shape[1] < rows:
        both = pad(both, (0, 0, 0, rows - both.shape[1]), mode="replicate")
    first = int(rng.integers(both.shape[1] - rows + 1))
    both = torch.roll(both[:, first : first + rows], int(rng.integers(both.shape[2])), 2)
    flipped = [axis for axis in (1, 2) if rng.random() < 0.5]
    both = interpolate(both.flip(flipped)[None], (ROWS, n_theta), mode="bilinear", align_corners=False)[0]
    return both[:4], both[4]


def _other_light(darkness: Tensor, cell: Tensor, rng: np.random.Generator) -> Tensor:
    """Return darkness with other contrast, floors, texture, bands, stains, blur and noise."""

    def some(low: float, high: float) -> Tensor:
        return _each(darkness, rng.uniform(low, high, len(darkness)))

    def often(share: float) -> Tensor:
        return (some(0, 1) < share).float()

    darkness = darkness * torch.exp(some(-0.7, 0.5))
    darkness = torch.where((cell > 0.5) & (often(0.5) > 0), darkness * torch.exp(some(-1.2, 0.2)), darkness)
    for size in (2, 4, 8, 20, 60):
        darkness = darkness + _clouds(darkness, size) * some(0, 0.06) * often(0.6)
    along, around = torch.randn_like(darkness[:, :, :1]), torch.randn_like(darkness[:, :1, :])
    darkness = darkness + along * some(0, 0.03) * often(0.3) + around * some(0, 0.02) * often(0.3)
    stains = relu(_clouds(darkness, float(rng.uniform(8, 40))) - 1.6)
    darkness = darkness + stains * some(0, 0.5) * often(0.4) * (1 - cell)
    if rng.random() < 0.5:
        darkness = _blurred(darkness, float(rng.uniform(0.4, 1.6)))
    noisy = darkness + torch.randn_like(darkness) * some(0, 0.06)
    return noisy.clamp(BRIGHTEST, DARKEST)


def _other_depth(relief: Tensor, trust: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Return relief of another scale, pulled towards the wall, noisier, with gaps or none at all, and trust in it."""

    def some(low: float, high: float) -> Tensor:
        return _each(relief, rng.uniform(low, high, len(relief)))

    def often(share: float) -> Tensor:
        return (some(0, 1) < share).float()

    pulled = torch.where(often(0.35) > 0, some(0, 1), torch.ones_like(relief))
    relief = torch.where(relief > 0, relief * pulled, relief) * torch.exp(some(-0.3, 0.25))
    noise = some(0, 0.08) * often(0.5)
    relief = relief + noise * (_clouds(relief, 4) + _clouds(relief, 12))
    trust = trust / (1 + 6 * noise)
    gaps = (_clouds(relief, float(rng.uniform(4, 30))) > some(0.3, 3)).float()
    known = (1 - gaps) * (1 - often(0.25)) * (trust > 0).float()
    return relief.clamp(NEAREST, DEEPEST) * known, trust * known


def _each(like: Tensor, values: np.ndarray) -> Tensor:
    """Return one value for each of a batch, (batch, 1, 1)."""
    return torch.as_tensor(values, dtype=torch.float32, device=like.device)[:, None, None]


def _clouds(like: Tensor, size: float) -> Tensor:
    """Return noise of deviation 1 that varies over ``size`` samples, of the shape of ``like``, a circle around."""
    batch, n_z, n_theta = like.shape
    coarse = torch.randn(batch, 1, max(2, int(n_z / size)), max(2, int(n_theta / size)), device=like.device)
    closed = torch.cat([coarse, coarse[..., :1]], dim=3)
    return interpolate(closed, (n_z, n_theta), mode="bicubic", align_corners=True)[:, 0]


def _blurred(images: Tensor, sigma: float) -> Tensor:
    """Return ``images`` (batch, n_z, n_theta) blurred by a Gaussian of ``sigma`` samples."""
    reach = max(1, int(3 * sigma))
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, device=images.device) / sigma) ** 2)
    taps = taps / taps.sum()
    around = conv2d(pad(images[:, None], (reach, reach, 0, 0), mode="circular"), taps.view(1, 1, 1, -1))
    return conv2d(pad(around, (0, 0, reach, reach), mode="replicate"), taps.view(1, 1, -1, 1))[:, 0]
