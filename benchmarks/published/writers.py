"""What writes the specimens of a published set, by generator."""

from collections.abc import Mapping
from pathlib import Path

from benchmarks.published.bone import write_bone_bore
from benchmarks.published.walls import write_walls
from endoct.workbench.bench.published.definition import Planned
from endoct.workbench.bench.published.making import WRITERS, Writer


def second_specimen(folder: Path, specimen: Planned) -> None:
    """Write a specimen of the second generator: in bone with a CT for the task "pose", else a wall with cells."""
    if "pose" in specimen.kind.tasks:
        write_bone_bore(folder, specimen.kind.difficulty, specimen.seed)
    else:
        write_walls(folder, specimen.kind.difficulty, specimen.seed)


BOTH: Mapping[str, Writer] = {**WRITERS, "second": second_specimen}
