"""A data set survives whatever happens to those who make it, and to the disk."""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cheap_specimens import Cheap, contents, leftovers

from endoct.base.errors import EndoctError
from endoct.base.files.scratch import HeldError, clear_dead_scratch, held, scratch_next_to
from endoct.workbench.dataset import overview
from endoct.workbench.dataset.creation import forecast, make_dataset
from endoct.workbench.dataset.plan import DatasetPlan, Job

FOLDERS = DatasetPlan(5, seed=3)
SHARDS = DatasetPlan(13, seed=3, format="webdataset", specimens_per_shard=3)

HOLD = """
import sys
from pathlib import Path
from endoct.base.files.scratch import held, scratch_next_to
with {what}:
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def small_sheet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Show two specimens on the contact sheet, whose drawing takes longer than all else here."""
    monkeypatch.setattr(overview, "N_SPECIMENS", 2)


@pytest.fixture
def cheap(tmp_path: Path) -> Cheap:
    return Cheap(tmp_path / "log")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "set"


class Failing(Cheap):
    """Raises what is asked for while it makes one of the specimens."""

    at: int
    error: BaseException

    def __call__(self, folder: Path, plan: DatasetPlan, job: Job) -> None:
        super().__call__(folder, plan, job)
        if job.index == self.at:
            raise self.error


def failing(cheap: Cheap, at: int, error: BaseException) -> Failing:
    made = Failing(cheap.log)
    object.__setattr__(made, "at", at)
    object.__setattr__(made, "error", error)
    return made


def make(root: Path, plan: DatasetPlan, maker: Cheap) -> int:
    return make_dataset(root, plan, workers=1, make=maker).made


@pytest.mark.parametrize("plan", [FOLDERS, SHARDS], ids=["folders", "shards"])
def test_started_again_it_makes_nothing(plan: DatasetPlan, root: Path, cheap: Cheap) -> None:
    assert make(root, plan, cheap) == plan.count
    before = contents(root)
    assert {"manifest.csv", "LICENSE", "README.md", "dataset.json", "contact_sheet.png"} <= before.keys()
    assert "CC0-1.0" in (root / "LICENSE").read_text()
    assert make(root, plan, cheap) == 0
    assert contents(root) == before
    assert sorted(cheap.noted("end")) == list(range(plan.count))


@pytest.mark.parametrize("plan", [FOLDERS, SHARDS], ids=["folders", "shards"])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_interrupted_or_out_of_room_it_can_go_on(
    plan: DatasetPlan, error: BaseException, root: Path, cheap: Cheap, tmp_path: Path
) -> None:
    at = plan.count - 2
    expected = "No space left" if isinstance(error, OSError) else None
    with pytest.raises(EndoctError if expected else KeyboardInterrupt, match=expected):
        make(root, plan, failing(cheap, at, error))
    assert not leftovers(root)
    finished = set(root.glob("records/*.json"))
    assert finished
    cheap.log.unlink()
    make(root, plan, cheap)
    assert at in cheap.noted("end")
    assert 0 not in cheap.noted("begin")
    make(tmp_path / "at once", plan, cheap)
    assert contents(root) == contents(tmp_path / "at once")


def test_nothing_is_left_where_nothing_could_be_made(root: Path, cheap: Cheap) -> None:
    with pytest.raises(EndoctError, match="Read-only"):
        make(root, FOLDERS, failing(cheap, 0, OSError(errno.EROFS, "Read-only file system")))
    assert not root.exists()


def test_a_specimen_that_cannot_be_made_is_named(root: Path, cheap: Cheap) -> None:
    with pytest.raises(EndoctError, match=r"specimen 2 \(seed \d+, bore seed \d+\) cannot be made: no bone"):
        make(root, FOLDERS, failing(cheap, 2, EndoctError("no bone")))


def test_what_is_damaged_is_made_again(root: Path, cheap: Cheap) -> None:
    make(root, FOLDERS, cheap)
    before = contents(root)
    with (root / "specimens/000001/oct/pullback.tif").open("ab") as file:
        file.write(b"x")
    (root / "specimens/000002/truth/sample.json").unlink()
    shutil.rmtree(root / "specimens/000003")
    (root / "records/000004.json").write_text("{")
    cheap.log.unlink()
    assert make(root, FOLDERS, cheap) == 4
    assert cheap.noted("end") == [1, 2, 3, 4]
    assert contents(root) == before


def flip(path: Path) -> bytes:
    """Change one bit; neither size nor name tell of it."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    return bytes(data)


def test_a_flipped_bit_is_found_and_what_was_there_is_kept(root: Path, cheap: Cheap) -> None:
    make(root, FOLDERS, cheap)
    before = contents(root)
    flipped = flip(root / "specimens/000001/oct/pullback.tif")
    (root / "specimens/000002/truth/more").unlink()
    (root / "specimens/000002/notes.txt").write_text("mine")
    shutil.copytree(root / "specimens/000003", root / "specimens/000003/copy")
    built = make_dataset(root, FOLDERS, workers=1, make=cheap)
    assert (built.made, built.set_aside) == (2, 2)
    changed = {name: data for name, data in contents(root).items() if "000003/copy" not in name}
    assert changed == before
    assert (root / "specimens/000003/copy/oct/pullback.tif").exists()  # of no concern where all else is whole
    assert (root / "damaged/000001.kept-1/oct/pullback.tif").read_bytes() == flipped
    assert (root / "damaged/000002.kept-1/notes.txt").read_text() == "mine"


def test_a_flipped_bit_in_a_shard_is_found_and_what_was_there_is_kept(root: Path, cheap: Cheap) -> None:
    make(root, SHARDS, cheap)
    before = contents(root)
    flipped = flip(root / "shards/train-000001.tar")
    built = make_dataset(root, SHARDS, workers=1, make=cheap)
    assert (built.made, built.set_aside) == (3, 1)
    assert contents(root) == before
    assert (root / "damaged/train-000001.tar.kept-1").read_bytes() == flipped


def test_what_somebody_writes_at_the_top_of_a_set_is_kept(root: Path, cheap: Cheap) -> None:
    make(root, FOLDERS, cheap)
    (root / "README.md").write_text("what I found out")
    (root / "thesis.tex").write_text("years of work")
    (root / "manifest.csv").write_text("index,my own column\n")
    make(root, DatasetPlan(**vars(FOLDERS) | {"count": 6}), cheap)
    assert (root / "README.md.kept-1").read_text() == "what I found out"
    assert (root / "manifest.csv.kept-1").read_text() == "index,my own column\n"
    assert (root / "thesis.tex").read_text() == "years of work"
    assert len((root / "manifest.csv").read_text().splitlines()) == 7
    make(root, DatasetPlan(**vars(FOLDERS) | {"count": 7}), cheap)
    assert not (root / "README.md.kept-2").exists()


@pytest.mark.parametrize("record", ["{", "[]", '{"files": {"../../thesis.tex": [1, "x"]}}', "[" * 100_000, "9" * 9_000])
def test_a_damaged_record_leads_nowhere_else(record: str, root: Path, cheap: Cheap, tmp_path: Path) -> None:
    make(root, FOLDERS, cheap)
    before = contents(root)
    (tmp_path / "thesis.tex").write_text("x")
    (root / "records/000001.json").write_text(record)
    assert make(root, FOLDERS, cheap) == 1
    assert contents(root) == before
    assert (tmp_path / "thesis.tex").read_text() == "x"


@pytest.mark.parametrize(("plan", "extra"), [(FOLDERS, 3), (SHARDS, 9)], ids=["folders", "shards"])
def test_a_set_grows_and_keeps_what_it_has(
    plan: DatasetPlan, extra: int, root: Path, cheap: Cheap, tmp_path: Path
) -> None:
    more = DatasetPlan(**vars(plan) | {"count": plan.count + extra})
    make(root, plan, cheap)
    cheap.log.unlink()
    assert make(root, more, cheap) == extra
    assert sorted(cheap.noted("begin")) == list(range(plan.count, plan.count + extra))
    make(tmp_path / "at once", more, cheap)
    assert contents(root) == contents(tmp_path / "at once")
    with pytest.raises(EndoctError, match="more specimens"):
        make(root, plan, cheap)


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 4},
        {"preset": "quick"},
        {"ranges": {"oct.wall_db": (6.0, 14.0)}},
        {"format": "webdataset"},
        {"labels": True},
        {"recordings_per_bore": 2},
    ],
)
def test_other_arguments_are_refused(other: dict[str, object], root: Path, cheap: Cheap) -> None:
    make(root, FOLDERS, cheap)
    before = contents(root)
    with pytest.raises(EndoctError, match="begun with another"):
        make(root, DatasetPlan(**vars(FOLDERS) | {"specimens_per_shard": 0} | other), cheap)
    assert contents(root) == before


def test_another_simulator_is_refused(root: Path, cheap: Cheap) -> None:
    make(root, FOLDERS, cheap)
    path = root / "dataset.json"
    path.write_text(path.read_text().replace('"simulator": "', '"simulator": "0'))
    with pytest.raises(EndoctError, match="another version of simulator"):
        make(root, FOLDERS, cheap)


def test_hidden_files_depend_on_the_set_alone(root: Path, cheap: Cheap, tmp_path: Path) -> None:
    make(root, FOLDERS, cheap)
    grown = DatasetPlan(**vars(FOLDERS) | {"count": FOLDERS.count + 1})
    make(root, grown, cheap)
    make(tmp_path / "at once", grown, cheap)
    for name in (".lock", ".written.json"):
        assert (root / name).read_bytes() == (tmp_path / "at once" / name).read_bytes()
    assert (root / ".lock").read_bytes() == b""


def test_a_folder_with_empty_folders_of_a_set_that_was_removed_is_taken(root: Path, cheap: Cheap) -> None:
    (root / "specimens" / ".endoct-000000-x").mkdir(parents=True)
    assert make(root, FOLDERS, cheap) == FOLDERS.count


def test_a_folder_that_holds_something_else_is_refused(root: Path, cheap: Cheap) -> None:
    root.mkdir()
    (root / "thesis.tex").write_text("")
    with pytest.raises(EndoctError, match=r"something else.*thesis\.tex"):
        make(root, FOLDERS, cheap)
    assert [path.name for path in root.iterdir()] == ["thesis.tex"]


@pytest.fixture
def elsewhere() -> Iterator[list[subprocess.Popen[str]]]:
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        process.kill()
        process.communicate()


def hold(code: str, processes: list[subprocess.Popen[str]]) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD.format(what=code)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    processes.append(process)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_two_runs_at_once_are_refused_until_one_is_dead(
    root: Path, cheap: Cheap, elsewhere: list[subprocess.Popen[str]]
) -> None:
    make(root, FOLDERS, cheap)
    other = hold(f"held(Path({str(root / '.lock')!r}))", elsewhere)
    with pytest.raises(EndoctError, match=f"at work.*process {other.pid} on"):
        make(root, FOLDERS, cheap)
    other.kill()
    other.wait()
    assert make(root, FOLDERS, cheap) == 0


def test_scratch_of_the_dead_is_cleared_and_of_the_living_kept(
    root: Path, cheap: Cheap, elsewhere: list[subprocess.Popen[str]]
) -> None:
    make(root, FOLDERS, cheap)
    other = hold(f"scratch_next_to(Path({str(root / 'specimens' / '000009')!r}))", elsewhere)
    (scratch,) = leftovers(root)
    make(root, FOLDERS, cheap)
    assert scratch.exists()
    other.kill()
    other.wait()
    assert scratch.exists()
    make(root, FOLDERS, cheap)
    assert not leftovers(root)


def test_a_lock_is_held_once_and_released(tmp_path: Path) -> None:
    with held(tmp_path / "lock"), pytest.raises(HeldError, match=str(os.getpid())), held(tmp_path / "lock"):
        pass
    with held(tmp_path / "lock"):
        pass
    with scratch_next_to(tmp_path / "a" / "b"):
        assert clear_dead_scratch(tmp_path) == 0


def test_a_full_disk_is_told_and_the_set_resumed(small_disk: Path, cheap: Cheap) -> None:
    large = Cheap(cheap.log, extra_bytes=200_000)
    with pytest.raises(EndoctError, match=r"disk/set cannot be written; found No space left on device; .*start again"):
        make(small_disk / "set", FOLDERS, large)
    assert not leftovers(small_disk / "set")
    kept = len(list((small_disk / "set" / "records").iterdir()))
    assert 0 < kept < FOLDERS.count
    subprocess.run(["mount", "-o", "remount,size=4m", str(small_disk)], check=True)
    assert make(small_disk / "set", FOLDERS, large) == FOLDERS.count - kept


def test_a_read_only_disk_is_told(small_disk: Path, cheap: Cheap) -> None:
    make(small_disk / "set", FOLDERS, cheap)
    shutil.rmtree(small_disk / "set" / "specimens" / "000001")
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    for name in ("set", "new set"):
        with pytest.raises(EndoctError, match="cannot be written; found Read-only file system"):
            make(small_disk / name, FOLDERS, cheap)
    subprocess.run(["mount", "-o", "remount,rw", str(small_disk)], check=True)
    assert make(small_disk / "set", FOLDERS, cheap) == 1


def test_a_dry_run_reckons_and_writes_nothing(root: Path, cheap: Cheap) -> None:
    reckoned = forecast(root, FOLDERS, workers=2, make=cheap)
    assert not root.exists()
    make(root, FOLDERS, cheap)
    # cheap specimens are of one size but for the compressed truth and what zarr writes of it
    size = sum(path.stat().st_size for path in (root / "specimens").rglob("*") if path.is_file())
    assert reckoned.bytes == pytest.approx(size, rel=0.05)
    assert reckoned.missing == FOLDERS.count
    assert reckoned.files == sum(
        path.is_file() for part in ("specimens", "records") for path in (root / part).rglob("*")
    )
    assert forecast(root, FOLDERS, workers=2, make=cheap).missing == 0


@pytest.mark.parametrize(("plan", "fewer"), [(FOLDERS, 3), (SHARDS, 10)], ids=["folders", "shards"])
def test_an_interrupted_set_may_end_with_what_was_made(
    plan: DatasetPlan, fewer: int, root: Path, cheap: Cheap, tmp_path: Path
) -> None:
    less = DatasetPlan(**vars(plan) | {"count": fewer})
    with pytest.raises(KeyboardInterrupt):
        make(root, plan, failing(cheap, 2, KeyboardInterrupt()))
    make(root, less, cheap)
    make(tmp_path / "at once", less, cheap)
    assert contents(root) == contents(tmp_path / "at once")


@pytest.mark.parametrize(
    ("plan", "fewer", "made"), [(FOLDERS, 2, "000002"), (SHARDS, 2, "train-000000")], ids=["folders", "shards"]
)
def test_a_set_does_not_shrink_below_what_was_made(
    plan: DatasetPlan, fewer: int, made: str, root: Path, cheap: Cheap
) -> None:
    with pytest.raises(KeyboardInterrupt):
        make(root, plan, failing(cheap, 4, KeyboardInterrupt()))
    before = contents(root)
    with pytest.raises(EndoctError, match=f"holds more specimens already; found --count {fewer}, and .*{made}.* made"):
        make(root, DatasetPlan(**vars(plan) | {"count": fewer}), cheap)
    assert contents(root) == before
