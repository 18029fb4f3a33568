"""Let coverage guide the damage: ``python benchmarks/fuzz_coverage.py --minutes 20 --reader tiff [NAME …]``.

Needs atheris (``pip install atheris``), which is no dependency of endoct; where it is absent, this says so and ends.
endoct's readers, tifffile, zarr and roifile are instrumented. Cases are mutated as ``python -m benchmarks.fuzz`` does,
and those that reach new code are mutated further. Findings are stored below ``-o`` as there, once for each kind and
place, and the same command replays them. Status 1 where there is any. POSIX only.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from random import Random

TOP = Path(__file__).resolve().parents[1]
INSTRUMENTED = ["endoct", "tifffile", "zarr", "roifile"]
LONGEST_BYTES = 400_000


def main() -> int:
    """Fuzz each reader in a process of its own."""
    options = _parsed()
    if find_spec("atheris") is None:
        print("skipped: atheris is not installed (pip install atheris)")
        return 0
    if options.child:
        return _fuzz(options.reader[0], options.minutes, options.output, options.seed)
    output = options.output or Path(tempfile.mkdtemp(prefix="endoct-coverage-"))
    n_findings = 0
    for name in options.reader:
        minutes = options.minutes / len(options.reader)
        command = [sys.executable, __file__, "--child", "--reader", name, "--minutes", str(minutes)]
        command += ["-o", str(output), "--seed", str(options.seed)]
        folder = output / name
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("w") as log:
            try:
                status = (
                    f"status {subprocess.run(command, stdout=log, stderr=log, timeout=60 * minutes + 600).returncode}"
                )
            except subprocess.TimeoutExpired:
                status = "did not end"
        messages = sorted(folder.glob("*/outcome.txt"))
        died = sorted(folder.glob("crash-*"))
        n_findings += len(messages) + len(died)
        lines = (folder / "log.txt").read_text(errors="replace").splitlines()
        last = next((line for line in reversed(lines) if line.startswith("#")), "no case")
        print(f"{name}: {len(messages)} findings, {len(died)} crashes, {status}; {last}")
        for path in messages:
            print(f"  {path.read_text(errors='replace').splitlines()[0]}: {path.parent}")
    return 1 if n_findings else 0


def _fuzz(name: str, minutes: float, output: Path, seed: int) -> int:
    import atheris

    sys.path.insert(0, str(TOP))
    with atheris.instrument_imports(include=INSTRUMENTED, enable_loader_override=True):
        from benchmarks.fuzz.readers import READERS, seeds_of

        seeds = seeds_of(name)
        reader = READERS[name]
    from benchmarks.fuzz.case_process import target_of
    from benchmarks.fuzz.mutate import mutated
    from benchmarks.fuzz.outcome import outcome_of
    from benchmarks.fuzz.trees import Entry, Seed, write_tree

    scratch = Path(tempfile.mkdtemp(prefix="endoct-coverage-"))
    known: set[str] = set()
    for sound in seeds:  # loads, and instruments, what is loaded at need
        with atheris.instrument_imports(include=INSTRUMENTED):
            write_tree(sound.files, scratch / "case")
            outcome_of(reader.read, scratch / "case" / sound.target, case=scratch / "case", seconds=600.0)
            shutil.rmtree(scratch / "case")

    def unpacked(data: bytes) -> tuple[Seed, dict[str, Entry]]:
        try:
            head, _, body = data.partition(b"\n")
            number, lengths = json.loads(head)
            tree: dict[str, Entry] = {}
            for path, length in lengths:
                tree[path], body = body[:length], body[length:]
            return seeds[number], tree
        except (ValueError, TypeError, IndexError, KeyError, RecursionError):
            return seeds[0], dict(seeds[0].files)

    def packed(number: int, tree: dict[str, Entry]) -> bytes:
        files = {path: entry for path, entry in tree.items() if isinstance(entry, bytes)}
        head = json.dumps([number, [[path, len(data)] for path, data in files.items()]])
        return head.encode() + b"\n" + b"".join(files.values())

    def mutate(data: bytes, most: int, number: int) -> bytes:
        sound, tree = unpacked(data)
        changed = packed(seeds.index(sound), mutated(Seed(sound.name, sound.target, tree), seeds, Random(number)))
        return changed if len(changed) <= most else data[:most]

    def once(data: bytes) -> None:
        sound, tree = unpacked(data)
        case = scratch / "case"
        shutil.rmtree(case, ignore_errors=True)
        write_tree(tree, case)
        outcome = outcome_of(reader.read, target_of(sound, tree, case), case=case, seconds=3 * reader.seconds)
        label = f"{outcome.kind}-{outcome.where}"
        if outcome.is_finding and label not in known:
            known.add(label)
            place = output / name / "".join(c if c.isalnum() or c in "-_." else "_" for c in label)
            shutil.rmtree(place, ignore_errors=True)
            write_tree(tree, place / "case")
            text = f"{name}: {outcome.kind} in {outcome.where}\n\n{outcome.message}\n"
            (place / "outcome.txt").write_text(text, encoding="utf-8", errors="backslashreplace")

    corpus = scratch / "corpus"
    corpus.mkdir()
    for number, sound in enumerate(seeds):
        (corpus / f"{number}").write_bytes(packed(number, dict(sound.files)))
    settings = [
        f"-max_total_time={max(1, round(60 * minutes))}", f"-max_len={LONGEST_BYTES}", "-timeout=0", "-rss_limit_mb=0",
        f"-seed={seed + 1}", f"-artifact_prefix={output / name}{os.sep}", "-print_final_stats=1", str(corpus),
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *settings], once, custom_mutator=mutate)
    atheris.Fuzz()  # ends the process
    return 0


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="in all, shared out among the readers")
    parser.add_argument("--reader", nargs="+", default=["tiff"], help="as of python -m benchmarks.fuzz")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, help="folder for findings")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
