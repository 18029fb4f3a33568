"""The learned eye: its inputs and the way back, the seam of θ, long bores in pieces, weights that are none."""

import os
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.relief import ParallaxRelief
from endoct.fusion.segmentation.learned import looking
from endoct.fusion.segmentation.learned.looking import (
    LOOK_MM,
    TRAINED_MM,
    Probability,
    inputs_of,
    look,
    on_own_samples,
    weights_for,
)
from endoct.fusion.segmentation.learned.network import HALVED, Convolution, Eye, bordered, load_eye, save_eye

N_Z, N_THETA, STEP_MM = 130, 400, 0.02
ROWS, COLUMNS = np.mgrid[:N_Z, :N_THETA]


def disc(row: float, column: float, radius_mm: float) -> Mask:
    across = np.mod(COLUMNS - column + N_THETA / 2, N_THETA) - N_THETA / 2
    return np.asarray(np.hypot(ROWS - row, across) * STEP_MM <= radius_mm)


CELLS = disc(40, 2, 0.35) | disc(90, 200, 0.3)


def darkness(values: np.ndarray, valid: Mask | None = None) -> Evidence:
    noisy = values + np.random.default_rng(5).normal(0, 0.03, values.shape)
    seen = np.ones(values.shape, np.bool_) if valid is None else valid
    z_mm, radius_mm = STEP_MM * np.arange(len(values)), N_THETA * STEP_MM / (2 * np.pi)
    return Evidence(np.where(seen, noisy, 0).astype(np.float32), seen, z_mm, STEP_MM, 0.3, radius_mm, "darkness")


def relief(values: np.ndarray) -> ParallaxRelief:
    return ParallaxRelief(values.astype(np.float32), np.full(values.shape, 0.03, np.float32))


@pytest.fixture(scope="module")
def weights() -> Path:
    ours = weights_for("endoscope", "endoct")
    assert ours is not None
    return ours


def seen_by(weights: Path, evidence: Evidence, depth: ParallaxRelief | None) -> Probability:
    return look(weights, evidence, depth, inputs_of(evidence, depth, LOOK_MM))


def jaccard(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / (one | other).sum())


def test_dark_and_deep_cells_are_seen_across_the_seam_and_plain_wall_is_none(weights: Path) -> None:
    seen = seen_by(weights, darkness(0.6 * CELLS), relief(0.25 * CELLS))
    assert jaccard(seen.of_cell > 0.5, CELLS) > 0.8
    assert seen.of_cell[~disc(40, 2, 0.5) & ~disc(90, 200, 0.45)].mean() < 0.05
    assert seen.of_cell[disc(40, 2, 0.2)].min() > 0.5


def test_depth_shows_floors_as_bright_as_the_wall(weights: Path) -> None:
    seen = seen_by(weights, darkness(0 * CELLS), relief(0.25 * CELLS))
    assert jaccard(seen.of_cell > 0.5, CELLS) > 0.6
    assert seen.without_depth is not None
    assert not (seen.without_depth > 0.5).any()


def test_without_depth_nothing_is_said_of_what_it_decides(weights: Path) -> None:
    seen = seen_by(weights, darkness(0.6 * CELLS), None)
    assert seen.without_depth is None


def test_turning_the_bore_by_whole_samples_turns_what_is_seen(weights: Path) -> None:
    values = darkness(0.6 * CELLS).values
    turned = replace(darkness(0.6 * CELLS), values=np.roll(values, 100, axis=1))
    one = seen_by(weights, replace(turned, values=values), None).of_cell
    other = seen_by(weights, turned, None).of_cell
    assert (np.abs(np.roll(one, 100, axis=1) - other) < 0.05).mean() > 0.99


def test_a_long_bore_is_seen_alike_in_pieces(weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    evidence = darkness(0.6 * np.concatenate([CELLS, CELLS]))
    whole = seen_by(weights, evidence, None).of_cell
    monkeypatch.setattr(looking, "PIECE_ROWS", 96)
    monkeypatch.setattr(looking, "OVERLAP_ROWS", 24)
    pieces = seen_by(weights, evidence, None).of_cell
    assert np.isfinite(pieces).all()
    assert ((whole > 0.5) == (pieces > 0.5)).mean() > 0.99


def test_inputs_tell_what_is_known_and_lead_back() -> None:
    valid = ~disc(60, 300, 0.2)
    deep = relief(0.3 * CELLS)
    deep.relief_mm[disc(90, 200, 0.3)] = np.nan
    inputs = inputs_of(darkness(0.6 * CELLS, valid), deep)
    assert inputs.channels.shape[2] % HALVED == 0
    back = [on_own_samples(channel, inputs, darkness(0.6 * CELLS)) for channel in inputs.channels]
    assert abs(back[0][disc(40, 2, 0.2)].mean() - 0.6) < 0.05
    assert abs(back[1][disc(40, 2, 0.2)].mean() - 0.5) < 0.05
    assert (back[2][disc(90, 200, 0.2)] == 0).all()
    assert back[2][disc(40, 2, 0.2)] == pytest.approx(0.1 / (0.1 + 0.03), abs=0.01)
    assert (back[3][disc(60, 300, 0.1)] == 0).all()
    assert inputs.z_mm[1] - inputs.z_mm[0] == pytest.approx(TRAINED_MM)


def test_weights_are_kept_and_what_is_none_is_refused(tmp_path: Path) -> None:
    torch.manual_seed(0)
    eye = Eye()
    save_eye(eye, tmp_path / "e.safetensors", {"modality": "endoscope"})
    again, card = load_eye(tmp_path / "e.safetensors")
    assert card == {"modality": "endoscope"}
    images = torch.rand(1, 4, 21, 64)
    assert again(images).shape == (1, 21, 64)
    torch.testing.assert_close(again(images), eye(images), atol=0.02, rtol=0.02)
    assert weights_for("endoscope", str(tmp_path / "e.safetensors")) == tmp_path / "e.safetensors"
    assert weights_for("oct", str(tmp_path / "e.safetensors")) is None
    assert weights_for("oct", "endoct") is None
    assert weights_for("endoscope", "off") is None
    (tmp_path / "bad.safetensors").write_bytes(b"nothing")
    for path in (tmp_path / "bad.safetensors", tmp_path / "absent.safetensors"):
        with pytest.raises(EndoctError, match="cannot be read"):
            weights_for("endoscope", str(path))


def test_weights_that_took_the_place_of_others_are_read_anew(tmp_path: Path) -> None:
    path, eye = tmp_path / "e.safetensors", Eye()
    save_eye(eye, path, {"modality": "endoscope"})
    assert looking.eye_of(path)[0] is looking.eye_of(path)[0], "once"
    for bias in (2.0, 3.0):
        torch.nn.init.constant_(eye.out.bias, bias)
        save_eye(eye, tmp_path / "new", {"modality": "endoscope"})
        (tmp_path / "new").replace(path)
        assert looking.eye_of(path)[0].out.bias.item() == bias


def spoilt(tmp_path: Path, fault: str) -> Path:
    """A file of weights that is at fault."""
    path, eye = tmp_path / "spoilt.safetensors", Eye()
    state = {name: weights.detach().half() for name, weights in eye.state_dict().items()}
    card = '["endoscope"]' if fault == "list" else '{"modality": "endoscope"}'
    if fault in ("nan", "inf"):
        state["out.bias"][0] = float(fault)
    if fault == "float32":
        state["out.bias"] = torch.full((1,), 1e30)
    save_file(state, path, metadata={"card": card})
    if fault == "large":
        path.write_bytes(path.read_bytes() + bytes(16_000_000))
    if fault == "pipe":
        path.unlink()
        os.mkfifo(path)
    return path


@pytest.mark.parametrize(
    ("fault", "match"),
    [
        ("nan", "no finite half floats"),
        ("inf", "no finite half floats"),
        ("float32", "no finite half floats"),
        ("list", "card is no table"),
        ("large", "too large"),
        ("pipe", "found a pipe"),
    ],
)
def test_weights_that_would_mislead_or_never_end_are_refused(tmp_path: Path, fault: str, match: str) -> None:
    with pytest.raises(EndoctError, match=match):
        weights_for("endoscope", str(spoilt(tmp_path, fault)))


def test_the_number_of_torchs_threads_changes_nothing(weights: Path) -> None:
    before = torch.get_num_threads()
    answers = []
    for n in (1, 2):
        torch.set_num_threads(n)
        answers.append(seen_by(weights, darkness(0.6 * CELLS), relief(0.25 * CELLS)).of_cell)
        assert torch.get_num_threads() == n
    torch.set_num_threads(before)
    np.testing.assert_array_equal(*answers)


@pytest.mark.parametrize(("n_z", "expected"), [(1, [(0, 1)]), (256, [(0, 256)]), (257, [(0, 256), (1, 257)])])
def test_pieces_are_equally_long(n_z: int, expected: list[tuple[int, int]]) -> None:
    assert [(piece.start, piece.stop) for piece in looking._pieces(n_z)] == expected


@pytest.mark.parametrize("n_z", [480, 481, 1981])
def test_pieces_cover_a_bore_and_overlap(n_z: int) -> None:
    pieces = looking._pieces(n_z)
    assert (pieces[0].start, pieces[-1].stop) == (0, n_z)
    assert all(one.stop - other.start >= looking.OVERLAP_ROWS for one, other in pairwise(pieces))
    assert len(pieces) == -(-(n_z - 32) // 224)


def answer_along(
    eye: Callable[[torch.Tensor], torch.Tensor], values: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> np.ndarray:
    """What an ``eye`` put in by hand says of ``values`` (n_z,) of darkness along a thin bore, looked at in pieces."""
    monkeypatch.setattr(looking, "PIECE_ROWS", 200)
    monkeypatch.setattr(looking, "OVERLAP_ROWS", 64)
    monkeypatch.setattr(looking, "eye_of", lambda _: (lambda channels: torch.logit(eye(channels[:, 0])), {}))
    image = np.repeat(values[:, None], 24, axis=1).astype(np.float32)
    z_mm = STEP_MM * np.arange(len(values))
    evidence = Evidence(image, np.ones(image.shape, np.bool_), z_mm, STEP_MM, 0.0, 0.06, "darkness")
    return look(Path("by hand"), evidence, None, inputs_of(evidence, None, LOOK_MM)).of_cell


RISE = np.linspace(0.05, 0.95, 500)


def test_pieces_lie_where_they_were_cut_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """An eye that repeats what it is shown returns all of it, to the last row."""
    told = answer_along(lambda shown: shown.clamp(0.01, 0.99), RISE, monkeypatch)
    np.testing.assert_allclose(told, np.repeat(RISE[:, None], 24, axis=1), atol=0.004)


def test_pieces_fade_into_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """An eye that says the same of all of a piece: its first row. Steps are drawn out over where pieces overlap.

    From piece to piece lie at most 136 rows of 1000, 0.13 of the rise; without fading that is a jump.
    """
    told = answer_along(lambda shown: shown[:, :1, :1].expand(shown.shape).clamp(0.01, 0.99), RISE, monkeypatch)[:, 0]
    steps = np.diff(told)
    assert told[0] == pytest.approx(0.05, abs=0.002)
    assert told[:20] == pytest.approx(told[0], abs=1e-6)  # the first piece alone
    assert told[-1] > 0.7
    assert steps.min() > -1e-6
    assert steps.max() < 0.01


def test_of_a_bore_that_is_one_piece_nothing_fades(monkeypatch: pytest.MonkeyPatch) -> None:
    told = answer_along(lambda shown: shown[:, :1, :1].expand(shown.shape).clamp(0.01, 0.99), RISE[:60], monkeypatch)
    assert told == pytest.approx(0.05, abs=1e-6)


def test_a_border_closes_the_circle_and_repeats_the_ends() -> None:
    image = torch.arange(6.0).reshape(1, 1, 2, 3)
    assert bordered(image)[0, 0].tolist() == [[2, 0, 1, 2, 0], [2, 0, 1, 2, 0], [5, 3, 4, 5, 3], [5, 3, 4, 5, 3]]


def test_a_coarser_image_beside_is_convolved_as_if_its_samples_were_doubled() -> None:
    torch.manual_seed(1)
    layer, image, coarser = Convolution(5, 8), torch.randn(2, 2, 6, 8), torch.randn(2, 3, 3, 4)
    doubled = coarser.repeat_interleave(2, 2).repeat_interleave(2, 3)
    torch.testing.assert_close(layer(image, coarser), layer(torch.cat([doubled, image], 1)), rtol=1e-4, atol=1e-5)
