"""What can be done about a comparison that was not aligned, or is doubted: by its causes, one step each.

A step is there only where it can help against its cause. What the two sidecars stated comes from the panoramas.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Literal

from endoct.base.doubt import Doubt
from endoct.fusion.result import Result, StoredAlignment
from endoct.modalities.registry import manifests
from endoct.stitching.panorama import TRAVEL_BY_DEFAULT

Does = Literal["compare", "other", "show", "read", "landmarks", "draw", "describe", "nothing"]
Stated = Mapping[str, Mapping[str, Any]]
"""By side, the provenance of its panorama."""

FLIPPED = {"in": "out", "out": "in", "same": "mirrored", "mirrored": "same"}
SIDECAR = {
    "stated-otherwise": "the files and the sidecar state different values",
    "rims-eccentric": "state annulus",
    "rim-moves": "state annulus",
    "wall-within-inner-rim": "state annulus",
    "ring-partly-still": "state annulus",
    "no-wall-moves": "state annulus",
    "capillary-against-stated": "see which line was taken for the capillary",
    "wall-far-from-nominal": "see which line was taken for the capillary",
}
"""Doubts of how a recording was read, and what to look for in its sidecar's form, which draws a frame."""
PLACES = ("parts-out-of-place", "step-along-the-bore", "bent-along-the-bore")
PAIRS = (*PLACES, "cells-drift-apart", "aligned-by-rims", "one-cell-aligns", "landmarks-disagree", "scale-by-hand")
QUALITY = (
    *PLACES, "cells-drift-apart", "scale-at-limit", "little-observed", "little-observed-by-both", "one-row",
    "nearest-wall-lost", "gap-along-pullback", "wall-under-lines", "noise-near-wall", "turns-uneven", "ring-saturated",
    "bore-end-in-view", "frames-not-matched", "frames-repeated",
)  # fmt: skip
"""Doubts of which the quality of every frame says more."""
CELLS = (
    "cells-unsure", "cells-by-eye-alone", "cells-in-noise", "cells-faint", "cells-without-outline", "wall-mostly-cells",
    "bone-before-surface", "darkness-behind-wall",
)  # fmt: skip
UNDONE = {"forced": "force=false", "aligned-by-method": "alignment_method=endoct"}
"""Doubts of a setting of the comparison, and the setting without which they are not there."""
TRUST_PAIRS = ("corrected-by-hand", "aligned-by-hand", "orientation-by-hand")
MORE_CELLS = ("score-uncertain", "few-cells-decide", "nothing-to-score")


@dataclass(frozen=True)
class NextStep:
    """One thing to do next: ``what``, in words of a button, and ``why`` it may help, in a sentence.

    Attributes
    ----------
    does: compare again, with ``settings`` and those of the sides; compare side A with another recording; show
        ``z_mm`` in the panes; read a section on the quality of ``side``; place landmarks; draw the cells of ``side``;
        look at how ``side`` is described; or nothing, where words are all there is.
    """

    does: Does
    what: str
    why: str = ""
    side: str = ""
    z_mm: float | None = None
    settings: tuple[str, ...] = ()
    settings_a: tuple[str, ...] = ()
    settings_b: tuple[str, ...] = ()

    def request(self, result: Result) -> dict[str, str | tuple[str, ...]] | None:
        """Return what to ask `endoct compare` for, as the first time but for the settings of this step.

        None where the step compares nothing, or the result does not say what was asked for. Of a step to another
        recording, side B is left open.
        """
        asked: dict[str, Any] = dict(result.asked)
        if self.does not in ("compare", "other") or not {"a", "b"} <= asked.keys():
            return None
        for name in ("settings", "settings_a", "settings_b"):
            changed = getattr(self, name)
            keys = {each.partition("=")[0] for each in changed}
            if kept := (
                *(each for each in asked.get(name, ()) if each.partition("=")[0].strip() not in keys),
                *changed,
            ):
                asked[name] = kept
            if changed and name != "settings" and PurePath(asked[name[-1]]).suffix == ".zarr":
                return None  # what was unrolled already takes no keys of a sidecar
        return {**asked, "b": ""} if self.does == "other" else asked

    def to_json(self, result: Result) -> dict[str, Any]:
        """Return the step for a list of results: with its request, and where the recording of its side lay."""
        places = dict(zip(result.sides, (result.asked.get("a", ""), result.asked.get("b", "")), strict=True))
        said = {"does": self.does, "what": self.what, "why": self.why, "recording": places.get(self.side, "")}
        asked = self.request(result)
        return said if asked is None else {**said, "values": asked}

    def command(self, result: Result, output: str) -> str:
        """Return the command line that writes this step's comparison to ``output``; "" where there is none."""
        asked = self.request(result)
        if asked is None:
            return ""
        words = ["endoct", "compare", str(asked.pop("a")), str(asked.pop("b")) or "RECORDING", f"--output={output}"]
        for name, value in asked.items():
            flag = "--" + name.replace("settings", "set").replace("_", "-")
            if name == "truth":
                words += [flag, *value]
            else:
                words += [f"{flag}={each}" for each in ([value] if isinstance(value, str) else value)]
        return shlex.join(words)


def next_steps(result: Result, stated: Stated) -> tuple[NextStep, ...]:
    """Return what can be done about ``result``, the surest step first; none where nothing but its interval is doubted.

    A trusted result has one where the direction of travel rests on a default. ``stated`` has the provenance of the
    panorama of each side.
    """
    steps = [*_of_travel(result, stated)]
    if not result.aligned:
        steps += _unaligned(result, stated)
    elif result.doubts or result.forced:
        steps += _doubted(result, stated)
        if not steps:
            what = "Nothing is known that would settle it: look at the figures before you rely on the score"
            steps = [NextStep("nothing", what)]
    return tuple(dict.fromkeys(steps))


def _unaligned(result: Result, stated: Stated) -> Iterator[NextStep]:
    a, b = result.sides
    suspected = False
    if result.best_ruled_out is not None:
        for step in _turned(result, result.best_ruled_out, stated):
            suspected = True
            yield step
    for remedy in result.remedies:
        suspected = True
        yield _set(result, [(remedy.side, remedy.key, f"{remedy.agreeing:.4g}")], "With it the two would align.")
    if not suspected:
        why = "No orientation and no scale along the bore lays one on the other, as where recordings were mixed up."
        yield NextStep("other", f"Perhaps another bore: compare {a} with…", why, b)
    yield from (_quality(side, "A wall or a ring that was not found aligns with nothing.") for side in (a, b))
    why = "Two pairs establish an alignment, three where the sidecars leave the orientation open."
    yield NextStep("landmarks", "Place three landmarks, where you see the same cells on both sides", why)


def _turned(result: Result, ruled_out: StoredAlignment, stated: Stated) -> Iterator[NextStep]:
    """Yield what one sidecar would have to state so that ``ruled_out`` is no longer ruled out; two may be at fault."""
    why = "Turned around so, the two align."
    hands = [each for side in reversed(result.sides) if (each := _flipped(side, "handedness", stated))]
    ways = [each for side in result.sides if (each := _flipped(side, "travel", stated))]
    # a default is the first to suspect, then what is unusual for an instrument
    ways.sort(key=lambda way: (TRAVEL_BY_DEFAULT not in stated[way[0]], way[2] != _usual_travel(way[0], stated)))
    if ruled_out.mirrored and not hands:
        return
    for way in ways if ruled_out.z_reversed else ():
        which = " One of the two sidecars is wrong; it decides which end of the bore is up." if len(ways) > 1 else ""
        yield _set(result, [way, *hands[: ruled_out.mirrored]], why + which)
    for hand in () if ruled_out.z_reversed else hands:
        yield _set(result, [hand], why)


def _flipped(side: str, key: str, stated: Stated) -> tuple[str, str, str] | None:
    flipped = FLIPPED.get(str(_acquisition(side, stated).get(key)))
    return None if flipped is None else (side, key, flipped)


def _usual_travel(side: str, stated: Stated) -> object:
    """Return which way the instrument of a side moves unless it is stated otherwise; None where that is not known."""
    manifest = manifests().get(str(_acquisition(side, stated).get("modality")))
    return None if manifest is None else manifest.acquisition.model_fields["travel"].default


def _doubted(result: Result, stated: Stated) -> Iterator[NextStep]:
    for doubt in result.doubts:
        sides = (doubt.side,) if doubt.side in result.sides else result.sides
        yield from _by_value(result, doubt, stated)
        if doubt.code == "handedness-contradicted":
            for change in filter(None, (_flipped(side, "handedness", stated) for side in reversed(result.sides))):
                yield _set(result, [change], "The side then fits as its sidecar has it.")
        if doubt.code in UNDONE:
            yield NextStep("compare", f"Compare again with {UNDONE[doubt.code]}", settings=(UNDONE[doubt.code],))
        if doubt.code in ("compared-with-itself", "nothing-to-score"):
            yield NextStep("other", f"Compare {result.sides[0]} with…", "", result.sides[1])
        if doubt.code in PLACES and doubt.z_mm is not None:
            z_mm = sum(doubt.z_mm) / 2
            yield NextStep("show", f"Show what lies out of place, at z = {z_mm:.1f} mm", z_mm=z_mm)
        if doubt.code in SIDECAR and doubt.side is not None:
            yield NextStep(
                "describe", f"See how {doubt.side} is described", f"Look: {SIDECAR[doubt.code]}.", doubt.side
            )
        if doubt.code in QUALITY:
            yield from (_quality(side, "It says which frames are not valid, and why.") for side in sides)
        if doubt.code in CELLS:
            yield from (
                NextStep(
                    "draw", f"Correct the cells of {side}", "A mask drawn by hand can be compared in its place.", side
                )
                for side in sides
            )
        if doubt.code in PAIRS:
            why = "Pairs that only check say how far it is off; three that correct move it."
            yield NextStep("landmarks", "Place landmarks where you see the same cells", why)
        if doubt.code in TRUST_PAIRS and (result.by_hand is None or result.by_hand.check is None):
            yield NextStep("landmarks", "Place landmarks that only check", "They say how far the alignment is off.")
        if doubt.code in MORE_CELLS:
            why = "No setting changes that."
            yield NextStep("nothing", "A longer recording, or one of more cells, would settle the score", why)


def _by_value(result: Result, doubt: Doubt, stated: Stated) -> Iterator[NextStep]:
    """Yield to compare with the value that a recording itself suggests for a key of its sidecar."""
    if doubt.key is None or doubt.value is None or doubt.side not in result.sides:
        return
    value, both = f"{doubt.value:.4g}", doubt.key == "bore_diameter_mm"  # which has to be the same on both
    sides = [side for side in result.sides if doubt.key in _acquisition(side, stated)] if both else [doubt.side]
    yield _set(result, [(side, doubt.key, value) for side in sides], "It is what the recording itself suggests.")


def _of_travel(result: Result, stated: Stated) -> Iterator[NextStep]:
    """Yield to turn the bore around where nothing but a default says which of its ends is up."""
    taken = {side: stated.get(side, {}).get(TRAVEL_BY_DEFAULT) for side in result.sides}
    known = [side for side in result.sides if _acquisition(side, stated).get("travel") in ("in", "out")]
    if result.aligned and known and all(taken[side] for side in known):
        side = known[0]
        why = f"Nothing states which way {side} moved; {taken[side]} was assumed. The bore may be upside down."
        yield _set(result, [(side, "travel", FLIPPED[str(taken[side])])], why)


def _set(result: Result, changes: Sequence[tuple[str, str, str]], why: str) -> NextStep:
    """Return to compare again with the value of a key of a side's sidecar changed."""
    said = " and ".join(dict.fromkeys(f"{key} of {side} to {value}" for side, key, value in changes))
    of_a, of_b = (tuple(f"{key}={value}" for of, key, value in changes if of == side) for side in result.sides)
    return NextStep("compare", f"Set {said} and compare again", why, settings_a=of_a, settings_b=of_b)


def _quality(side: str, why: str) -> NextStep:
    return NextStep("read", f"See how well each frame of {side} was read", why, side)


def _acquisition(side: str, stated: Stated) -> Mapping[str, Any]:
    acquisition = stated.get(side, {}).get("acquisition")
    return acquisition if isinstance(acquisition, Mapping) else {}
