"""Training of an eye, short: the same weights twice, examples that keep their truth, what is refused."""

from pathlib import Path

import numpy as np
import pytest
import torch

from endoct.base.errors import EndoctError
from endoct.fusion.segmentation.learned.network import Eye, load_eye
from endoct.workbench.training import ROWS, WEIGHTS, Example, fitted, loss_of, train, varied


def example(seed: int) -> Example:
    rng = np.random.default_rng(seed)
    cell = torch.zeros(220, 64)
    cell[60:120, -10:] = cell[60:120, :10] = 1
    channels = torch.stack([0.6 * cell, 0.5 * cell, torch.full_like(cell, 0.7), torch.ones_like(cell)])
    channels[0] += torch.from_numpy(rng.normal(0, 0.03, cell.shape).astype(np.float32))
    return Example(channels, cell)


def test_varied_examples_are_drawn_by_their_seed_and_keep_bounds() -> None:
    drawn = []
    for _ in range(2):
        torch.manual_seed(3)
        drawn.append(varied([example(0), example(1)], 6, np.random.default_rng(3)))
    for one, other in zip(*drawn, strict=True):
        torch.testing.assert_close(one, other, atol=0, rtol=0)
    channels, cell = drawn[0]
    assert channels.shape == (6, 4, ROWS, 64)
    assert cell.shape == (6, ROWS, 64)
    assert channels.isfinite().all()
    assert float(channels[:, 0].max()) <= 1.5
    assert ((channels[:, 2] > 0) | (channels[:, 1] == 0)).all()


def test_what_is_not_observed_costs_nothing() -> None:
    logits, cell = torch.full((1, 4, 4), 3.0), torch.ones(1, 4, 4)
    observed = torch.ones(1, 4, 4)
    observed[:, 2:] = 0
    wrong = logits.clone()
    wrong[:, 2:] = -9
    assert loss_of(logits, cell, observed) == loss_of(wrong, cell, observed)
    assert loss_of(-logits, cell, observed) > loss_of(logits, cell, observed)


def test_a_fit_learns_and_the_same_seed_gives_the_same_weights() -> None:
    given = [example(0), example(1)]
    eyes = [fitted(given, 4, 2, 5, "cpu", lambda _: None) for _ in range(2)]
    for one, other in zip(*(eye.state_dict().values() for eye in eyes), strict=True):
        torch.testing.assert_close(one, other, atol=0, rtol=0)
    torch.manual_seed(5)
    before = Eye().eval()
    channels = given[0].channels[None]
    with torch.inference_mode():
        losses = [float(loss_of(eye(channels), given[0].cell[None], channels[:, 3])) for eye in (before, eyes[0])]
    assert losses[1] < losses[0]


def test_nothing_is_trained_of_nothing(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="0 bores"):
        train(tmp_path / "eye", bores=0, steps=1, batch=1, seed=0, device="cpu", overwrite=False, progress=False)
    assert not (tmp_path / "eye").exists()


@pytest.mark.slow
def test_an_eye_is_trained_from_nothing(tmp_path: Path) -> None:
    card = train(tmp_path / "eye", bores=1, steps=2, batch=1, seed=0, device="cpu", overwrite=False, progress=False)
    assert card["trained_on"] == ["learning 7000"]
    assert load_eye(tmp_path / "eye" / WEIGHTS)[1]["steps"] == 2
