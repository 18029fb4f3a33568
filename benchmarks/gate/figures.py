"""What a world comes to in figures, and which of them are worse than recorded."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.gate.worlds import Numbers

Figures = Mapping[str, float]
Recorded = Mapping[str, Mapping[str, tuple[float, float]]]
"""By world and figure: what it was, and by how much it may be worse."""


@dataclass(frozen=True)
class Kind:
    """How a number of cases becomes figures: which way is better, and by how much median and worst may lose."""

    better: Literal["more", "less"]
    may_lose: tuple[float, float]


KINDS: Mapping[str, Kind] = {
    "jaccard_oct": Kind("more", (0.01, 0.03)),
    "jaccard_endoscope": Kind("more", (0.02, 0.05)),
    "jaccard_pair": Kind("more", (0.02, 0.05)),
    "wrong_oct": Kind("less", (0.002, 0.01)),
    "target_mm": Kind("less", (0.03, 0.1)),
    "wall_px": Kind("less", (0.05, 0.05)),
    "wall_90_px": Kind("less", (0.1, 0.1)),
    "valid": Kind("more", (0.01, 0.01)),
}
COUNTS: Mapping[str, tuple[Literal["more", "less"], float]] = {
    "aligned": ("more", 0),
    "told": ("more", 0),
    "doubted": ("less", 1),
    "silent": ("less", 0),
    "believed": ("less", 0),
    "crashed": ("less", 0),
}
SIGMAS = ("error_theta_sigmas", "error_z_sigmas", "error_scale_sigmas")
WITHIN_MAY_LOSE = 0.1
"""Of the share of cases within two stated standard errors."""
MOVED = 0.002
"""What moves by less is not printed."""
FAULTY = "broken"
"""Of this world doubts are wanted, and an alignment that nobody doubts is not; of the others it is the reverse."""


def figures_of(world: str, cases: Sequence[Numbers]) -> Figures:
    """Return the figures of a world: medians and worst cases, counts, and how the stated errors hold."""
    figures: dict[str, float] = {}
    for name, kind in KINDS.items():
        values = _known(cases, name)
        if values.size and world != FAULTY:
            figures[f"{name} median"] = float(np.median(values))
            figures[f"{name} worst"] = float(values.min() if kind.better == "more" else values.max())
    for name in COUNTS:
        values = _known(cases, name)
        if values.size and (name == "believed") <= (world == FAULTY) and not (world == FAULTY and name in _OF_SOUND):
            figures[name] = float(values.sum())
    for name in SIGMAS:
        values = np.abs(_known(cases, name))
        if values.size and world != FAULTY:
            figures[f"{name} within 2"] = float(np.mean(values <= 2))
            figures[f"{name} rms"] = float(np.sqrt(np.mean(values**2)))
    if (inside := _known(cases, "inside_95")).size:
        figures["inside_95 mean"] = float(inside.mean())
    return figures


_OF_SOUND = ("aligned", "doubted", "silent")


def may_lose(figure: str) -> float | None:
    """Return by how much a figure may be worse than recorded; None where it only informs."""
    name, _, of = figure.partition(" ")
    if name in KINDS:
        return KINDS[name].may_lose[of == "worst"]
    if name in COUNTS:
        return COUNTS[name][1]
    return WITHIN_MAY_LOSE if of == "within 2" else None


def lost(figure: str, recorded: float, now: float) -> float:
    """Return by how much a figure is worse than recorded, negative where it is better."""
    name, _, of = figure.partition(" ")
    more = of == "within 2" or (KINDS[name].better if name in KINDS else COUNTS[name][0]) == "more"
    return recorded - now if more else now - recorded


def compared(world: str, now: Figures, recorded: Mapping[str, float]) -> Iterator[tuple[str, bool]]:
    """Yield a line for each figure of a world that moved, and whether it got worse by more than it may."""
    for figure, value in now.items():
        if figure not in recorded:
            yield f"{world:9s} {figure:28s} {'':>8s} → {value:8.3f}  not recorded yet", False
            continue
        before, allowed = recorded[figure], may_lose(figure)
        worse = allowed is not None and lost(figure, before, value) > allowed + 1e-9
        if worse or abs(value - before) > MOVED:
            said = f"  WORSE, by more than {allowed:g}" if worse else ""
            yield f"{world:9s} {figure:28s} {before:8.3f} → {value:8.3f}{said}", worse
    for figure in recorded.keys() - now.keys():
        yield f"{world:9s} {figure:28s} {recorded[figure]:8.3f} → none  WORSE: nothing came of it", True


def _known(cases: Sequence[Numbers], name: str) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    values = np.array([case.get(name, np.nan) for case in cases], dtype=np.float64)
    return values[np.isfinite(values)]
