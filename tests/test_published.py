"""Specimens of the second generator for published benchmarks: their truth is that of the generator."""

from pathlib import Path

import nibabel
import numpy as np
import pytest
from made_once import MadeOnce

from benchmarks import full_set
from benchmarks.independent.bore import drill
from benchmarks.independent.sets import recipe_of
from benchmarks.published.__main__ import digests, read_key, write_key
from benchmarks.published.specimens import FINER, Turning, turned, uneven_turns, write_scan, write_walls
from benchmarks.published.truth import even_turns
from endoct.base.errors import EndoctError
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.side_cells import segment
from endoct.modalities.ct.ct_volume import CtVolume, read_ct
from endoct.workbench import unroll
from endoct.workbench.bench.published.specimen_set import SpecimenSet, recorded_digests
from endoct.workbench.bench.task import load_task
from endoct.workbench.bench.tasks.oct import _true_error_rad
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

SEED = 40  # for tuning


@pytest.fixture(scope="module")
def specimen(made_once: MadeOnce) -> Path:
    return made_once("second_generator", lambda folder: write_walls(folder, "easy", SEED))


def test_true_cells_lie_on_the_panoramas_of_both_sides(specimen: Path) -> None:
    truth = load_truth(specimen)
    for side in ("oct", "endoscope"):
        panorama = unroll(specimen / side, progress=False)
        cells, true = segment(panorama), true_cells(truth, true_pose(panorama, truth), panorama)
        here = jaccard(cells, true, panorama.valid)
        turned_round = jaccard(cells, np.roll(true, true.shape[1] // 2, axis=1), panorama.valid)
        assert here is not None
        assert turned_round is not None
        assert here > 0.85
        assert turned_round < 0.5


def test_the_stored_wall_is_the_one_that_was_drilled(specimen: Path) -> None:
    wall = load_truth(specimen).wall
    recipe = recipe_of("few", SEED)
    bore = drill(recipe.bore, np.random.default_rng([SEED, 0]))
    theta, z = np.meshgrid(wall["theta"], wall["z"][:-1])
    assert np.array_equal(wall["cell"][:-1], bore.is_cell(theta, z))
    assert ((wall["cell_id"] > 0) == wall["cell"]).all()
    assert set(np.unique(wall["cell_id"])) == set(range(len(bore.cells) + 1))


def test_uneven_turns_are_stated_as_the_simulator_states_them() -> None:
    turns = uneven_turns(5, Turning(8.0, 0.01, 1.0), np.random.default_rng(3))
    of = {
        "n_ascans": 400,
        "lost_ascans": [],
        "turn_length": turns.length,
        "start_angle_rad": turns.start_rad,
        "rotation_error_cos_rad": turns.cosines_rad,
        "rotation_error_sin_rad": turns.sines_rad,
    }
    nominal = 2 * np.pi * np.arange(400) / 400
    for k in range(5):
        assert np.allclose(_true_error_rad(of, k, nominal), turns.angles_rad(400)[k] - nominal, atol=1e-12)
    peaks = np.abs(turns.angles_rad(400) - turns.start_rad[:, None] - nominal * turns.length[:, None]).max(axis=1)
    assert 8 / 1.25 < np.rad2deg(peaks).min() < np.rad2deg(peaks).max() < 8 * 1.25


def test_an_uneven_turn_takes_the_nearest_ascans_and_interpolates_none(specimen: Path) -> None:
    from benchmarks.independent.catheter import Pullback

    n = 50
    fine = np.tile(np.arange(FINER * n, dtype=np.uint8), (2, 3, 1))  # every A-scan is its number
    pullback = Pullback(fine, np.zeros(2), np.zeros((2, FINER * n)), np.zeros((2, 2)))
    even = turned(pullback, even_turns(2), 0.0, mirrored=False)
    assert np.array_equal(even.samples[0, 0], FINER * np.arange(n))
    turns = uneven_turns(2, Turning(8.0, 0.01, 1.0), np.random.default_rng(3))
    uneven = turned(pullback, turns, 0.5, mirrored=True)
    expected = np.mod(0.5 - turns.angles_rad(n), 2 * np.pi)
    apart = np.angle(np.exp(1j * (uneven.angle_rad - expected)))
    assert np.abs(apart).max() <= np.pi / (FINER * n) + 1e-9
    assert np.allclose(np.mod(0.5 - uneven.samples[:, 0] * (2 * np.pi / (FINER * n)), 2 * np.pi) % (2 * np.pi),
                       np.mod(uneven.angle_rad, 2 * np.pi), atol=1e-9)  # fmt: skip


def test_the_bench_judges_rotation_on_it(specimen: Path) -> None:
    task = load_task("oct")
    assert task.own is not None
    (case,) = task.own(specimen)
    scores = task.judge(case, unroll(specimen / "oct", progress=False))
    assert scores["jaccard"] > 0.85
    assert scores["within_deg"] < 0.5


def test_a_seed_gives_the_same_bytes(specimen: Path, tmp_path: Path) -> None:
    write_walls(tmp_path / "again", "easy", SEED)
    assert recorded_digests(tmp_path / "again") == recorded_digests(specimen)


def test_a_scan_is_read_where_it_lies(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    steps = np.linalg.qr(rng.normal(size=(3, 3)))[0] * np.array([[0.4], [0.3], [0.3]])  # along k, j, i
    ct = CtVolume(rng.integers(-1000, 2000, (4, 5, 6)).astype(np.int16), np.array([10.0, -20.0, 30.0]), steps, "lps")
    for name in ("one", "two"):
        write_scan(tmp_path / f"{name}.nii.gz", ct)
    assert (tmp_path / "one.nii.gz").read_bytes() == (tmp_path / "two.nii.gz").read_bytes()
    image = nibabel.load(tmp_path / "one.nii.gz")
    lps = np.diag([-1, -1, 1, 1]) @ image.affine @ np.array([5, 1, 2, 1])
    assert np.allclose(lps[:3], ct.origin_mm + np.array([2, 1, 5]) @ steps, atol=1e-4)
    assert int(image.dataobj[5, 1, 2]) == ct.voxels[2, 1, 5]
    assert read_ct(tmp_path / "one.nii.gz").voxels.size == ct.voxels.size


def test_a_key_is_written_once_and_for_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "hidden.key"
    write_key(path)
    assert path.stat().st_mode & 0o077 == 0
    assert 0 <= read_key(path) < 2**128
    with pytest.raises(FileExistsError):
        write_key(path)
    path.write_text("1234\n", encoding="ascii")
    with pytest.raises(EndoctError, match="holds no key"):
        read_key(path)


def test_what_is_published_of_a_hidden_half_tells_no_sample() -> None:
    from published_sets import entry

    facts = {"set": "endoct-bench-2", "half": "hidden", "size": "small", "key": "f" * 64, "versions": {}}
    hidden = SpecimenSet.model_validate({**facts, "specimens": (entry("s0"),)})
    assert digests(hidden)["specimens"] == {"s0": entry("s0").digest}
    assert digests(hidden)["key"] == "f" * 64
    assert "means" not in str(digests(hidden))


def test_rivals_of_a_full_set_are_counted_by_success_then_by_score(tmp_path: Path) -> None:
    higher = {"a": (0.9, 0.8), "b": (0.6, None), "c": (0.7, 0.75), "d": (None, 0.8), "e": (0.5, 0.6), "f": (0.8, 0.8)}
    lines = ["case,method,status,score.success,score.jaccard"]
    for name, scores in higher.items():
        for method, score in zip(("endoct", "other"), scores, strict=True):
            state = "declined,," if score is None else f"ok,{float(score >= 0.7)},{score}"
            lines.append(f"second-easy-{name}/oct/wall,{method},{state}")
    (tmp_path / "segmentation").mkdir()
    (tmp_path / "segmentation" / "results.csv").write_text("\n".join(lines), encoding="utf-8")
    (line,) = full_set.lines(tmp_path / "segmentation")
    # a behind, b even (neither succeeds, one has no score), c and d ahead, e ahead though neither succeeds, f even
    ours, rival = "3 of 6, 0.7 (0.5–0.9; 0.7)", "4 of 6, 0.8 (0.6–0.8; 0.75)"
    expected = (
        f"| `segmentation`, jaccard | second, oct | {ours} | `other` {rival}, ahead in 3, behind in 1, p = 0.62 |"
    )
    assert line == expected
    scored = full_set.load_definition(full_set.SET).tasks["alignment"]  # lower is better
    assert full_set.spread({"a": (True, 0.01), "b": (False, 2.0)}, scored) == "1 of 2, 1 (2–0.01; 1)"
    assert full_set.against({"a": (True, 0.01)}, {"a": (True, 0.02)}, scored) == "ahead in 0, behind in 1, p = 1"
