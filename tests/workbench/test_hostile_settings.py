"""Hostile settings, conditions, seeds and samples to replay end in one line, without memory."""

import copy
import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from endoct.base.errors import EndoctError
from endoct.synthetic.draw import draw
from endoct.synthetic.specimen import simulate as render
from endoct.workbench.bench.runner import parse_seeds
from endoct.workbench.pipeline.simulating import simulate
from endoct.workbench.settings import parse, parse_vary

SAMPLE: dict[str, Any] = json.loads(draw("learning", 3).model_dump_json())


@pytest.mark.parametrize("text", ["9" * 5000, "[" * 50_000, "-" + "1" * 9000])
def test_a_setting_that_breaks_its_reader_is_told(text: str) -> None:
    with pytest.raises(EndoctError, match="cannot be read") as caught:
        parse((f"dz_mm={text}",))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["0-99999999999999", "1" * 5000, "٣", "²", "0-1000000", ",".join(["0-600000"] * 2)])
def test_absurd_seeds_are_refused(text: str) -> None:
    with pytest.raises(EndoctError):
        parse_seeds(text)


@pytest.mark.parametrize(
    "entry", ["oct.wall_db=nan", "oct.wall_db=-inf..inf", "oct.wall_db=" + "9" * 9000, "oct.scan=" + "|" * 9]
)
def test_ranges_that_cannot_be_drawn_are_refused(entry: str) -> None:
    with pytest.raises(EndoctError):
        parse_vary([entry])


def changed(path: str, value: object) -> dict[str, Any]:
    sample = copy.deepcopy(SAMPLE)
    *parts, last = path.split(".")
    within: Any = sample
    for part in parts:
        within = within[int(part) if part.isdigit() else part]
    within[last] = value
    return sample


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("bore.cells", SAMPLE["bore"]["cells"][:1] * 100_000),
        ("bore.length_mm", 1e300),
        ("bore.length_mm", float("nan")),
        ("bore.diameter_mm", True),
        ("bore.diameter_mm", "2.5"),
        ("bore.cells.0.z_mm", 1e300),
        ("bore.cells.0.outline", [[0.1, 0.1]] * 1000),
        ("oct.n_glints", 10**9),
        ("oct.sheath", SAMPLE["oct"]["sheath"][:1] * 1000),
        ("oct.rotation_error_rad", [[[1e9, 1e9]]] * len(SAMPLE["oct"]["z_mm"])),
        ("endoscope.width_px", 10**9),
        ("endoscope.focal_px", 1e300),
        ("endoscope.dirt", SAMPLE["endoscope"]["dirt"][:1] * 100_000),
        ("seed", -1),
        ("seed", 10**40),
        ("seed", 1.5),
        ("preset", "huge"),
        ("bore", []),
    ],
)
def test_a_changed_sample_is_refused(path: str, value: object, tmp_path: Path) -> None:
    (tmp_path / "sample.json").write_text(json.dumps(changed(path, value)))
    tracemalloc.start()
    try:
        with pytest.raises(EndoctError) as caught:
            simulate(tmp_path / "out", replay=tmp_path / "sample.json")
        assert tracemalloc.get_traced_memory()[1] < 400_000_000
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", ["[" * 100_000, "9" * 5000, "{", "[]", "\x00", '{"a":' * 9000])
def test_what_is_no_sample_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "sample.json").write_text(content)
    with pytest.raises(EndoctError) as caught:
        simulate(tmp_path / "out", replay=tmp_path / "sample.json")
    assert "\n" not in str(caught.value)


def test_a_sample_from_a_device_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="a device"):
        simulate(tmp_path / "out", replay="/dev/zero")


@pytest.mark.parametrize("seed", [-1, -(10**5000), 2**64 + 1, 10**5000], ids=["-1", "-huge", "large", "huge"])
def test_a_seed_beyond_all_bounds_is_refused(seed: int, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="seed"):
        render(tmp_path / "out", preset="learning", seed=seed)
