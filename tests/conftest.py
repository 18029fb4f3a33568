"""Fixtures that tests of several folders share."""

import gc
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from kept_process import KeptProcess
    from made_once import MadeOnce

# Read as a process starts: by those that share the tests, and by what tests start. Two processes of two threads each on
# two cores wait for each other by turning round and round; and arrays that are taken and given back a thousand times
# are to stay with the process in between (glibc asks the system for each one anew).
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", str(32 << 20))
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(128 << 20))

# No test may depend on the machine's speed.
settings.register_profile("endoct", deadline=None, derandomize=True)
settings.load_profile("endoct")

gc.disable()  # while tests are looked for, nearly all that is made stays: to look for garbage takes half of the time


def pytest_collection_finish() -> None:
    """Whatever is loaded by now stays: the collector of garbage need not look through it again and again."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def kept_process() -> "Iterator[KeptProcess]":
    """The second process of every command is the same one."""
    from kept_process import KeptProcess  # only once tests run: it loads libraries

    kept = KeptProcess()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("endoct.workbench.running.scheduler.worker_process", kept.lent)
        patch.setattr("endoct.synthetic.specimen.worker_process", kept.lent)
        yield kept
    kept.end()


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; without it the test is skipped."""
    folder = os.environ.get("ENDOCT_RECORDINGS")
    if not folder:
        pytest.skip("ENDOCT_RECORDINGS does not name a folder of real recordings")
    path = Path(folder)
    if not path.is_dir():
        pytest.fail(f"ENDOCT_RECORDINGS names {path}, which is no folder")
    return path


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> "MadeOnce":
    """Have something made that tests only read, once for all processes that share the tests."""
    from made_once import MadeOnce  # locks as POSIX has them: only who needs them

    base = tmp_path_factory.getbasetemp()
    return MadeOnce(base.parent if "PYTEST_XDIST_WORKER" in os.environ else base)


@pytest.fixture(scope="session")
def quick_specimen(made_once: "MadeOnce") -> Path:
    """One simulated specimen of the preset `quick`: oct/, endoscope/ and truth/. Tests must not change it."""
    from endoct.synthetic.specimen import simulate  # only who needs a specimen loads it

    return made_once("quick_specimen", lambda folder: simulate(folder, preset="quick", seed=1000))


@pytest.fixture(scope="session")
def small_specimen(made_once: "MadeOnce") -> Path:
    """One of the preset `learning` with labels and raw spectra, as a user makes it. Tests must not change it.

    Its wall is easily seen, and a fifth of its cells holds fluid.
    """
    from endoct.workbench import simulate

    vary = {"bore.bone": ["mastoid"], "bore.fluid": (0.2, 0.2), "oct.scan": ["step"], "oct.wall_db": (20.0, 20.0)}
    options = {"preset": "learning", "seed": 22, "vary": vary, "labels": True, "spectra": True, "progress": False}
    return made_once("small_specimen", lambda folder: simulate(folder, **options))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs an administrator's rights")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)
