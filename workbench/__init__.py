"""The public Python interface: each function does what the command of its name does.

Each loads on first use, so that the command line starts at once. Its request, in :mod:`endoct.workbench.requests`, is
read by the command line and by the page's forms, too.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from endoct.workbench.api import compare, demo, load, summarise, unroll
    from endoct.workbench.bench.command import run_bench
    from endoct.workbench.calibrating.calibration import calibrate
    from endoct.workbench.exporting.export import export
    from endoct.workbench.pipeline.simulating import simulate
    from endoct.workbench.posing.pose import pose, pose_outlook
    from endoct.workbench.training import train
    from endoct.workbench.verifying import verify

    __version__: str

__all__ = [
    "calibrate",
    "compare",
    "demo",
    "export",
    "load",
    "pose",
    "pose_outlook",
    "run_bench",
    "simulate",
    "summarise",
    "train",
    "unroll",
    "verify",
]

if not TYPE_CHECKING:  # else every misspelt name would be an object to type checkers
    _ELSEWHERE = {
        "calibrate": "calibrating.calibration",
        "export": "exporting.export",
        "pose": "posing.pose",
        "pose_outlook": "posing.pose",
        "run_bench": "bench.command",
        "simulate": "pipeline.simulating",
        "train": "training",
        "verify": "verifying",
    }

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version  # takes 20 ms that the command line does not spend

            return version("endoct")
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"endoct.workbench.{_ELSEWHERE.get(name, 'api')}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__name__", "__path__", "__version__"]
