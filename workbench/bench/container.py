"""Programs in containers: one sees the case that it is given and what its image holds, and nothing else of the machine.

Podman and Docker understand the same words. Containers have no network, and write nothing but the answer and what
vanishes with them. Both folders lie in one where they lie outside, since paths stand in what is given.
"""

import os
import re
import secrets
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from endoct.base.errors import EndoctError

RUNTIMES = ("podman", "docker")
"""The first that is there is used: Podman needs no service."""
MARK = "container:"
"""A program whose command begins so, and goes on with the name of an image, runs in a container."""
MOST_PROCESSES = 2048
_IMAGE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:/@-]*")


def contained(image: str, command: str) -> str:
    """Return a command that runs ``command`` in a container of an image.

    Raises :class:`EndoctError` where this machine has no containers, or not the image: none is ever downloaded.
    """
    if _IMAGE.fullmatch(image) is None:
        raise EndoctError("an image has no such name", found=f"'{image[:80]}'", expected="a name as name:tag")
    if subprocess.run([_runtime(), "image", "inspect", image], capture_output=True, check=False).returncode:
        raise EndoctError(f"there is no image '{image}' here", remedy=f"{_runtime()} pull {image}, or build it")
    return f"{MARK}{image} {command}"


@contextmanager
def container(command: Sequence[str], given: Path, answer: Path, most_bytes: int) -> Iterator[list[str]]:
    """Yield the words that run a split ``command`` that :func:`contained` returned, on both folders.

    Its memory and its temporary files are bounded by ``most_bytes`` each. In the end the container is removed, with
    whatever still runs in it. Raises :class:`EndoctError` where this machine has no containers.
    """
    runtime, name = _runtime(), f"endoct-{secrets.token_hex(8)}"
    # without a service, the administrator inside is who started it; with one, files would be the administrator's
    user = f"{os.getuid()}:{os.getgid()}" if runtime == "docker" and os.name == "posix" else "0:0"
    options = [
        *("--rm", "--pull=never", "--stop-timeout=0", f"--name={name}", f"--user={user}", "--env=HOME=/tmp"),
        *("--network=none", "--cap-drop=all", "--security-opt=no-new-privileges", "--security-opt=label=disable"),
        *("--read-only", f"--tmpfs=/tmp:rw,size={most_bytes}"),
        *(f"--memory={most_bytes}b", f"--pids-limit={MOST_PROCESSES}"),
        *(f"--volume={given}:{given}:ro", f"--volume={answer}:{answer}"),
    ]
    try:
        image = command[0].removeprefix(MARK)
        yield [runtime, "run", *options, image, *command[1:], str(given), str(answer)]
    finally:
        subprocess.run([runtime, "rm", "--force", name], capture_output=True, check=False)


def _runtime() -> str:
    for name in RUNTIMES:
        if shutil.which(name):
            return name
    raise EndoctError("a container cannot be run here", expected=" or ".join(RUNTIMES), remedy="install Podman")
