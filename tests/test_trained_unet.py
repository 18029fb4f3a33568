"""The network that learned on a published set: θ is a circle to it, and it answers on a wall's own samples."""

import json
from pathlib import Path

import numpy as np
import torch

from benchmarks.trained_unet import COLUMNS, UNet, answer, given


def a_wall(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    valid = np.ones((rows, columns), np.bool_)
    valid[: rows // 4, columns // 2 :] = False
    return rng.gamma(4, size=valid.shape).astype(np.float32), valid


def test_a_wall_that_is_turned_has_its_cells_turned() -> None:
    torch.manual_seed(0)
    net = UNet().eval()
    with torch.inference_mode():
        view = given(*a_wall(40, 3 * COLUMNS), 0.02, depth=False)
        turned = given(*(np.roll(one, 3 * 40, axis=1) for one in a_wall(40, 3 * COLUMNS)), 0.02, depth=False)
        torch.testing.assert_close(turned, view.roll(40, 2), rtol=1e-3, atol=1e-4)
        found = net(view[None])
        torch.testing.assert_close(net(view.roll(40, 2)[None]), found.roll(40, 3), rtol=1e-3, atol=1e-4)
        assert found.std() > 0


def test_an_answer_has_the_walls_own_samples(tmp_path: Path) -> None:
    torch.manual_seed(0)
    torch.save({"endoscope": UNet().state_dict(), "oct": UNet().state_dict()}, tmp_path / "unet.pt")
    values, valid = a_wall(37, 500)
    np.save(tmp_path / "intensity.npy", values)
    np.save(tmp_path / "valid.npy", valid)
    (tmp_path / "given.json").write_text(json.dumps({"z_mm": list(0.02 * np.arange(37))}), encoding="utf-8")
    answer(tmp_path / "unet.pt", tmp_path, tmp_path)
    mask = np.load(tmp_path / "mask.npy")
    assert mask.dtype == np.bool_
    assert mask.shape == valid.shape
    assert not mask[~valid].any()
