"""What tests only read is made once, however many modules ask for it and processes share the tests."""

import fcntl
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class MadeOnce:
    """Has files made in a folder that all processes of a test run share."""

    shared: Path

    def __call__(self, name: str, make: Callable[[Path], object]) -> Path:
        """Return where it lies. Who comes first has ``make`` write it there, the others wait; nobody may change it."""
        place, making = self.shared / name, self.shared / f"{name}.part"
        with (self.shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not place.exists():
                shutil.rmtree(making, ignore_errors=True)  # of one who failed
                make(making)
                making.rename(place)
        return place
