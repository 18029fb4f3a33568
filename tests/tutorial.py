"""Runs the code blocks of a Markdown page in order, in one folder, and checks what they print.

``bash`` and ``python`` blocks are run: the first one by the shell, as a reader does it. Later ones that are a command
of endoct alone are run within this process, which has its libraries already. A ``text`` block right after one is what
it prints: ``...`` stands for any text and white space does not count. Whole numbers must be the same, others may differ
by one in the last digit shown: what a sample more or less changes from processor to processor.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from sybil import Document, Example
from sybil.parsers.markdown import CodeBlockParser

from endoct.workbench.cli import main

COMMAND = re.compile(r"[^\n|;&<>$`*?~]+\n?")
"""A line in which a shell would do no more than tell its words apart."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def run_page(page: Path, folder: Path) -> int:
    """Run the blocks of ``page`` in ``folder``, the present folder while they run; return how many there were.

    Raises :class:`AssertionError` where a command fails, or prints something else than the page says.
    """
    parsers = [
        CodeBlockParser("bash", _run_bash),
        CodeBlockParser("python", _run_python),
        CodeBlockParser("text", _check),
    ]
    document = Document.parse(str(page), *parsers)
    with contextlib.chdir(folder):
        return sum(1 for example in document.examples() if example.evaluate() is None)


def _run_bash(example: Example) -> None:
    words = shlex.split(example.parsed, comments=True)
    if "_printed" in example.namespace and words[0] == "endoct" and COMMAND.fullmatch(example.parsed):
        _run_here(example, words)
        return
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    bash = ["bash", "-euo", "pipefail", "-c", example.parsed]
    done = subprocess.run(bash, env=environment, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"{_place(example)}: exit status {done.returncode}\n{example.parsed}\n{done.stderr}"
    example.namespace["_printed"] = done.stdout


def _run_here(example: Example, words: list[str]) -> None:
    printed, said = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        patch.setattr("sys.argv", words)
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code, (
        f"{_place(example)}: exit status {ended.value.code}\n{example.parsed}\n{said.getvalue()}"
    )
    example.namespace["_printed"] = printed.getvalue()


def _run_python(example: Example) -> None:
    printed = io.StringIO()
    code = compile("\n" * (example.line) + example.parsed, example.path, "exec")
    with contextlib.redirect_stdout(printed):
        exec(code, example.namespace)
    example.namespace["_printed"] = printed.getvalue()


def _check(example: Example) -> None:
    said, printed = example.parsed, example.namespace["_printed"]
    assert agrees(said, printed), f"{_place(example)}: the page says\n{said}\nand printed is\n{printed}"


def _place(example: Example) -> str:
    return f"{example.path}:{example.line}"


def agrees(said: str, printed: str) -> bool:
    """Return whether ``printed`` is what a page says."""
    said, printed = " ".join(said.split()), " ".join(printed.split())
    pattern = ".*?".join(_pattern(part) for part in said.split("..."))
    match = re.fullmatch(pattern, printed, flags=re.DOTALL)
    return match is not None and all(map(_near, NUMBER.findall(said), match.groups()))


def _pattern(text: str) -> str:
    """Return a pattern for ``text`` with a group for every number."""
    words = [re.escape(word) for word in NUMBER.split(text)]
    return f"({NUMBER.pattern})".join(words)


def _near(said: str, printed: str) -> bool:
    digits = len(said.partition(".")[2])
    return abs(float(said) - float(printed)) <= (1.01 * 10**-digits if digits else 0)
