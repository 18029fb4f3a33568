"""Small sets of a published benchmark, and submissions on sets that are nowhere, for tests."""

from endoct.workbench.bench.published.definition import Definition, Difficulty, Planned, SpecimenKind, load_definition
from endoct.workbench.bench.published.specimen_set import Entry
from endoct.workbench.bench.published.submitted import Scored, Submission

TASKS = ("segmentation", "stitching", "oct", "alignment", "depth", "wall")


def tiny(count: int = 1) -> Definition:
    """The benchmark with specimens of the smallest preset, and of the second generator, which has no writer here."""
    kinds = (
        SpecimenKind(generator="simulator", difficulty="easy", tasks=TASKS, count=count, preset="learning"),
        SpecimenKind(generator="second", difficulty="easy", tasks=TASKS, count=count),
    )
    return load_definition("endoct-bench-2").model_copy(update={"kinds": kinds})


def planned_specimen(difficulty: Difficulty, seed: int) -> Planned:
    """A specimen of the smallest preset."""
    kind = SpecimenKind(generator="simulator", difficulty=difficulty, tasks=TASKS, count=1, preset="learning")
    return Planned(f"{kind.name}-000", kind, seed, "test")


def entry(name: str, generator: str = "simulator", difficulty: str = "easy") -> Entry:
    """A specimen of a set that is nowhere."""
    facts = {"name": name, "generator": generator, "difficulty": difficulty, "tasks": TASKS, "split": "test"}
    digests = {"recorded": {"oct": "a" * 64, "truth": "c" * 64}, "unrolled": {"oct": "b" * 64}}
    means = {"oct": (50.0, 60.0), "oct.zarr": (100.0, 99.9), "truth": (29.2, 3.1)}
    return Entry.model_validate({**facts, **digests, "means": means})


def scored(specimen: str, method: str, jaccard: float | None, *, success: bool = False, seconds: float = 1.0) -> Scored:
    """A row of the task "segmentation"; declined where there is no Jaccard index."""
    return Scored(
        specimen=specimen,
        case=f"{specimen}/oct/wall",
        method=method,
        status="declined" if jaccard is None else "ok",
        reason="too dark" if jaccard is None else "",
        scores={} if jaccard is None else {"jaccard": jaccard, "success": float(success)},
        seconds=seconds,
        cpu_seconds=seconds,
    )


def submission(rows: list[Scored], entries: list[Entry], task: str = "segmentation") -> Submission:
    """A submission with these rows."""
    return Submission(
        set="endoct-bench-2",
        half="public",
        size="small",
        task=task,
        specimens=tuple(entries),
        methods={each.method: f"somewhere:{each.method}" for each in rows},
        programs={},
        sources={"endoct": "0" * 16},
        left_out={},
        rows=tuple(rows),
        versions={"endoct": "0.1.0"},
        machine={"processor": "a processor", "cores_usable": 2},
        workers=1,
        seconds=60.0,
    )
