"""`endoct serve` as a process."""

import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_it_serves_until_it_is_interrupted(comparison: Path):
    before = {path: path.stat().st_mtime_ns for path in comparison.rglob("*")}
    run = "import sys; sys.argv[0] = 'endoct'; from endoct.workbench.cli import main; main()"
    command = [sys.executable, "-c", run, "serve", str(comparison), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        line = server.stdout.readline()
        address = re.match(r"(http://127\.0\.0\.1:\d+/) shows .*; Ctrl\+C ends it", line)
        assert address is not None, line
        with urllib.request.urlopen(address[1], timeout=60) as answer:
            assert b"page.js" in answer.read()
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=60)
        assert (server.returncode, said) == (0, f"opening {comparison}; the address follows\n")
    assert {path: path.stat().st_mtime_ns for path in comparison.rglob("*")} == before


def test_help_loads_no_server():
    run = (
        "import sys; from endoct.workbench.commands import run\n"
        "try: run(['serve', '--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'starlette', 'uvicorn', 'zarr', 'cv2'} & set(sys.modules)))"
    )
    said = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[-1] == "[]"
