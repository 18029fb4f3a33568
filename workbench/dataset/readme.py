"""The files of words in a data set: its licence and its README."""

from endoct.workbench.dataset.plan import SPLITS, Plan, split_of
from endoct.workbench.pipeline.vary import ranges_text

LICENCE = """\
SPDX-License-Identifier: CC0-1.0

Creative Commons CC0 1.0 Universal, Public Domain Dedication
https://creativecommons.org/publicdomain/zero/1.0/

To the extent possible under law, the person who generated this data set has waived all copyright and related or
neighbouring rights to it: to the simulated recordings, their truth and labels, the manifest and the pictures. You
can copy, modify and distribute them and use them in any way, also commercially, without asking permission. They come
without warranty. The legal code is at https://creativecommons.org/publicdomain/zero/1.0/legalcode

This says nothing of the program that generated the data set, which has a licence of its own.
"""

README = """\
# {count} simulated specimens, preset {preset}, seed {seed}

Each specimen is a drill hole in bone, recorded by a cone-mirror endoscope and by a catheter OCT, with its truth. All
of it is simulated; no recording of a real bore is in it. Public domain, see LICENSE. Look at `contact_sheet.png` first.

- `manifest.csv`: a line a specimen: index, name, split, seed, bore, bore_seed, digest, path, and every drawn number
  and word as `part.name`. Angles are in rad, lengths in mm, as the names say.
- {splits}. Splits are by bore: no two show the same one{bores}.
- `dataset.json`: the arguments and versions it was made with. Drawn otherwise than by preset: {vary}.
- {layout}
- `records/`: sha256 of every file, by which an interrupted `endoct dataset` knows what is finished.
  A specimen's digest is the sha256 of the lines of `sha256sum` over its files, sorted by path.

Bore frame, right-handed: z in mm along the bore, growing inward from the mouth; θ = atan2(y, x) in rad, clockwise
when looking in; r in mm from the axis. Axis order z, θ, depth, channel; θ is a circle.

    from torch.utils.data import DataLoader
    from endoct.workbench.dataset import Specimens
    loader = DataLoader(Specimens("path/to/this/folder", split="train"), batch_size=4, shuffle=True, num_workers=2)

Each step has `oct` u8 (batch, slice, depth, A-scan), `endoscope` u8 (batch, frame, row, column, RGB), and the truth
`relief_mm`, `cell` and `cell_id` (batch, z, θ).
"""
FOLDERS = """\
`specimens/NAME/`: `oct/pullback.tif` (slice, depth, A-scan), `endoscope/`, each with its `acquisition.toml`,
  and `truth/`, as `endoct simulate` writes them; `endoct compare` reads them."""
SHARDS = """\
`shards/SPLIT-NUMBER.tar`: {per_shard} specimens each (the last of a split fewer), for the webdataset library:
  `NAME.oct.npy`, `NAME.endoscope.npy`, `NAME.relief_mm.npy` … and `NAME.sample.json`, from which
  `endoct simulate --replay` makes the specimen's folder again."""


def readme(plan: Plan) -> str:
    """Return the README of the set."""
    counts = dict.fromkeys(SPLITS, 0)
    for index in range(plan.count):
        counts[split_of(plan, index)] += 1
    return README.format(
        count=plan.count,
        preset=plan.preset,
        seed=plan.seed,
        splits=", ".join(f"{split} {count}" for split, count in counts.items()).capitalize(),
        bores=f", and each bore has {plan.recordings_per_bore} recordings" if plan.recordings_per_bore > 1 else "",
        vary=ranges_text(plan.ranges),
        layout=SHARDS.format(per_shard=plan.specimens_per_shard) if plan.format == "webdataset" else FOLDERS,
    )
