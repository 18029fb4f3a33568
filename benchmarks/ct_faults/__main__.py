"""Draw volumes with one fault each, and count those believed: ``python -m benchmarks.ct_faults --count 1000``.

Half as many without a fault follow, which all have to be read to 0.01 mm. Status 1 where a fault is believed, or a
sound volume is not read.
"""

import argparse
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

from benchmarks.ct_faults.faults import FAULTS, SOUND
from benchmarks.ct_faults.trial import BELIEVED, CODINGS, DOUBTED, REFUSED, RIGHT, tried, tried_coding

ENDS = (RIGHT, REFUSED, DOUBTED, BELIEVED)


def main() -> int:
    """Try all, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ct_faults", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="volumes with a fault")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fault", nargs="+", choices=[*FAULTS, *SOUND], help="only these")
    parser.add_argument("--codings", type=int, default=0, help="drawn headers and samples of DICOM instead of volumes")
    options = parser.parse_args()
    if options.codings:
        return _codings(options.codings, options.seed)
    faults = options.fault or list(FAULTS)
    names = [faults[number % len(faults)] for number in range(options.count)]
    sound = [] if options.fault else [list(SOUND)[number % len(SOUND)] for number in range(options.count // 2)]
    counts: Counter[tuple[str, str]] = Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number, name in enumerate([*names, *sound]):
            trial = tried(name, number, options.seed, Path(scratch) / "case")
            counts[name, trial.end] += 1
            if trial.end == BELIEVED or (name in SOUND and trial.end != RIGHT):
                wrong.append(trial)
    print(f"{'':<26}" + "".join(f"{end:>10}" for end in ENDS))
    for name in dict.fromkeys([*names, *sound]):
        print(f"{name:<26}" + "".join(f"{counts[name, end]:>10}" for end in ENDS))
    for some, title in ((names, "all with a fault"), (sound, "all without")):
        print(f"{title:<26}" + "".join(f"{sum(counts[name, end] for name in set(some)):>10}" for end in ENDS))
    for trial in wrong:
        print(f"{trial.end}: {trial.fault}, number {trial.number}: {trial.said}")
    return 1 if wrong else 0


def _codings(count: int, seed: int) -> int:
    """Try drawn headers against drawn samples, and print a table by what was drawn."""
    counts: Counter[tuple[str, str]] = Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(count):
            kind = list(CODINGS)[number % 2]
            trial = tried_coding(kind, number, seed, Path(scratch) / "case")
            counts[f"{kind}, {trial.fault.split()[1]}", trial.end] += 1
            if trial.end == BELIEVED:
                wrong.append(trial)
    print(f"{'':<26}" + "".join(f"{end:>10}" for end in ENDS))
    for name in sorted({name for name, _ in counts}):
        print(f"{name:<26}" + "".join(f"{counts[name, end]:>10}" for end in ENDS))
    print(
        f"{'all':<26}" + "".join(f"{sum(counts[name, end] for name, end in counts if end == one):>10}" for one in ENDS)
    )
    for trial in wrong:
        print(f"{trial.end}: number {trial.number}: {trial.fault}: {trial.said}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
