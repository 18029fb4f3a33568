"""The public Python interface, the command line, the pipeline and the report.

``from endoct.workbench import compare, demo, export, pose, pose_outlook, simulate, summarise, unroll,
verify``. Each loads on first use, so that the command line starts at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from endoct.workbench.api import compare, demo, summarise, unroll
    from endoct.workbench.exporting.export import export
    from endoct.workbench.pipeline.simulating import simulate
    from endoct.workbench.posing.pose import pose, pose_outlook
    from endoct.workbench.verifying import verify

    __version__: str

__all__ = [
    "compare",
    "demo",
    "export",
    "pose",
    "pose_outlook",
    "simulate",
    "summarise",
    "unroll",
    "verify",
]

if not TYPE_CHECKING:  # else every misspelt name would be an object to type checkers

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version  # takes 20 ms that the command line does not spend

            return version("endoct")
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        elsewhere = {
            "export": "exporting.export",
            "pose": "posing.pose",
            "pose_outlook": "posing.pose",
            "simulate": "pipeline.simulating",
            "verify": "verifying",
        }
        module = elsewhere.get(name, "api")
        return getattr(import_module(f"endoct.workbench.{module}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__name__", "__path__", "__version__"]
