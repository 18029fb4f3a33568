"""Whether processes of others have ended."""

import time

import psutil

PATIENCE_S = 30.0


def has_ended(pid: int) -> bool:
    """Wait until a process has ended, whether or not anybody has asked how; say whether it did."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.02)
    return False
