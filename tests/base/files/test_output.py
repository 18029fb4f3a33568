"""Outputs appear whole or not at all, and replace nothing but what endoct wrote."""

import errno
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from endoct.base.errors import EndoctError
from endoct.base.files.contents import NAME, check_intact, differences, read_contents, write_marked
from endoct.base.files.output import check_output, new_output, remove_output
from endoct.base.files.scratch import TemporaryFolder

KIND = "comparison"
REFUSED = "was not written by endoct|holds more than endoct wrote|holds something else"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def tree(folder: Path) -> dict[str, str]:
    """Everything below a folder: the text of files, where links lead."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"-> {path.readlink()}"
        elif path.is_file():
            found[name] = path.read_text()
    return found


def write(path: Path, text: str, **options: bool) -> None:
    with new_output(path, KIND, **options) as scratch:
        scratch.mkdir()
        (scratch / "inside").mkdir()
        (scratch / "inside" / "file").write_text(text)


def test_a_file_and_a_folder_appear_at_the_end(tmp_path: Path) -> None:
    with new_output(tmp_path / "deep" / "file.txt", "text") as scratch:
        scratch.write_text("whole")
        assert not (tmp_path / "deep" / "file.txt").exists()
    write(tmp_path / "folder", "whole")
    assert (tmp_path / "deep" / "file.txt").read_text() == "whole"
    assert (tmp_path / "folder" / "inside" / "file").read_text() == "whole"
    assert names(tmp_path) == ["deep", "folder"]
    assert names(tmp_path / "deep") == ["file.txt"]
    assert names(tmp_path / "folder") == [NAME, "inside"]


def test_an_existing_output_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(EndoctError, match=r"exists already.*overwrite=True"), new_output(tmp_path / "out", KIND):
        pytest.fail("the work began")
    assert (tmp_path / "out").read_text() == "mine"


def test_overwriting_replaces_a_folder_whole(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    with new_output(tmp_path / "out", KIND, overwrite=True) as scratch:
        scratch.mkdir()
        (scratch / "new").write_text("new")
        assert (tmp_path / "out" / "inside" / "file").read_text() == "old"  # it stands until the new one is whole
    assert names(tmp_path / "out") == [NAME, "new"]
    assert names(tmp_path) == ["out"]


def _add(path: str) -> Callable[[Path], None]:
    def add(out: Path) -> None:
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        (out / path).write_text("mine")

    return add


def _edit(out: Path) -> None:
    (out / "inside" / "file").write_text("with notes of mine")


def _own_folder(out: Path) -> None:
    shutil.rmtree(out)
    _add("thesis.tex")(out)


def _no_manifest(out: Path) -> None:
    (out / NAME).unlink()


def _broken_manifest(out: Path) -> None:
    (out / NAME).write_text("{")


def _other_kind(out: Path) -> None:
    text = (out / NAME).read_text()
    (out / NAME).write_text(text.replace(KIND, "specimen"))


def _link(out: Path) -> None:
    (out / "inside" / "link").symlink_to(out.parent)


def _link_for_file(out: Path) -> None:
    (out.parent / "elsewhere").write_text("old")
    (out / "inside" / "file").unlink()
    (out / "inside" / "file").symlink_to(out.parent / "elsewhere")


def _file(out: Path) -> None:
    shutil.rmtree(out)
    out.write_text("mine")


FOREIGN: dict[str, Callable[[Path], None]] = {
    "a folder of the user's": _own_folder,
    "a file added": _add("notes.txt"),
    "a file added below": _add("inside/notes.txt"),
    "a hidden file added": _add(".notes"),
    "a folder added": _add("mine/notes.txt"),
    "a nested folder that says it is an output": _add(f"mine/{NAME}"),
    "a file changed": _edit,
    "no manifest": _no_manifest,
    "a broken manifest": _broken_manifest,
    "another kind": _other_kind,
    "a link added": _link,
    "a link in place of a file": _link_for_file,
    "a file of the user's": _file,
}


@pytest.mark.parametrize("change", FOREIGN.values(), ids=FOREIGN.keys())
def test_nothing_foreign_is_replaced(change: Callable[[Path], None], tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    change(tmp_path / "out")
    before = tree(tmp_path)
    with pytest.raises(EndoctError, match=rf"{REFUSED}|is damaged") as caught:
        write(tmp_path / "out", "new", overwrite=True)
    assert "\n" not in str(caught.value)
    assert tree(tmp_path) == before
    remove_output(tmp_path / "out", KIND)
    assert tree(tmp_path) == before


def test_what_is_missing_and_what_file_managers_leave_stand_in_nobodys_way(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    (tmp_path / "out" / "inside" / "file").unlink()
    (tmp_path / "out" / ".DS_Store").write_text("")
    (tmp_path / "out" / "inside" / "._file").write_text("")
    write(tmp_path / "out", "new", overwrite=True)
    assert tree(tmp_path / "out")["inside/file"] == "new"
    assert names(tmp_path) == ["out"]
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", "new", overwrite=True)


def test_places_that_no_output_may_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = tmp_path / "study"
    (study / "oct").mkdir(parents=True)
    (study / "oct" / "pullback.tif").write_text("samples")
    (study / "other patient").write_text("samples")
    (tmp_path / "way").symlink_to(study / "oct")
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing")
    (tmp_path / "round").symlink_to(tmp_path / "round")
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(home)
    before = tree(tmp_path)
    for path, source, said in (
        (study, study / "oct", "is or contains the input"),
        (study / "oct", study / "oct", "is or contains the input"),
        (study / "oct" / "pullback.tif", study / "oct", "lies inside the input"),
        (study / "oct" / "x.zarr", study / "oct", "lies inside the input"),
        (study / "oct" / "a" / "x.zarr", study / "oct", "lies inside the input"),
        (tmp_path / "way", study / "oct", "is or contains the input"),
        (tmp_path / "way" / "x.zarr", study / "oct", "lies inside the input"),
        (study / "oct" / "x.zarr", tmp_path / "way", "lies inside the input"),
        (study / "oct", study / "oct" / "pullback.tif", "is or contains the input"),
        (Path(), study, "present folder"),
        (Path(".."), study, "present folder"),
        (home, study, "present folder"),
        (Path("/"), study, "present folder|is or contains"),
        (Path("/proc"), study, "mounted"),
        (tmp_path / "nowhere", study, "a link to nothing"),
        (tmp_path / "round", study, "a link to nothing|cannot be written"),
    ):
        for overwrite in (True, False):
            with (
                pytest.raises(EndoctError, match=said),
                new_output(path, KIND, overwrite=overwrite, inputs=[source]),
            ):
                pytest.fail("the work began")
    assert tree(tmp_path) == before
    monkeypatch.chdir("/")
    with pytest.raises(EndoctError, match="your home folder"):
        check_output(home, KIND, overwrite=True)
    with pytest.raises(EndoctError, match="your home folder"):
        check_output(tmp_path, KIND, overwrite=True)


def test_through_a_link_the_output_is_written_where_it_leads(tmp_path: Path) -> None:
    write(tmp_path / "disk" / "out", "old")
    (tmp_path / "out").symlink_to(tmp_path / "disk" / "out")
    write(tmp_path / "out", "new", overwrite=True)
    assert (tmp_path / "out").is_symlink()
    assert tree(tmp_path / "disk" / "out")["inside/file"] == "new"


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, EndoctError, ValueError, SystemExit])
def test_nothing_is_left_behind(tmp_path: Path, interruption: type[BaseException]) -> None:
    write(tmp_path / "out", "old")

    def work(path: Path) -> None:
        with new_output(path, KIND, overwrite=True) as scratch:
            scratch.mkdir()
            (scratch / "half").write_text("half")
            raise interruption("stop")

    for path in (tmp_path / "out", tmp_path / "deep" / "er" / "out"):
        with pytest.raises(interruption):
            work(path)
        assert names(tmp_path) == ["out"]
        assert tree(tmp_path / "out")["inside/file"] == "old"


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="No space left"), new_output(tmp_path / "out", KIND):
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(EndoctError, match="cannot be written"), new_output(tmp_path / "file" / "out", KIND):
        pytest.fail("the work began")


@pytest.mark.parametrize("there", ["nothing", "old"])
@pytest.mark.parametrize("kind", ["file", "folder", "another run's", "file within"])
def test_what_somebody_puts_there_meanwhile_stays_and_so_does_the_new_one(
    there: str, kind: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    if there == "old":
        write(out, "old")

    def somebody() -> None:
        if kind == "file within":
            out.mkdir(exist_ok=True)
            (out / "notes").write_text("mine")
            return
        if out.exists():
            out.rename(tmp_path / "moved")
        if kind == "file":
            out.write_text("mine")
        elif kind == "folder":
            _add("notes")(out)
        else:
            write(out, "another")

    before: list[object] = []

    def work() -> None:
        with new_output(out, KIND, overwrite=True) as scratch:
            scratch.mkdir()
            (scratch / "file").write_text("new")
            somebody()
            before.append(tree(out) or out.read_text())

    with pytest.raises(EndoctError, match=r"could not become .*out.*is kept in .*out\.kept-1") as caught:
        work()
    assert "\n" not in str(caught.value)
    assert [tree(out) or out.read_text()] == before
    assert tree(tmp_path / "out.kept-1")["file"] == "new"
    check_intact(tmp_path / "out.kept-1")
    assert not [name for name in names(tmp_path) if name.startswith(".")]


# every system call by which an output comes to its place; each fails, and each is the last one of a killed process
CALLS = ("mkdir", "rmdir", "rename", "replace", "link", "unlink", "fsync", "open", "scandir", "stat")

CHILD = """
import os, sys
from pathlib import Path
from endoct.base.files import scratch as exchange
from endoct.base.files.output import new_output

at, how, plain, out = int(sys.argv[1]), sys.argv[2], sys.argv[3] == "plain", Path(sys.argv[4])
if plain:
    exchange._renameat2 = lambda *_: False
count = 0

def watched(function):
    def call(*arguments, **options):
        global count
        count += 1
        if count == at:
            if how == "kill before":
                os._exit(9)
            if how == "error":
                raise OSError(5, "Input/output error")
            if how == "kill after":
                function(*arguments, **options)
                os._exit(9)
            if how == "interrupt":
                import signal
                signal.raise_signal(signal.SIGINT)
        return function(*arguments, **options)
    return call

with new_output(out, "comparison", overwrite=True) as scratch:
    scratch.mkdir()
    (scratch / "inside").mkdir()
    (scratch / "inside" / "file").write_text("new")
    for name in {calls!r}:
        setattr(os, name, watched(getattr(os, name)))
    exchange._renameat2 = watched(exchange._renameat2)
print("done", count)
"""


def tried(out: Path, at: int, how: str, plain: str) -> tuple[int, str]:
    child = subprocess.run(
        [sys.executable, "-c", CHILD.replace("{calls!r}", repr(CALLS)), str(at), how, plain, str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return child.returncode, child.stdout


def standing(folder: Path) -> Iterator[str]:
    """The texts of all whole outputs in a folder, hidden ones not."""
    for path in folder.iterdir():
        contents = None if path.name.startswith(".") else read_contents(path)
        if contents is not None and not str(differences(path, contents)):
            yield (path / "inside" / "file").read_text()


@pytest.mark.parametrize("plain", ["exchange", "plain"])
@pytest.mark.parametrize("how", ["kill before", "error"])
def test_at_some_calls_on_the_way_the_old_or_the_new_stands(how: str, plain: str, tmp_path: Path) -> None:
    _fail_at_each_call(how, plain, tmp_path, every=9)


@pytest.mark.slow
@pytest.mark.parametrize("plain", ["exchange", "plain"])
@pytest.mark.parametrize("how", ["kill before", "kill after", "error", "interrupt"])
def test_at_every_call_on_the_way_the_old_or_the_new_stands(how: str, plain: str, tmp_path: Path) -> None:
    _fail_at_each_call(how, plain, tmp_path, every=1)


def _fail_at_each_call(how: str, plain: str, tmp_path: Path, *, every: int) -> None:
    at = 0
    while True:
        at += every
        folder = tmp_path / str(at)
        write(folder / "out", "old")
        status, said = tried(folder / "out", at, how, plain)
        write(folder / "next", "unrelated")
        if plain == "plain" and how.startswith("kill"):  # what was moved aside comes back with the next run
            with pytest.raises(EndoctError, match="exists already"):
                write(folder / "out", "", overwrite=False)
        whole = sorted(standing(folder))
        assert set(whole) & {"old", "new"}, (at, whole, names(folder))
        assert (folder / "out").exists(), (at, names(folder))
        check_intact(folder / "out")
        assert (folder / "out" / "inside" / "file").read_text() in ("old", "new")
        write(folder / "out", "newest", overwrite=True)
        assert (folder / "out" / "inside" / "file").read_text() == "newest"
        assert not [name for name in names(folder) if name.startswith(".")], (at, names(folder))
        if status == 0 and int(said.split()[1]) < at:
            break
    assert at > 20


def test_what_an_output_holds_is_checked(tmp_path: Path) -> None:
    with new_output(tmp_path / "out", KIND) as scratch:
        scratch.mkdir()
        (scratch / "file").write_text("whole")
        write(scratch / "figures", "drawn")
        write_marked("<p>page", scratch / "report.html")
    check_intact(tmp_path / "out")
    contents = read_contents(tmp_path / "out")
    assert contents is not None
    assert list(contents.files) == ["file"]
    assert contents.parts == {"figures": KIND, "report.html": "page"}
    write(tmp_path / "out" / "figures", "drawn anew", overwrite=True)  # a part may be written again
    check_intact(tmp_path / "out")
    (tmp_path / "out" / "figures" / "inside" / "file").write_text("forged")
    written = tmp_path / "out" / "report.html"
    write_marked("<p>page", written)
    written.write_text(written.read_text().replace("page", "forgery"))
    (tmp_path / "out" / "file").unlink()
    (tmp_path / "out" / "more").write_text("")
    found = differences(tmp_path / "out", contents)
    assert found.altered == ("figures/inside/file", "report.html")
    assert found.missing == ("file",)
    assert found.added == ("more",)
    with pytest.raises(EndoctError, match=r"found file missing"):
        check_intact(tmp_path / "out")
    check_intact(tmp_path / "out", lambda name: name != "file")


def test_a_manifest_that_names_places_elsewhere_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    (tmp_path / "thesis").write_text("mine")
    text = (tmp_path / "out" / NAME).read_text()
    (tmp_path / "out" / NAME).write_text(text.replace("inside/file", "../thesis"))
    with pytest.raises(EndoctError, match="names a place outside"):
        write(tmp_path / "out", "new", overwrite=True)
    assert (tmp_path / "thesis").read_text() == "mine"


def test_scratch_of_the_living_is_left_alone(tmp_path: Path) -> None:
    with new_output(tmp_path / "out", KIND) as scratch:
        scratch.mkdir()
        (scratch / "file").write_text("first")
        write(tmp_path / "out", "second")  # another run that is quicker
        assert (scratch / "file").read_text() == "first"
        (tmp_path / "out").rename(tmp_path / "other")
    assert tree(tmp_path / "out")["file"] == "first"
    assert os.listdir(tmp_path / "other")  # noqa: PTH208


def test_temporary_folders_of_the_dead_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code = "import os; from endoct.base.files.scratch import TemporaryFolder; f = TemporaryFolder('bench'); os._exit(9)"
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(tmp_path)}, check=False)
    (dead,) = tmp_path.iterdir()
    (tmp_path / "endoct-bench-mine").mkdir()  # no lock, not old: perhaps somebody is about to lock it
    for name in ("endoct-bench-thesis", ".endoct-bench-thesis", ".endoct.gone-thesis"):  # nothing of endoct's
        (tmp_path / name).mkdir()
        (tmp_path / name / "lock").write_text("the front door")
        os.utime(tmp_path / name, (0, 0))
    with TemporaryFolder("bench") as mine, TemporaryFolder("bench") as other:
        assert not dead.exists()
        assert Path(mine).is_dir()
        assert Path(other).is_dir()
    write(tmp_path / "bench", "new")
    assert names(tmp_path) == [
        ".endoct-bench-thesis", ".endoct.gone-thesis", "bench", "endoct-bench-mine", "endoct-bench-thesis",
    ]  # fmt: skip


LOCK = "process 1 on a machine\n"


def test_hostile_scratch_leads_nowhere(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.tex").write_text("years of work")
    (home / "lock").write_text(LOCK)
    for number, (lock, replaced) in enumerate([("file", "link"), ("link", "none"), ("hard link", "none")]):
        scratch = tmp_path / f".endoct-out-{number}"
        scratch.mkdir()
        if lock == "link":
            (scratch / "lock").symlink_to(home / "thesis.tex")
        elif lock == "hard link":
            os.link(home / "lock", scratch / "lock")
        else:
            (scratch / "lock").write_text(LOCK)
        if replaced == "link":
            (scratch / "replaced").symlink_to(home)
    write(tmp_path / "out", "new")
    assert tree(home) == {"thesis.tex": "years of work", "lock": LOCK}
    assert names(tmp_path / "out") == [NAME, "inside"]


def test_what_was_added_to_a_replaced_output_outlives_a_kill(tmp_path: Path) -> None:
    scratch = tmp_path / ".endoct-out-dead"
    (scratch / "new").mkdir(parents=True)
    write(tmp_path / "old", "old")
    (tmp_path / "old" / ".notes").write_text("mine")
    (tmp_path / "old").rename(scratch / "new" / "out")  # as exchanged, and killed then
    (scratch / "lock").write_text(LOCK)
    write(tmp_path / "out", "new")
    assert tree(tmp_path / "out.kept-1")[".notes"] == "mine"
    assert names(tmp_path) == ["out", "out.kept-1"]


def test_a_page_is_replaced_by_nothing_but_a_page(tmp_path: Path) -> None:
    write_marked("<p>page", tmp_path / "report.html")
    with pytest.raises(EndoctError, match="was not written by endoct"):
        write(tmp_path / "report.html", "new", overwrite=True)


def test_a_hidden_file_in_an_empty_folder_that_is_replaced_is_kept(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()

    def work() -> None:
        with new_output(tmp_path / "out", KIND, overwrite=True) as scratch:
            scratch.mkdir()
            (scratch / "file").write_text("new")
            (tmp_path / "out" / ".notes").write_text("mine")

    with pytest.raises(EndoctError, match=r"not all of the old one could go.*out\.kept-1"):
        work()
    assert tree(tmp_path / "out")["file"] == "new"
    assert tree(tmp_path / "out.kept-1") == {".notes": "mine"}


def test_scratch_of_a_part_that_was_killed_stands_in_nobodys_way(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    scratch = tmp_path / "out" / ".endoct-figures-dead"
    (scratch / "new" / "figures").mkdir(parents=True)
    (scratch / "lock").write_text(LOCK)
    write(tmp_path / "out", "new", overwrite=True)
    assert names(tmp_path) == ["out"]


def test_a_folder_that_threads_make_anew_after_an_error_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a library's threads write after an error is written whenever the removal waits: no thread's luck counts."""
    made: list[Path] = []
    now = [0.0]

    def go_on(seconds: float) -> None:
        now[0] += seconds
        if len(made) < 20:
            assert not any(path.exists() for path in made[1:])
            made.append(made[0] / str(len(made)))
            made[-1].mkdir(parents=True)

    def write_and_fail() -> None:
        with new_output(tmp_path / "out", "export") as scratch:
            made.append(scratch)
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(threading, "active_count", lambda: 2)
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=go_on, time=time.time)
    monkeypatch.setattr("endoct.base.files.scratch.time", clock)
    with pytest.raises(EndoctError, match="No space"):
        write_and_fail()
    assert len(made) == 20
    assert not list(tmp_path.iterdir())


def test_a_short_write_is_told_in_words(tmp_path: Path) -> None:
    with (
        pytest.raises(EndoctError, match="the disk took only 14445 of 157923 numbers: it is full"),
        new_output(tmp_path / "out", "export"),
    ):
        raise OSError("157923 requested and 14445 written")  # as NumPy says it
