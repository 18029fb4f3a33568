"""What `endoct dataset` says."""

import hashlib
import math
from dataclasses import asdict
from pathlib import Path

from endoct.synthetic.sample.presets import PRESETS
from endoct.workbench.dataset.building import forecast, make_dataset
from endoct.workbench.dataset.identity import NAME as IDENTITY
from endoct.workbench.dataset.manifest import NAME as MANIFEST
from endoct.workbench.dataset.plan import SPLITS, Plan, split_of
from endoct.workbench.pipeline.vary import ranges_text
from endoct.workbench.running.progress import Stages


def run_dataset(
    output: Path, plan: Plan, *, workers: int | None, scheduler: str | None, dry_run: bool, stages: Stages
) -> tuple[dict[str, object], list[str]]:
    """Make the data set, or only say what it would take; return that as facts and as lines for people."""
    if dry_run:
        return _dry_run(output, plan, workers, scheduler, stages)
    try:
        built = make_dataset(output, plan, workers=workers, scheduler=scheduler, stages=stages)
    except KeyboardInterrupt:
        kept = f"{output} is begun, and the same command goes on with it" if (output / IDENTITY).exists() else ""
        raise KeyboardInterrupt(kept) from None
    manifest = output / MANIFEST
    digest = hashlib.sha256(manifest.read_bytes()).hexdigest()
    facts = {"output": str(output), **asdict(built), "seconds": round(built.seconds, 1), "manifest_sha256": digest}
    return facts, [
        f"data set: {output} ({built.count} specimens, {_size(built.bytes)}; {built.made} made in "
        f"{_duration(built.seconds)}, {built.kept} were there)",
        f"manifest: {manifest} (sha256 {digest[:16]}…)",
    ]


def _dry_run(
    output: Path, plan: Plan, workers: int | None, scheduler: str | None, stages: Stages
) -> tuple[dict[str, object], list[str]]:
    reckoned = forecast(output, plan, workers=workers, scheduler=scheduler, stages=stages)
    counts = dict.fromkeys(SPLITS, 0)
    for index in range(plan.count):
        counts[split_of(plan, index)] += 1
    size = PRESETS[plan.preset]
    drawn = dict(size.ranges) | dict(plan.ranges)
    facts = {
        "output": str(output),
        "count": plan.count,
        "bores": -(-plan.count // plan.recordings_per_bore),
        "splits": counts,
        "drawn_otherwise": {key: list(range_) for key, range_ in drawn.items()},
        **asdict(reckoned),
        "seconds": round(reckoned.seconds, 1),
    }
    return facts, [
        f"to make: {reckoned.missing} of {plan.count} specimens of {facts['bores']} bores "
        f"({', '.join(f'{split} {count}' for split, count in counts.items())})",
        f"each: {size.n_slices} B-scans of {size.n_ascans} A-scans, {size.n_frames} endoscope frames, truth"
        f"{' and labels' if plan.labels else ''}; bone: {' or '.join(size.bone)}",
        f"drawn otherwise than docs/reference/parameters.md says: {ranges_text(drawn)}",
        f"about {reckoned.files} files and {_size(reckoned.bytes)}; {_size(reckoned.free_bytes)} are free",
        f"about {_duration(reckoned.seconds)} with {reckoned.workers} processes, reckoned from one specimen made alone",
    ]


def _size(n_bytes: int) -> str:
    power = min(4, max(0, math.floor(math.log10(max(1, n_bytes)) / 3)))
    return f"{n_bytes / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
