"""Programs in containers: by a runtime that only writes down what it is told, and by a real one where there is one."""

import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.cases.toy_walls import toy_panorama
from endoct.workbench.bench.container import RUNTIMES, _runtime, contained
from endoct.workbench.bench.program import MOST_MEMORY_BYTES, Program, parse_programs
from endoct.workbench.bench.task import load_task

CONDITIONS = {"signal_db": 25.0, "cell_mm": 0.8, "fill": 0.2, "missing": 0.2, "unevenness": 0.2}
RUNTIME = """#!{python}
import json, pathlib, subprocess, sys
words = sys.argv[1:]
with pathlib.Path(r"{log}").open("a") as log:
    log.write(json.dumps(words) + chr(10))
if words[:2] == ["image", "inspect"]:
    sys.exit(words[2] != "here:1")
if words[0] == "run":
    sys.exit(subprocess.call(words[words.index("here:1") + 1:]))
"""
COPY = """sh -c 'cp "$0/valid.npy" "$1/mask.npy"'"""
IMAGE = "localhost/endoct-test:1"


@pytest.fixture(params=RUNTIMES)
def log_of_runtime(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only runtime of this machine writes down here, line by line, what it is told, and runs it without one."""
    log, folder = tmp_path / "log", tmp_path / "bin"
    folder.mkdir()
    (folder / request.param).write_text(RUNTIME.format(python=sys.executable, log=log), encoding="utf-8")
    (folder / request.param).chmod(0o755)
    for name in ("sh", "cp", "sleep"):
        (folder / name).symlink_to(f"/bin/{name}")
    monkeypatch.setenv("PATH", str(folder))
    return log


def panorama() -> Panorama:
    return toy_panorama(3, 0, "depth", CONDITIONS)[0]


def program(command: str) -> Program:
    exchange = load_task("segmentation").exchange
    assert exchange is not None
    return Program(command, exchange)


def lines(log_of_runtime: Path) -> list[list[str]]:
    return [json.loads(line) for line in log_of_runtime.read_text(encoding="utf-8").splitlines()]


@pytest.mark.skipif(os.name != "posix", reason="the runtime is a script")
def test_a_container_has_no_network_reads_its_case_and_writes_its_answer_alone(
    log_of_runtime: Path, request: pytest.FixtureRequest
) -> None:
    given = panorama()
    assert np.array_equal(program(parse_programs((f"mine={COPY}",), "here:1")["mine"])(given), given.valid)
    inspected, run, removed = lines(log_of_runtime)
    assert inspected == ["image", "inspect", "here:1"]
    options, command = run[1 : run.index("here:1")], run[run.index("here:1") + 1 :]
    assert {"--network=none", "--read-only", "--cap-drop=all", "--pull=never"} < {*options}
    assert f"--memory={MOST_MEMORY_BYTES}b" in options
    by_docker = request.node.callspec.params["log_of_runtime"] == "docker"  # its service would write as administrator
    assert f"--user={os.getuid() if by_docker else 0}:{os.getgid() if by_docker else 0}" in options
    assert command[:2] == ["sh", "-c"]
    reads, writes = command[-2:]
    volumes = [each.removeprefix("--volume=") for each in options if each.startswith("--volume=")]
    assert volumes == [f"{reads}:{reads}:ro", f"{writes}:{writes}"]
    assert removed == ["rm", "--force", next(each for each in options if each.startswith("--name="))[len("--name=") :]]


@pytest.mark.skipif(os.name != "posix", reason="the runtime is a script")
def test_a_container_of_a_program_that_is_ended_is_removed(
    log_of_runtime: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("endoct.workbench.bench.program.LONGEST_S", 0.5)
    with pytest.raises(EndoctError, match="takes too long"):
        program("container:here:1 sh -c 'sleep 60'")(panorama())
    run, removed = lines(log_of_runtime)
    assert f"--name={removed[-1]}" in run
    assert removed[:2] == ["rm", "--force"]


@pytest.mark.skipif(os.name != "posix", reason="the runtime is a script")
@pytest.mark.parametrize("image", ["--privileged", "", "here 1", "-v/:/all"])
def test_no_option_is_taken_for_an_image(log_of_runtime: Path, image: str) -> None:
    with pytest.raises(EndoctError, match="no such name"):
        contained(image, "mine")
    assert not log_of_runtime.exists()


@pytest.mark.skipif(os.name != "posix", reason="the runtime is a script")
def test_an_image_that_is_not_there_is_asked_for(log_of_runtime: Path) -> None:
    with pytest.raises(EndoctError, match=r"no image .there:2. here.*pull there:2"):
        parse_programs(("mine=run",), "there:2")
    assert lines(log_of_runtime) == [["image", "inspect", "there:2"]]


def test_a_machine_without_containers_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(EndoctError, match=r"container cannot be run here.*podman or docker"):
        contained("here:1", "mine")


def test_an_image_without_programs_is_refused() -> None:
    with pytest.raises(EndoctError, match="only programs run in a container"):
        parse_programs((), "here:1")


@pytest.fixture
def image(tmp_path: Path) -> Iterator[str]:
    """An image that holds a shell, and what copies files and waits."""
    try:
        runtime = _runtime()
    except EndoctError as error:
        pytest.skip(str(error))
    tools = [f"/bin/{name}" for name in ("sh", "cp", "sleep")]
    libraries = subprocess.run(["ldd", *tools], capture_output=True, text=True, check=False).stdout.split()
    files = [Path(word) for word in [*tools, *libraries] if word.startswith("/") and not word.endswith(":")]
    with tarfile.open(tmp_path / "image.tar", "w", dereference=True) as tar:
        for path in sorted({*files, *(folder for file in files for folder in file.parents)}):
            tar.add(path, recursive=False)  # folders too: Docker would let nobody into those that are not listed
    done = subprocess.run(
        [runtime, "import", str(tmp_path / "image.tar"), IMAGE], capture_output=True, text=True, check=False
    )
    if done.returncode or subprocess.run([runtime, "run", "--rm", IMAGE, "sh", "-c", ":"], check=False).returncode:
        pytest.skip(f"{runtime} runs no container here: {done.stderr.strip()[-200:]}")
    yield IMAGE
    subprocess.run([runtime, "image", "rm", "--force", IMAGE], capture_output=True, check=False)


def test_a_real_container_does_what_is_written_down(
    image: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = panorama()
    (tmp_path / "truth").touch()
    for tried, match in (
        (f'sh -c "test -e {tmp_path}/truth || exit 7"', "status 7"),
        ("""sh -c ': > "$0/more.npy"'""", "status"),  # what is given cannot be written to
        ("sh -c ': > /more'", "status"),  # nor can the image
    ):
        with pytest.raises(EndoctError, match=match):
            program(contained(image, tried))(given)
    assert np.array_equal(program(contained(image, COPY))(given), given.valid)
    monkeypatch.setattr("endoct.workbench.bench.program.LONGEST_S", 2.0)
    with pytest.raises(EndoctError, match="takes too long"):
        program(contained(image, "sh -c 'sleep 600'"))(given)
    running = subprocess.run([_runtime(), "ps", "--all"], capture_output=True, text=True, check=True).stdout
    assert image not in running
