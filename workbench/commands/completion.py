"""The command that prints completion scripts for shells."""

import io
from contextlib import redirect_stdout
from typing import Literal

from tyro.conf import Positional

from endoct.workbench.running.refusals import DONE


def completion(shell: Positional[Literal["bash", "zsh"]]) -> int:
    """Print a shell's completion script: `endoct completion bash > ~/.local/share/bash-completion/completions/endoct`.

    Args:
        shell: the shell; with zsh, write it to a file _endoct in a folder of $fpath
    """
    print(completion_script(shell), end="")  # noqa: T201
    return DONE


def completion_script(shell: Literal["bash", "zsh"]) -> str:
    """Return tyro's completion script for ``endoct``, which also completes paths where there is nothing else."""
    from endoct.workbench.commands import run

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
