"""One drawn volume, with a fault or without, given to the reader: what becomes of it."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.ct_faults import codings
from benchmarks.ct_faults.drawn import Drawn, drawn
from benchmarks.ct_faults.faults import FAULTS, SOUND, Write
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import CtVolume, holds_labels, read_ct
from endoct.modalities.reading.recording import open_stack

PLACE_MM = 0.01
WRITERS: Mapping[str, Write] = {**FAULTS, **SOUND}
CODINGS = {"CT coded": codings.ct, "pictures coded": codings.pictures}
RIGHT, REFUSED, DOUBTED, BELIEVED = "right", "refused", "doubted", "believed"


@dataclass(frozen=True)
class Trial:
    """``end``: right, where every voxel is placed and valued as it was drawn; refused; doubted by name; or believed."""

    fault: str
    number: int
    end: str
    said: str


def tried(fault: str, number: int, seed: int, scratch: Path) -> Trial:
    """Write a volume with a fault, or a sound one, into ``scratch``, read it as a CT, and say what became of it."""
    rng = Random(f"{seed} {fault} {number}")
    volume = drawn(rng)
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    path, truth = WRITERS[fault](scratch, volume, rng)
    try:
        ct = read_ct(path)
        holds_labels(ct, "the CT", "")
    except EndoctError as error:
        return Trial(fault, number, REFUSED, str(error))
    if _is_right(ct, truth):
        return Trial(fault, number, RIGHT, "; ".join(ct.notes))
    end = DOUBTED if ct.doubts else BELIEVED
    return Trial(fault, number, end, "; ".join(doubt.what for doubt in ct.doubts) or f"{ct.kind}: {path}")


def tried_coding(kind: str, number: int, seed: int, scratch: Path) -> Trial:
    """Write a CT or pictures whose header and samples were drawn, read them, and say what became of them.

    A sound one that is not right, without a doubt, is "believed" too, so that it counts as wrong.
    """
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    coded = CODINGS[kind](scratch, Random(f"{seed} {kind} {number}"))
    try:
        if kind == "CT coded":
            ct = read_ct(coded.path)
            frames, doubts = ct.voxels, ct.doubts
        else:
            stack = open_stack(coded.path)
            frames, doubts = np.stack([stack[k] for k in range(len(stack))]), stack.remarks.doubts
    except EndoctError as error:
        return Trial(coded.said, number, BELIEVED if coded.sound else REFUSED, str(error))
    doubts = tuple(
        doubt for doubt in doubts if doubt.code in ("dicom-header-against-pictures", "ct-padding-like-tissue")
    )
    said = "; ".join(doubt.what for doubt in doubts)
    if codings.is_right(frames, coded):
        return Trial(coded.said, number, BELIEVED if coded.sound and doubts else RIGHT, said)
    return Trial(coded.said, number, DOUBTED if doubts and not coded.sound else BELIEVED, said)


def _is_right(ct: CtVolume, truth: Drawn) -> bool:
    """Whether the corners and the marked voxel lie where they were drawn, and all values are those."""
    if ct.voxels.shape != truth.voxels.shape:
        return False
    last = np.array(truth.voxels.shape) - 1
    index = np.array([*np.ndindex(2, 2, 2)]) * last
    index = np.vstack([index, truth.mark]).astype(np.float64)
    expected = np.array([truth.place(*at) for at in index])
    # slices may come in the other order, as they lie
    for forth, at in ((1, index), (-1, np.abs(index - [last[0], 0, 0]))):
        apart = np.abs(ct.origin_mm + at @ ct.steps_mm - expected).max()
        if apart <= PLACE_MM and np.array_equal(ct.voxels[::forth], truth.voxels):
            return True
    return False
