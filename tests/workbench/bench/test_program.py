"""Methods that are programs: what they are given, what they may answer, and how they fail."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from bench_tasks import DOUBLING
from processes import has_ended

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.workbench.bench.cases.toy_walls import toy_panorama
from endoct.workbench.bench.program import Program, _size, parse_programs, with_programs
from endoct.workbench.bench.task import Case, Declined, load_task
from endoct.workbench.bench.tasks.alignment import AlignmentCase
from endoct.workbench.bench.tasks.pose import Located
from endoct.workbench.bench.tasks.stitching import StripPoses

CONDITIONS = {"signal_db": 25.0, "cell_mm": 0.8, "fill": 0.2, "missing": 0.2, "unevenness": 0.2}
BEGINNING = """
import json, pathlib, sys
import numpy as np
given, answer = map(pathlib.Path, sys.argv[1:])
facts = json.loads((given / "given.json").read_text()) if (given / "given.json").exists() else {}
def tell(**values): (answer / "answer.json").write_text(json.dumps(values))
"""


def program(tmp_path: Path, task: str, text: str) -> Program:
    exchange = load_task(task).exchange
    assert exchange is not None
    path = tmp_path / "a program.py"
    path.write_text(BEGINNING + text, encoding="utf-8")
    return Program(f"{sys.executable} '{path}'", exchange)


def test_a_mask_returns_as_it_was_written(tmp_path: Path) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    method = program(
        tmp_path,
        "segmentation",
        "mask = (np.load(given / 'depth_mm.npy') > 0.1) & np.load(given / 'valid.npy')\n"
        "assert len(facts['z_mm']), len(facts['theta_rad']) == mask.shape\n"
        "np.save(answer / 'mask.npy', mask.astype(np.uint8))",
    )
    assert np.array_equal(method(panorama), (panorama.depth_mm > 0.1) & panorama.valid)


@pytest.mark.parametrize("modality", ["depth", "intensity"])
def test_the_manuals_program_runs(tmp_path: Path, modality: str) -> None:
    page = (Path(__file__).parents[3] / "docs" / "how-to" / "bench.md").read_text(encoding="utf-8")
    (tmp_path / "mine.py").write_text(page.partition("mine.py: ")[2].join(['"""', ""]).partition("```")[0], "utf-8")
    panorama, truth = toy_panorama(3, 0, modality, CONDITIONS)
    exchange = load_task("segmentation").exchange
    assert exchange is not None
    cells = Program(f"{sys.executable} {tmp_path / 'mine.py'}", exchange)(panorama)
    true = truth & panorama.valid
    assert (cells & true).sum() / (cells | true).sum() > 0.5


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("print('no wall at all'); sys.exit(3)", "exit status 3.*no wall at all"),
        ("raise ValueError('a column too many')", "exit status 1.*a column too many"),
        ("print('no such image\\n\\nRun x run --help'); sys.exit(125)", "exit status 125.*no such image"),
        ("print('try --help'); sys.exit(2)", "exit status 2.*try --help"),
        ("pass", "no mask.npy"),
        ("np.save(answer / 'mask.npy', np.ones((2, 3), bool))", "no mask"),
        ("np.save(answer / 'mask.npy', np.ones(np.load(given / 'valid.npy').shape))", "no mask"),
    ],
)
def test_a_program_that_fails_says_how(tmp_path: Path, text: str, match: str) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    with pytest.raises(EndoctError, match=match):
        program(tmp_path, "segmentation", text)(panorama)


def test_a_program_that_prints_and_prints_or_writes_and_writes_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    monkeypatch.setattr("endoct.workbench.bench.program.MOST_BYTES", 1_000_000)
    for text in (
        "while True: print('x' * 1000)",
        "file = (answer / 'mask.npy').open('wb')\nwhile True: file.write(bytes(1000))",
    ):
        with pytest.raises(EndoctError, match="writes too much"):
            program(tmp_path, "segmentation", text)(panorama)


def test_folders_that_come_and_go_meanwhile_do_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "gone").mkdir()
    (tmp_path / "kept" / "mask.npy").write_bytes(bytes(1_000_000))
    listing = os.scandir

    def removed(path: str | Path) -> object:
        if Path(path).name == "gone":
            raise FileNotFoundError(2, "No such file or directory", str(path))
        return listing(path)

    monkeypatch.setattr(os, "scandir", removed)
    assert 1_000_000 <= _size(tmp_path) < 1_100_000


def test_a_program_without_an_end_is_ended_with_all_that_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    monkeypatch.setattr("endoct.workbench.bench.program.LONGEST_S", 4.0)
    child = tmp_path / "child"
    text = (
        "import subprocess, time\nchild = subprocess.Popen(['sleep', '600'])\n"
        f"pathlib.Path({str(child)!r}).write_text(str(child.pid))\ntime.sleep(600)"
    )
    with pytest.raises(EndoctError, match="takes too long"):
        program(tmp_path, "segmentation", text)(panorama)
    assert has_ended(int(child.read_text()))


def test_a_program_has_a_name_of_its_own() -> None:
    for name in ("endoct", "li-depth"):
        with pytest.raises(EndoctError, match=f"cannot be called '{name}'"):
            with_programs(load_task("segmentation"), {name: "true"})


def test_a_program_may_decline(tmp_path: Path) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    with pytest.raises(Declined, match="too dark"):
        program(tmp_path, "segmentation", "tell(declined='too dark')")(panorama)


def test_an_alignment_is_read_from_numbers(tmp_path: Path, easy: AlignmentCase) -> None:
    method = program(
        tmp_path,
        "alignment",
        "shape = np.load(given / 'a' / 'intensity.npy').shape\n"
        "tell(theta_shift_rad=1.5, z_shift_mm=shape[0] / 1000, z_scale=1.01, mirrored=True)",
    )
    expected = Alignment(1.5, easy.given[0].grid.n_z / 1000, 1.01, mirrored=True)
    assert method(*easy.given) == expected
    with pytest.raises(EndoctError, match="z_scale"):
        program(tmp_path, "alignment", "tell(theta_shift_rad=1, z_shift_mm=0, z_scale='wide')")(*easy.given)


def test_places_of_strips_are_read(tmp_path: Path) -> None:
    task = load_task("stitching")
    numbers = {name: (range_[0], range_[0]) for name, range_ in task.ranges.items() if name != "recipe"}
    case: Case[tuple[object, ...], object] = task.cases(5, 0, {"recipe": ("made",), **numbers})
    method = program(
        tmp_path,
        "stitching",
        "n = len(np.load(given / 'intensity.npy'))\n"
        "tell(z_mm=[facts['nominal_pitch_mm'] * k for k in range(n)], roll_rad=[0] * n)",
    )
    answer = method(*case.given)
    assert isinstance(answer, StripPoses)
    assert answer.trusted.all()
    assert task.judge(case, answer)["right"] == 1.0  # no jitter, no roll: the nominal pitch is the truth


def test_a_pullback_is_read_from_depth(tmp_path: Path, quick_specimen: Path) -> None:
    method = program(
        tmp_path,
        "oct",
        "assert (pathlib.Path(facts['recording']) / 'acquisition.toml').is_file()\n"
        "depth = np.zeros((3, 50)); depth[1, 40:] = depth[1, :5] = 0.2; depth[2, 0] = np.nan\n"
        "np.save(answer / 'depth_mm.npy', depth)\n"
        "tell(slice_index=[4, 3, 2], slice_z_mm=[0.0, 0.2, 0.5])",
    )
    panorama = method(quick_specimen / "oct")
    assert panorama.grid.shape == (3, 50)  # type: ignore[attr-defined]
    assert panorama.z_mm.tolist() == [0.0, 0.2, 0.5]  # type: ignore[attr-defined]
    assert np.argwhere(~panorama.valid).tolist() == [[2, 0]]  # type: ignore[attr-defined]
    (case,) = load_task("oct").own(quick_specimen)  # type: ignore[misc]
    assert 0 <= load_task("oct").judge(case, panorama)["jaccard"] <= 1


def test_a_located_side_is_read(tmp_path: Path) -> None:
    panorama, _ = toy_panorama(3, 0, "depth", CONDITIONS)
    steps = np.diag([0.5, 0.3, 0.2])  # along k, j, i
    ct = CtVolume(np.arange(24, dtype=np.int16).reshape(2, 3, 4), np.array([1.0, 2.0, 3.0]), steps, "lps")
    method = program(
        tmp_path,
        "pose",
        "voxels, to_lps = np.load(given / 'ct.npy'), np.array(facts['ct_to_lps'])\n"
        "last = to_lps @ np.append(np.array(voxels.shape) - 1, 1)\n"
        "assert (given / '0' / 'depth_mm.npy').exists()\n"
        "tell(sides=[dict(ends_mm=[facts['entry_mm'], last[:3].tolist()], zero=[0, 1, 0]), None])",
    )
    plan = Trajectory((0.0, 0.0, 0.0), (0.0, 0.0, 9.0))
    located = method((panorama, panorama), ct, plan)
    assert isinstance(located, Located)
    assert located.sides[1] is None
    assert located.sides[0] is not None
    assert np.allclose(located.sides[0].ends_mm, [[0, 0, 0], [1 + 0.5, 2 + 0.6, 3 + 0.6]])
    for answer in ("sides=[None]", "sides=[dict(ends_mm=[[0, 0, 0]], zero=[0, 1, 0]), None]"):
        with pytest.raises(EndoctError, match="answer"):
            program(tmp_path, "pose", f"tell({answer})")((panorama, panorama), ct, plan)


@pytest.mark.parametrize("texts", [("mine",), ("mine=",), ("=x",), ("a=x", "a=y")])
def test_a_program_needs_a_name_and_a_command(texts: tuple[str, ...]) -> None:
    with pytest.raises(EndoctError, match="NAME=COMMAND"):
        parse_programs(texts)


def test_tasks_without_files_and_broken_commands_are_refused() -> None:
    assert parse_programs(("mine=run --fast a=b",)) == {"mine": "run --fast a=b"}
    with pytest.raises(EndoctError, match="cannot be given"):
        with_programs(DOUBLING, {"mine": "run"})
    with pytest.raises(EndoctError, match="cannot be read"):
        with_programs(load_task("segmentation"), {"mine": "run 'half"})
    with pytest.raises(EndoctError, match="cannot be run"):
        with_programs(load_task("segmentation"), {"mine": "no-such-program-here"}).methods["mine"](
            toy_panorama(3, 0, "depth", CONDITIONS)[0]
        )
