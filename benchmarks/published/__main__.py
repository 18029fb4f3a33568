"""Make a published set with the specimens of both generators, or a key for its hidden half.

    python -m benchmarks.published -o DATA [--full] [--task wall] [--workers 2]    the public half
    python -m benchmarks.published --new-key hidden.key
    python -m benchmarks.published -o HIDDEN --key hidden.key [--full]     the hidden half

A hidden half also gets ``digests.json``: what is published of it, names and digests.
"""

import argparse
import json
import os
import secrets
from pathlib import Path

from benchmarks.published.specimens import BOTH
from endoct.base.errors import EndoctError
from endoct.base.files.scratch import new_file
from endoct.workbench.bench.published.making import make_set
from endoct.workbench.bench.published.specimen_set import SpecimenSet
from endoct.workbench.commands.console import command_stages

KEY_BITS = 128
DIGESTS = "digests.json"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.published", description=__doc__)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--set", default="endoct-bench-2")
    parser.add_argument("--full", action="store_true", help="five times the small set")
    parser.add_argument("--task", help="make the specimens of this task alone")
    parser.add_argument("--key", type=Path, help="file of the key of the hidden half")
    parser.add_argument("--new-key", type=Path, help="write a key there, and make nothing")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    if options.new_key:
        write_key(options.new_key)
        return
    if options.output is None:
        parser.error("-o is missing")
    made = make_set(
        options.output,
        options.set,
        half="hidden" if options.key else "public",
        size="full" if options.full else "small",
        key=read_key(options.key) if options.key else None,
        task=options.task,
        writers=BOTH,
        workers=options.workers,
        stages=command_stages(False),
    )
    if options.key:
        with new_file(options.output / DIGESTS) as file:
            file.write((json.dumps(digests(made), indent=1) + "\n").encode())
    print(f"{options.output}: {len(made.specimens)} specimens, digest {made.digest}")


def write_key(path: Path) -> None:
    """Write a new key, for the eyes of its owner alone; an existing file stays."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "w", encoding="ascii") as file:
        file.write(f"{secrets.randbits(KEY_BITS):032x}\n")


def read_key(path: Path) -> int:
    """Return the key in a file that :func:`write_key` wrote."""
    text = path.read_text(encoding="ascii").strip()
    if len(text) != KEY_BITS // 4:
        raise EndoctError(f"{path} holds no key", expected=f"{KEY_BITS // 4} hexadecimal digits")
    return int(text, 16)


def digests(made: SpecimenSet) -> dict[str, object]:
    """Return what is published of a hidden half: digests of its specimens, nothing that tells a seed or a sample."""
    facts = {"set": made.set, "half": made.half, "size": made.size, "key": made.key}
    return facts | {"specimens": {each.name: each.digest for each in made.specimens}}


if __name__ == "__main__":
    main()
