"""A small recording drawn at random: frames of noise, each of which is known again by its samples, and their places."""

from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

PITCH_MM = 0.2
RATE_HZ = 25.0
SHAPE = (48, 64)

Frames = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is right: ``frames`` (n, rows, columns), or in colour, in their order, ``places_mm`` (n,) along the travel.

    ``kind``: "oct" or "endoscope"; ``exact``: samples are those that were drawn, not lossy ones; ``doubted``: the code
    of the doubt without which it would be believed wrongly.
    """

    frames: Frames
    places_mm: NDArray[np.float64]
    kind: str = "oct"
    exact: bool = True
    doubted: str = ""

    def part(self, kept: Any) -> "Truth":
        """Return what is right where only some frames are kept, by index."""
        return Truth(self.frames[kept], self.places_mm[kept], self.kind, self.exact)

    def at(self, places_mm: Any) -> "Truth":
        """Return the same frames at other places."""
        return Truth(self.frames, np.asarray(places_mm, np.float64), self.kind, self.exact)


def drawn(rng: Random, least: int = 6, most: int = 14) -> Truth:
    """Return a recording of some frames at even places."""
    n = rng.randint(least, most)
    noise = np.random.default_rng(rng.randrange(1 << 32)).integers(0, 256, (n, *SHAPE), dtype=np.uint8)
    return Truth(noise, PITCH_MM * np.arange(n))


def with_sidecar(folder: Path, kind: str, **keys: object) -> Path:
    """Write the sidecar of a recording into ``folder``."""
    stated: dict[str, object] = {"modality": kind, "bore_diameter_mm": 2.5, "travel": "in"}
    if kind == "oct":
        stated |= {"axial_pixel_mm": 0.02, "pullback_pitch_mm": PITCH_MM, "capillary_outer_diameter_mm": 1.7}
    else:
        stated |= {"visible_length_mm": 1.0, "frame_rate_hz": RATE_HZ, "feed_speed_mm_s": PITCH_MM * RATE_HZ}
    lines = [f"{key} = {value!r}".replace("'", '"') for key, value in (stated | keys).items()]
    (folder / "acquisition.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def missing(rng: Random, n: int) -> list[int]:
    """Return which of ``n`` frames are left where one or two runs of them are missing inside; most neighbours stay."""
    gone: set[int] = set()
    for _ in range(rng.choice((1, 1, 2))):
        first = rng.randint(2, n - 3)
        gone |= set(range(first, min(first + rng.choice((1, 1, 2, 3)), n - 1)))
    kept = [k for k in range(n) if k not in gone]
    return kept if len(kept) > 3 else [k for k in range(n) if k != n // 2]
