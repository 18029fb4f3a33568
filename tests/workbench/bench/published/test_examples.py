"""Examples of a published set: arrays of every task, and a training that learns from them."""

from pathlib import Path

import numpy as np
import pytest
import torch

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.examples import Examples

ROOT = Path(__file__).parents[4]


def test_segmentation_has_the_truth_on_the_panoramas_samples(made_set: Path) -> None:
    examples = Examples(made_set, "segmentation", "train")
    assert len(examples) == 4  # two specimens with two sides
    sides = set()
    for k in range(len(examples)):
        example = examples[k]
        shapes = {example[name].shape for name in ("intensity", "depth_mm", "valid", "cell")}
        assert len(shapes) == 1
        assert example["cell"].dtype == bool
        assert bool(example["has_depth"]) == bool(np.any(example["depth_mm"]))
        sides.add(str(example["name"]).split("/")[1])
    assert sides == {"oct", "endoscope"}


def test_the_depth_of_true_cells_lies_behind_the_wall(made_set: Path) -> None:
    examples = (Examples(made_set, "segmentation")[k] for k in range(4))
    for example in examples:
        if example["has_depth"] and example["cell"].any():
            cell, wall = (
                example["depth_mm"][example["valid"] & (example["cell"] == is_cell)] for is_cell in (True, False)
            )
            assert np.median(cell) > np.median(wall) + 0.05


def test_stitching_oct_and_alignment_have_their_truth(made_set: Path) -> None:
    strips = Examples(made_set, "stitching")[0]
    assert strips["strips"].shape[0] == strips["z_mm"].size == strips["roll_rad"].size
    pullback = Examples(made_set, "oct")[0]
    assert pullback["recording"].dtype == np.uint8
    assert pullback["recording"].shape[0] == pullback["turn_length"].size
    assert pullback["cell"].shape == (pullback["wall_z_mm"].size, pullback["wall_theta_rad"].size)
    pair = Examples(made_set, "alignment")[0]
    assert pair["z_in_a_mm"].size == pair["b_intensity"].shape[0]
    steps = np.angle(np.exp(1j * np.diff(pair["theta_in_a_rad"])))
    assert np.ptp(steps) < 1e-9  # θ runs on across 0/2π


def test_a_split_without_examples_and_another_task_are_refused(made_set: Path) -> None:
    with pytest.raises(EndoctError, match="no example"):
        Examples(made_set, "segmentation", "test")
    with pytest.raises(EndoctError, match="no examples"):
        Examples(made_set, "speed")


def test_the_manuals_training_runs_and_learns(made_set: Path) -> None:
    page = (ROOT / "docs" / "how-to" / "benchmark-data.md").read_text(encoding="utf-8")
    code = page.partition("```python\n")[2].partition("```")[0]
    assert '"DATA"' in code
    assert "loss.backward()" in code
    torch.manual_seed(0)
    code = code.replace('"DATA"', repr(str(made_set))).replace(
        "        loss.backward()", "        losses.append(float(loss.detach()))\n        loss.backward()"
    )
    losses: list[float] = []
    exec(code, {"losses": losses})
    assert len(losses) == 40
    assert np.mean(losses[-8:]) < 0.8 * np.mean(losses[:4])
