"""Run the gate: go through all worlds, print what moved against the record, fail where anything got worse.

    make gate                                       or
    python -m benchmarks.gate [--only WORLD …] [--workers 2] [--record]

``--record`` writes what it comes to as the new record; commit that with the reason. ENDOCT_RECORDINGS names the folder
of the real recordings; without it these are left out, and said to be.
"""

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.gate.figures import compared, figures_of
from benchmarks.gate.worlds import WORLDS, Numbers, World

RECORD = Path(__file__).with_name("record.json")


def main() -> int:
    """Return 1 where something got worse."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gate", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=[world.name for world in WORLDS], default=None)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    record = json.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}
    began, failed = time.monotonic(), False
    with ProcessPoolExecutor(options.workers) as pool:
        for world in WORLDS:
            if options.only and world.name not in options.only:
                continue
            if world.recordings and not os.environ.get("ENDOCT_RECORDINGS"):
                print(f"{world.name:9s} left out: ENDOCT_RECORDINGS does not name the real recordings")
                continue
            began_world = time.monotonic()
            cases = list(pool.map(_case, [world.name] * world.cases, world.seeds))
            now = figures_of(world.name, cases)
            lines = list(compared(world.name, now, record.get(world.name, {})))
            took = time.monotonic() - began_world
            print(f"{world.name:9s} {world.cases} cases, {took:.0f} s; {len(lines)} of {len(now)} figures moved")
            for line, worse in lines:
                print(f"  {line}", flush=True)
                failed |= worse
            if options.record:
                record[world.name] = {name: round(value, 4) for name, value in now.items()}
    print(f"{time.monotonic() - began:.0f} s in all; {'something got WORSE' if failed else 'nothing got worse'}")
    if options.record:
        RECORD.write_text(json.dumps(record, indent=1) + "\n", "utf-8")
        print(f"recorded in {RECORD.name}: commit it with the reason")
        return 0
    return int(failed)


def _case(name: str, seed: int) -> Numbers:
    world: World = next(world for world in WORLDS if world.name == name)
    return world.of(seed)


if __name__ == "__main__":
    sys.exit(main())
