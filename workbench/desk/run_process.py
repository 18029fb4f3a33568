"""The process that carries out one run of the queue: it starts the command, notes how it ends, and cancels it.

It belongs to no terminal and to no server, and holds the lock of the run's folder as long as the command runs.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import FrameType

from endoct.base.files.json_values import read_object
from endoct.base.files.scratch import HeldError, held
from endoct.workbench.desk.runs import CANCEL, ENDED, LOCK, LOG, REQUEST
from endoct.workbench.running.progress import EVERY_S_NAME
from endoct.workbench.running.refusals import DONE, INTERRUPTED, NOT_ALIGNED

PROGRAM = "from endoct.workbench.cli import main; main()"
PROGRESS_EVERY_S = "0.5"
LOOK_S = 0.1
"""How often it is looked whether the run is to be cancelled."""
TAKING_S = 10.0
"""For which the lock is waited: whoever looks whether it is held holds it for a moment."""


def main() -> None:
    """Carry out the run in the folder that the command line names."""
    path = Path(sys.argv[1])
    for _ in range(round(TAKING_S / LOOK_S)):
        try:
            with held(path / LOCK):
                _carry_out(path)
                return
        except HeldError:
            time.sleep(LOOK_S)


def _carry_out(path: Path) -> None:
    request, begun = read_object(path / REQUEST), time.time()
    if (path / ENDED).exists():
        return
    cancelled = path / CANCEL

    def cancel(number: int, frame: FrameType | None) -> None:
        del number, frame
        cancelled.touch()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, cancel)
    environment = os.environ | {EVERY_S_NAME: PROGRESS_EVERY_S, "COLUMNS": "200"}
    with (path / LOG).open("wb") as log:
        try:
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", PROGRAM, *request["arguments"]],
                cwd=request["folder"], stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=environment,
            )  # fmt: skip
        except OSError as error:
            log.write(f"endoct: {request['folder']} cannot be used; found {error.strerror}\n".encode())
            _note(path, 1, begun)
            return
        asked = False
        while (status := process.poll()) is None:
            if cancelled.exists() and not asked:
                process.send_signal(signal.SIGINT)
                asked = True
            time.sleep(LOOK_S)
    # one that was interrupted before it could listen ends as the system has it
    _note(path, status if not asked or status in (DONE, NOT_ALIGNED) else INTERRUPTED, begun)


def _note(path: Path, status: int, begun: float) -> None:
    """Note how the run ended, at one stroke."""
    scratch = path / f".{ENDED}"
    scratch.write_text(json.dumps({"status": status, "seconds": time.time() - begun}), encoding="utf-8")
    scratch.replace(path / ENDED)
