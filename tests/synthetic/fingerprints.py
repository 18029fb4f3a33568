"""What seeds make stays as it is, since published sets are made again from their seeds: a few numbers of each array.

After a change on purpose, ``python -m tests.synthetic.fingerprints`` writes ``fingerprints.json`` anew.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope import camera
from endoct.synthetic.labels.pullback_labels import artefacts, look_along
from endoct.synthetic.model import Model, build_model
from endoct.synthetic.oct import bscan
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.ranges import Range
from endoct.synthetic.specimen_files import endoscope_sidecar, oct_sidecar, spectra_sidecar, tube_file
from endoct.synthetic.truth import recording

FILE = Path(__file__).with_suffix(".json")
DIRTY: Mapping[str, Range] = {"bore.dust": (0.1, 0.1), "bore.fluid": (0.1, 0.1)}
KINDS: Mapping[str, Mapping[str, Range]] = {
    "phantom": {"bore.bone": ("phantom",), "oct.scan": ("step",), "endoscope.colour": ("true",), **DIRTY},
    "mastoid": {"bore.bone": ("mastoid",), "oct.lost_blocks": (3.0, 3.0), **DIRTY},
    "network": {"bore.bone": ("network",), "oct.scan": ("helical",), **DIRTY},
    "tube": {},
}
SLICE = 5
MOVED = 0.005
"""By so much of its standard deviation a number of an array may differ: a sample or two on the other side of an edge,
as the arithmetic of another machine may put them."""


def fingerprint(values: ArrayLike) -> list[float]:
    """Return the standard deviation of values, their mean, and three weighted sums of about the values' size.

    What is not finite counts as 0. A change of the share ``s`` of all values by ``d`` moves a sum by about ``d·√s``.
    """
    flat = np.nan_to_num(np.asarray(values, np.float64).ravel(), posinf=0, neginf=0)
    weights = np.random.default_rng(7).normal(size=(3, flat.size))
    return [float(flat.std()), float(flat.mean()), *(weights @ flat / np.sqrt(flat.size)).tolist()]


@cache
def model(kind: str) -> Model:
    """Return one of the models, of a small specimen."""
    return build_model(draw("tube" if kind == "tube" else "learning", 4, ranges=KINDS[kind]))


def numbers_in(value: object) -> Iterator[float]:
    """Yield all numbers in a value of JSON, large ones as their logarithm, and the lengths of texts."""
    if isinstance(value, Mapping):
        value = [*value.values()]
    if isinstance(value, list | tuple):
        for part in value:
            yield from numbers_in(part)
    elif value is not None:
        yield float(np.arcsinh(1000 * (len(value) if isinstance(value, str) else value)))  # type: ignore[operator]


def of_sample(preset: str) -> dict[str, ArrayLike]:
    """Return all that is drawn for a preset, and what is stated of it, by seed."""
    samples = {seed: draw(preset, seed) for seed in range(2)}  # type: ignore[arg-type]
    stated = endoscope_sidecar, oct_sidecar, spectra_sidecar, tube_file
    return {f"seed {seed}": [*numbers_in(sample.model_dump())] for seed, sample in samples.items()} | {
        f"stated of seed {seed}": [*numbers_in([keys_of(sample) for keys_of in stated])]
        for seed, sample in samples.items()
    }


def of_wall(kind: str) -> dict[str, ArrayLike]:
    """Return the maps of a wall."""
    maps = model(kind).wall.maps()
    return {each.name: getattr(maps, each.name) for each in fields(maps)}


def of_oct(kind: str) -> dict[str, ArrayLike]:
    """Return a slice, without noise and with it, and its spectra."""
    of = model(kind)
    given = of.sample, of.wall, of.appearance, SLICE
    return {"sharp": bscan.noise_free(*given), "noisy": bscan.render_bscan(*given), "spectra": bscan.spectra(*given)}


def of_frame(kind: str) -> dict[str, ArrayLike]:
    """Return a frame, without noise and with it."""
    of = model(kind)
    given = of.sample, of.wall.maps(), of.lighting, SLICE
    return {"sharp": camera.noise_free(*given), "noisy": camera.render_frame(*given)}


def of_labels(kind: str) -> dict[str, ArrayLike]:
    """Return what is true of a pullback, its artefacts and what its file of the truth says."""
    pullback, said = look_along(model(kind), 1), recording(model(kind).sample)
    arrays = {each.name: getattr(pullback, each.name) for each in fields(pullback)}
    return {**arrays, "artefacts": artefacts(model(kind), SLICE), "said": [*numbers_in(said)]}


PARTS: Mapping[str, tuple[Callable[[str], dict[str, ArrayLike]], tuple[str, ...]]] = {
    "sample": (of_sample, tuple(PRESETS)),
    "wall": (of_wall, tuple(KINDS)),
    "oct": (of_oct, tuple(KINDS)),
    "frame": (of_frame, tuple(KINDS)),
    "labels": (of_labels, tuple(KINDS)),
}


def changed(part: str, kind: str) -> list[str]:
    """Return the arrays of a part that are not as they were, by name."""
    before = json.loads(FILE.read_text())[f"{part}: {kind}"]
    now = {name: fingerprint(values) for name, values in PARTS[part][0](kind).items()}
    differ = set(before) ^ set(now)
    for name in set(before) & set(now):
        share = 1e-5 if part == "sample" else MOVED
        size = max(before[name][0], 1e-3 * abs(before[name][1]))  # a single number has no standard deviation
        close = np.abs(np.subtract(before[name], now[name])) <= share * size
        differ |= set() if close.all() else {name}
    return sorted(differ)


if __name__ == "__main__":
    found = {
        f"{part}: {kind}": {name: [float(f"{x:.7g}") for x in fingerprint(v)] for name, v in of(kind).items()}
        for part, (of, kinds) in PARTS.items()
        for kind in kinds
    }
    lines = (f"{json.dumps(part)}: {json.dumps(arrays)}" for part, arrays in found.items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
