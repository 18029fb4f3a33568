"""Draw recordings as people have them, and count those believed: ``python -m benchmarks.frame_faults --count 400``.

Folders that are shuffled, renamed, doubled and mixed; images and masks coded in every way; videos with lost frames, of
variable rate, cut by edit lists. Status 1 where one is believed and is not right, or a sound one is refused.
"""

import argparse
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

from benchmarks.frame_faults.trial import ALL, BELIEVED, DOUBTED, MUST_BE_READ, REFUSED, RIGHT, tried

ENDS = (RIGHT, REFUSED, DOUBTED, BELIEVED)


def main() -> int:
    """Try all, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frame_faults", description=__doc__)
    parser.add_argument("--count", type=int, default=400, help="recordings in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fault", nargs="+", choices=ALL, help="only these")
    options = parser.parse_args()
    faults = options.fault or list(ALL)
    counts: Counter[tuple[str, str]] = Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(options.count):
            trial = tried(faults[number % len(faults)], number, options.seed, Path(scratch) / "case")
            counts[trial.fault, trial.end] += 1
            if trial.end == BELIEVED or (trial.fault in MUST_BE_READ and trial.end == REFUSED):
                wrong.append(trial)
    print(f"{'':<30}" + "".join(f"{end:>10}" for end in ENDS))
    for name in dict.fromkeys(faults):
        print(f"{name:<30}" + "".join(f"{counts[name, end]:>10}" for end in ENDS))
    print(f"{'all':<30}" + "".join(f"{sum(counts[name, end] for name in faults):>10}" for end in ENDS))
    for trial in wrong:
        print(f"{trial.end}: {trial.fault}, number {trial.number}: {trial.said}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
