"""The commands of `endoct`, as tyro reads them from their signatures and docstrings, and their completion in shells."""

import difflib
import functools
import io
import os
import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from typing import Any, Literal, get_args

import tyro
from tyro.conf import Positional

from endoct.base.errors import visible
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.commands.comparisons import Compare, Summarise, report, serve
from endoct.workbench.commands.opening import open_folder
from endoct.workbench.commands.outputs import Export, Verify
from endoct.workbench.commands.poses import Pose
from endoct.workbench.commands.published import Submit, board, check, layout, make
from endoct.workbench.commands.recordings import Calibrate, Info, Tube, Unroll, modalities
from endoct.workbench.commands.research import Bench, Train
from endoct.workbench.commands.simulations import Dataset, Simulate, demo, self_test, warm_up
from endoct.workbench.running.refusals import DONE, WRONG_USAGE, visible_lines

LONGEST_NAME = 30
FEWEST_COLUMNS, MOST_COLUMNS = 40, 500
"""tyro breaks the lines of help for ever where there is hardly a column, and fills them up where there are many."""
OF_BENCH: Mapping[str, Callable[..., Any]] = {
    "make": make,
    "submit": Submit,
    "check": check,
    "board": board,
    "layout": layout,
}
"""The commands of published benchmarks.

`endoct bench` takes a task, so tyro gets `endoct bench submit …` as `endoct bench-submit …`.
"""


def _limit_columns() -> None:
    """Have help printed for a terminal of a sensible width, whatever this one has, or `COLUMNS` says."""
    columns = shutil.get_terminal_size().columns
    if not FEWEST_COLUMNS <= columns <= MOST_COLUMNS:
        os.environ["COLUMNS"] = str(min(max(columns, FEWEST_COLUMNS), MOST_COLUMNS))


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status."""
    commands: dict[str, Callable[..., Any]] = {
        "open": open_folder,
        "demo": demo,
        "simulate": Simulate,
        "unroll": Unroll,
        "compare": Compare,
        "pose": Pose,
        "calibrate": Calibrate,
        "target": Tube,
        "dataset": Dataset,
        "bench": Bench,
        **{f"bench-{name}": command for name, command in OF_BENCH.items()},
        "train": Train,
        "report": report,
        "serve": serve,
        "summarise": Summarise,
        "export": Export,
        "info": Info,
        "verify": Verify,
        "modalities": modalities,
        "self-test": self_test,
        "warm-up": warm_up,
        "completion": completion,
    }
    _limit_columns()
    arguments = _joined(arguments or ["open"])
    if near := _near(arguments[0], commands):
        sys.stderr.write(f"endoct: unknown command '{visible(arguments[0])}'; did you mean '{near}'?\n")
        return WRONG_USAGE
    if refused := _misspelt_preset(arguments):
        sys.stderr.write(f"endoct: {refused}\n")
        return WRONG_USAGE
    with nullcontext() if all(map(str.isprintable, arguments)) else _visible_errors():
        command: Callable[[], int] = tyro.extras.subcommand_cli_from_dict(
            {name: _later(command) for name, command in commands.items()},
            prog="endoct",
            description="Compare what a cone-mirror endoscope and a catheter OCT see of one drill hole in bone. "
            "`endoct --version` prints the version.",
            args=list(arguments),
            config=(tyro.conf.FlagCreatePairsOff,),
        )
    return command()


def _joined(arguments: Sequence[str]) -> Sequence[str]:
    """Return the arguments with the two words of such a command as one."""
    if arguments[0] == "bench" and len(arguments) > 1 and arguments[1] in OF_BENCH:
        return [f"bench-{arguments[1]}", *arguments[2:]]
    return arguments


def _near(name: str, names: Collection[str]) -> str | None:
    """Return which of ``names`` a misspelt one is nearest to; None for one of them, an option, or nothing near."""
    if name in names or name.startswith("-") or len(name) > LONGEST_NAME:
        return None
    return next(iter(difflib.get_close_matches(name, names, 1, cutoff=0.6)), None)


def _misspelt_preset(arguments: Sequence[str]) -> str:
    """Return a sentence on a preset that is nearly one; "" where there is none such."""
    for option, after in zip(arguments, [*arguments[1:], ""], strict=True):
        name = after if option == "--preset" else option.removeprefix("--preset=") if "=" in option else ""
        if option.startswith("--preset") and (near := _near(name, get_args(PresetName))):
            return f"unknown preset '{visible(name)}'; did you mean '{near}'?"
    return ""


def _later(command: Callable[..., Any]) -> Callable[..., Callable[[], int]]:
    """Return what tyro makes of the arguments of a ``command``, to be called later: a request, or a bound function."""
    if isinstance(command, type):
        return command

    @functools.wraps(command)
    def bound(*arguments: object, **named: object) -> Callable[[], int]:
        return functools.partial(command, *arguments, **named)

    return bound


@contextmanager
def _visible_errors() -> Iterator[None]:
    """Write out control characters in tyro's messages, which quote arguments, such as the names of files."""
    message = io.StringIO()
    try:
        with redirect_stderr(message):
            yield
    finally:
        sys.stderr.write(visible_lines(message.getvalue()))


def completion(shell: Positional[Literal["bash", "zsh"]]) -> int:
    """Print a shell's completion script: `endoct completion bash > ~/.local/share/bash-completion/completions/endoct`.

    Args:
        shell: the shell; with zsh, write it to a file _endoct in a folder of $fpath
    """
    print(completion_script(shell), end="")  # noqa: T201
    return DONE


def completion_script(shell: Literal["bash", "zsh"]) -> str:
    """Return tyro's completion script for ``endoct``, which also completes paths where there is nothing else."""
    script = io.StringIO()
    try:
        with redirect_stdout(script):
            run(["--tyro-print-completion", shell])
    except SystemExit:  # tyro leaves once it has printed
        pass
    # tyro's functions know options and subcommands only; every path would have to be typed out
    return (
        script.getvalue()
        .replace("complete -F _tyro_endoct ", "complete -o default -o bashdefault -F _tyro_endoct ")
        .replace(
            "_describe 'endoct completions' completion_array",
            "_describe 'endoct completions' completion_array || _files",
        )
    )
