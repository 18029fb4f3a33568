"""Ways to score without solving the task: each scores nothing."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.bench import program as program_module
from endoct.workbench.bench.apart import apart, main, read_case, write_case
from endoct.workbench.bench.program import Program, bounded, can_hide
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Case, Declined, NotInstalled, load_task
from endoct.workbench.bench.tasks import oct as oct_task
from endoct.workbench.pipeline.truth import Truth, true_cells, true_pose


@pytest.fixture(scope="module")
def pullback(made_set: Path) -> tuple[Case[Path, Truth], Panorama]:
    """The pullback of a specimen as a case, and a sound answer to it."""
    specimen = made_set / "simulator-easy-000"
    return oct_task.own_cases(specimen)[0], load_panorama(specimen / "oct.zarr")


def test_true_cells_score_all(pullback: tuple[Case[Path, Truth], Panorama], monkeypatch: pytest.MonkeyPatch) -> None:
    """Turned by any angle, which no recording can know."""
    case, sound = pullback
    pose = true_pose(sound, case.truth)
    cells = np.roll(true_cells(case.truth, pose, sound), 100, axis=1)
    monkeypatch.setattr(oct_task, "segment", lambda _: cells)
    scores = oct_task.judge(case, replace(sound, valid=np.ones_like(sound.valid)))
    assert scores["jaccard"] > 0.97
    assert (scores["success"], scores["valid"]) == (1, 1)


def test_a_little_flat_wall_called_valid_is_no_success(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    few = np.zeros_like(sound.valid)
    few[len(few) // 2, :4] = True
    flat = np.random.default_rng(1).normal(0, 0.001, few.shape).astype(np.float32)
    scores = oct_task.judge(case, replace(sound, depth_mm=flat, valid=few))
    assert scores["success"] == 0
    assert scores["jaccard"] < 0.01  # of all samples next to none is right
    assert scores["valid"] < 0.001


def test_only_the_best_slices_are_worth_their_share(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    half = sound.valid.copy()
    half[::2] = False
    scores = oct_task.judge(case, replace(sound, valid=half))
    assert scores["jaccard"] < 0.4
    assert scores["valid"] == pytest.approx(0.5, abs=0.02)


def test_one_slice_cannot_stand_for_all(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    index = sound.per_frame["slice_index"]
    same = replace(index, values=np.full_like(index.values, 3))
    with pytest.raises(EndoctError, match="not one a slice"):
        oct_task.judge(case, replace(sound, per_frame={**sound.per_frame, "slice_index": same}))


def test_where_there_is_no_cell_nothing_succeeds(
    pullback: tuple[Case[Path, Truth], Panorama], monkeypatch: pytest.MonkeyPatch
) -> None:
    case, sound = pullback
    wall = {**case.truth.wall, "cell": np.zeros_like(case.truth.wall["cell"])}
    empty = replace(case, truth=replace(case.truth, wall=wall))
    monkeypatch.setattr(oct_task, "segment", lambda panorama: np.zeros_like(panorama.valid))
    scores = oct_task.judge(empty, replace(sound, valid=np.ones_like(sound.valid)))
    assert scores["success"] == 0
    assert np.isnan(scores["jaccard"])


def test_an_answer_is_judged_where_the_slice_was_recorded(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    """To say that the slices lie elsewhere moves no truth, and coarse columns are judged as finely as any."""
    case, sound = pullback
    z = sound.per_frame["slice_z_mm"]
    elsewhere = {**sound.per_frame, "slice_z_mm": replace(z, values=z.values + 0.5)}
    moved = oct_task.judged_samples(case.truth, replace(sound, per_frame=elsewhere))
    straight = oct_task.judged_samples(case.truth, sound)
    assert moved.true.shape == (16, oct_task.N_JUDGED)
    assert np.array_equal(moved.true, straight.true)


CHEATS = """
import json, os, pathlib, sys
import numpy as np
given, answer = map(pathlib.Path, sys.argv[1:])
found = []
def look(place):
    try:
        found.extend(str(path) for path in pathlib.Path(place).rglob("wall.zarr"))
    except OSError as error:
        print(error)
"""


def cheating(tmp_path: Path, case: Case[Path, Truth], text: str, hidden: Path) -> str:
    """Run a program on a pullback; return why it failed."""
    path = tmp_path / "cheat.py"
    path.write_text(CHEATS + text, encoding="utf-8")
    task = load_task("oct")
    assert task.exchange is not None
    command = f"{sys.executable} {path}"
    task = apart(replace(task, methods={"cheat": Program(command, task.exchange)}), ["cheat"], hidden)
    row = run_method(task, "cheat", case)
    assert row.status == "failed"
    assert row.scores == {}
    return row.reason


def test_no_truth_lies_beside_what_is_given(
    tmp_path: Path, made_set: Path, pullback: tuple[Case[Path, Truth], Panorama]
) -> None:
    text = """
recording = pathlib.Path(json.loads((given / "given.json").read_text())["recording"])
for place in (recording, recording / "..", given.parent): look(place)
sys.exit(f"found {found}, {sorted(path.name for path in recording.iterdir())}")
"""
    reason = cheating(tmp_path, pullback[0], text, made_set)
    assert "found [], ['acquisition.toml', 'pullback.tif']" in reason


needs_namespaces = pytest.mark.skipif(not can_hide(), reason="this system hides no folder from a program")


@needs_namespaces
@pytest.mark.parametrize(
    "how",
    [
        "look({data!r})",
        "look(f'/proc/{{os.getppid()}}/root' + {data!r})",
        "os.system('umount ' + {data!r} + '; mount -t tmpfs over ' + {data!r}); look({data!r})",
        "os.symlink({data!r}, answer / 'data'); look(answer / 'data')",
    ],
)
def test_the_truth_is_out_of_reach_of_who_knows_where_it_lies(
    tmp_path: Path, made_set: Path, pullback: tuple[Case[Path, Truth], Panorama], how: str
) -> None:
    text = how.format(data=str(made_set)) + "\nsys.exit(f'found {found}')"
    assert "found []" in cheating(tmp_path, pullback[0], text, made_set)


@needs_namespaces
def test_to_start_in_the_set_is_no_way_into_it(made_set: Path) -> None:
    look = ["/bin/sh", "-c", "ls truth; ls ../simulator-easy-000/truth; pwd"]
    done = subprocess.run(
        bounded(look, made_set), cwd=made_set / "simulator-easy-000", capture_output=True, check=True, text=True
    )
    assert done.stdout == "/\n"


@pytest.mark.parametrize("link", ["symlink('/etc', answer / 'panorama.zarr')", "symlink('/etc/passwd', answer / 'x')"])
def test_an_answer_is_no_link(
    tmp_path: Path, made_set: Path, pullback: tuple[Case[Path, Truth], Panorama], link: str
) -> None:
    """The judge reads where the program may not: a link could hand it the truth."""
    assert "holds a link" in cheating(tmp_path, pullback[0], f"os.{link}", made_set)


def test_memory_is_bounded(
    tmp_path: Path, made_set: Path, pullback: tuple[Case[Path, Truth], Panorama], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_module, "MOST_MEMORY_BYTES", 400_000_000)
    text = "import numpy\nprint(numpy.ones(60_000_000).sum(), file=sys.stderr)"
    assert "MemoryError" in cheating(tmp_path, pullback[0], text, made_set)


@pytest.mark.parametrize("place", ["given", "pathlib.Path(os.environ['TMPDIR'])"])
def test_what_is_written_elsewhere_counts_as_well(
    tmp_path: Path,
    made_set: Path,
    pullback: tuple[Case[Path, Truth], Panorama],
    monkeypatch: pytest.MonkeyPatch,
    place: str,
) -> None:
    monkeypatch.setattr(program_module, "MOST_BYTES", 1_000_000)
    text = f"file = ({place} / 'much').open('wb')\nwhile True: file.write(bytes(1000))"
    assert "writes too much" in cheating(tmp_path, pullback[0], text, made_set)


def test_a_case_is_copied_and_an_answer_is_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "truth").mkdir()
    (tmp_path / "oct").mkdir()
    (tmp_path / "oct" / "pullback.tif").write_text("samples", encoding="utf-8")
    (tmp_path / "ct.nii.gz").write_text("voxels", encoding="utf-8")
    given, answer = tmp_path / "given", tmp_path / "answer"
    for folder in (given, answer):
        folder.mkdir()
    write_case((tmp_path / "oct", {"ct": tmp_path / "ct.nii.gz"}, np.arange(3)), given)
    recording, named, numbers = read_case(given)  # type: ignore[misc]
    assert (recording, named) == (given / "oct", {"ct": given / "ct.nii.gz"})
    assert (given / "oct" / "pullback.tif").read_text(encoding="utf-8") == "samples"
    assert numbers.tolist() == [0, 1, 2]
    assert str(tmp_path / "oct").encode() not in (given / "case.pickle").read_bytes()


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (Declined("too dark", {"success": 1.0}), {"declined": "too dark"}),
        (NotInstalled("ashlar"), {"missing": ["ashlar", None]}),
        (ModuleNotFoundError("no", name="itk"), {"missing": ["itk", None]}),
    ],
)
def test_a_method_cannot_say_that_it_succeeded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raised: Exception, said: dict[str, object]
) -> None:
    def method(_: object) -> None:
        raise raised

    monkeypatch.setattr("endoct.workbench.bench.apart.load_method", lambda task, name: method)
    write_case(5, tmp_path)
    main("segmentation", "any", str(tmp_path), str(tmp_path))
    assert json.loads((tmp_path / "answer.json").read_text(encoding="utf-8")) == said


def test_a_method_runs_apart_as_it_does_here(made_set: Path) -> None:
    task = load_task("segmentation")
    assert task.own is not None
    case = next(one for one in task.own(made_set / "simulator-easy-000") if "oct" in one.name)
    here, there = (run_method(one, "li-depth", case) for one in (task, apart(task, ["li-depth"], made_set)))
    assert (here.status, here.scores) == (there.status, there.scores)
    assert there.seconds > here.seconds
    assert there.cpu_seconds > 0.1  # of its process
    assert "TMPDIR" not in os.environ or Path(os.environ["TMPDIR"]).name != "temporary"
