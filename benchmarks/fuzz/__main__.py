"""Try damaged and hostile files on every reader: ``python -m benchmarks.fuzz --count 100000 --processes 2``.

Each case is made from ``--seed``, the reader and a number alone, so a run can be had again. Whatever is neither read
nor refused by one ``EndoctError`` of one line is a finding, as is one that takes over 5 s or lifts the peak of resident
memory by over 1 GB, opens files outside of the case, or ends the process. Findings are stored below ``-o`` and read
again with ``--replay PATH --reader NAME``. Status 1 where there are any, or where a reader read none of its files.
The table says how many were entered: not refused where an empty file is. POSIX only.
"""

import argparse
import sys
import time
from pathlib import Path

from benchmarks.fuzz.account_tables import groups, table, write_account
from benchmarks.fuzz.campaign import Account, plan_cases, run
from benchmarks.fuzz.outcome import outcome_of
from benchmarks.fuzz.readers import READERS, seeds_of


def main() -> int:
    """Run, or replay one finding."""
    options = _parsed()
    if options.replay is not None:
        return _replay(options.replay, options.reader[0])
    begun = printed = time.monotonic()

    def progress(account: Account) -> None:
        nonlocal printed
        if time.monotonic() - printed > 10:
            printed = time.monotonic()
            done = sum(sum(ends.values()) - ends["entered"] for ends in account.ends.values())
            print(f"{printed - begun:.0f} s: {done} cases, {account.n_findings} findings", file=sys.stderr)

    batches = plan_cases(options.count, options.reader or list(READERS))
    account = run(batches, seed=options.seed, processes=options.processes, findings=options.output, progress=progress)
    title = f"{options.count} cases, seed {options.seed}, {time.monotonic() - begun:.0f} s"
    if options.output is not None:
        write_account(account, options.output, title)
    print(f"{title}\n\n{table(account)}\n\n{groups(account)}")
    if account.reading_nothing:
        print(f"\nnothing was read by {', '.join(account.reading_nothing)}")
    return 1 if account.n_findings or account.reading_nothing else 0


def _replay(path: Path, name: str) -> int:
    """Read a finding again; ``path`` is the folder it was stored in, or what the reader shall be given."""
    case = path / "case" if (path / "case").is_dir() else path
    target = case
    if case != path:
        names = {seed.target for seed in seeds_of(name)}
        there = sorted(one for one in case.iterdir() if one.name in names)
        target = case if "" in names else (there or sorted(case.iterdir()))[0]
    reader, folder = READERS[name], case if case.is_dir() else case.parent
    outcome = outcome_of(reader.read, target, case=folder, seconds=reader.seconds)
    print(f"{outcome.kind} {outcome.where}\n{outcome.message}")
    return 1 if outcome.is_finding else 0


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="cases in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", nargs="+", choices=list(READERS), help="only these")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, help="folder for findings and their table")
    parser.add_argument("--replay", type=Path, help="a stored finding, or a file; --reader says who reads it")
    options = parser.parse_args()
    if options.replay is not None and len(options.reader or ()) != 1:
        parser.error("--replay needs one --reader")
    return options


if __name__ == "__main__":
    sys.exit(main())
