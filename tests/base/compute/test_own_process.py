"""Settings of a process that is ours."""

import ctypes
import subprocess
import sys

import pytest

HEAPS = """
import ctypes, sys, threading
from endoct.base.compute.own_process import settle_in
settle_in()
c = ctypes.CDLL(None)
c.fdopen.restype, c.malloc_info.argtypes = ctypes.c_void_p, [ctypes.c_int, ctypes.c_void_p]
together = threading.Barrier(5)
def take():
    together.wait()
    kept = [c.malloc(5000) for _ in range(50)]
    together.wait()
threads = [threading.Thread(target=take) for _ in range(4)]
for thread in threads:
    thread.start()
together.wait()
together.wait()
said = c.fdopen(1, b"w")
c.malloc_info(0, said)
c.fflush(ctypes.c_void_p(said))
"""


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_info"), reason="the C library is not glibc"
)
def test_threads_take_memory_from_one_heap() -> None:
    """Of five threads at work at once, glibc gives each a heap of its own unless it is told otherwise."""
    said = subprocess.run([sys.executable, "-c", HEAPS], capture_output=True, text=True, check=True).stdout
    assert said.count("<heap nr") == 1
