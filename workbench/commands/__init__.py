"""The commands of `endoct`, as tyro reads them from their signatures and docstrings."""

from collections.abc import Sequence
from typing import Any

import tyro

from endoct.workbench.commands.comparisons import compare, report, summarise
from endoct.workbench.commands.recordings import info, modalities, unroll
from endoct.workbench.commands.research import bench
from endoct.workbench.commands.simulations import dataset, demo, simulate


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status."""
    commands: dict[str, Any] = {
        "demo": demo,
        "simulate": simulate,
        "unroll": unroll,
        "compare": compare,
        "dataset": dataset,
        "bench": bench,
        "report": report,
        "summarise": summarise,
        "info": info,
        "modalities": modalities,
    }
    status: int = tyro.extras.subcommand_cli_from_dict(
        commands,
        prog="endoct",
        description="Compare what a cone-mirror endoscope and a catheter OCT see of one drill hole in bone.",
        args=list(arguments),
        config=(tyro.conf.FlagCreatePairsOff,),
    )
    return status
