"""What a run of the bench states about itself: what is run, with which versions, and on which machine."""

import os
import platform
from pathlib import Path

from endoct.workbench.bench.methods import load_task, origin
from endoct.workbench.bench.runner import Plan
from endoct.workbench.pipeline.inputs import versions

Facts = dict[str, object]
"""What can be written as JSON."""


def plan_facts(plan: Plan) -> Facts:
    """Return what is run, on which cases, and with which versions."""
    task = load_task(plan.task)
    return {
        "task": task.name,
        "methods": {name: origin(task, name) for name in plan.methods},
        "seeds": list(plan.seeds),
        "cases_a_seed": plan.count,
        "conditions": {name: list(range_) for name, range_ in (plan.ranges or {}).items()},
        "data": [str(folder) for folder in plan.own],
        "versions": versions(),
    }


def machine() -> Facts:
    """Return the processor, its cores and how many of them this process may use, the memory and the system."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    facts: Facts = {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "cores_usable": usable,
        "system": platform.platform(terse=True),
        "omp_num_threads": os.environ.get("OMP_NUM_THREADS", "not set"),
    }
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        facts["memory_gb"] = round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    return facts


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
