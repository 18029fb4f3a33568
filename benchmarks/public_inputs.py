"""Inputs reduced from public reports, through the command line: ``python benchmarks/public_inputs.py INPUTS …``.

``INPUTS`` are the folders ``inputs`` and ``more-inputs`` of the real recordings. Each of their folders holds one input
that was read wrongly or refused for a wrong reason, with a README. Printed is a
table: what became of each before, and what becomes of it now.
Status 1 where one is not read rightly, doubted by name, or refused for the right reason.
"""

import contextlib
import io
import json
import math
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

PLACE_MM = 0.01
"""CTs are right to that."""
MARK_HU = 3000
Check = Callable[["Ran"], bool]


@dataclass(frozen=True)
class Ran:
    """What a command came to: its status, what it printed and what it said on the standard error, and its folder."""

    status: int
    out: str
    err: str
    scratch: Path

    @property
    def facts(self) -> Mapping[str, Any]:
        """What it printed, as JSON; empty where it was refused."""
        return json.loads(self.out) if self.status == 0 and self.out.startswith("{") else {}

    @property
    def said(self) -> str:
        """What it said, in one line."""
        if self.status:
            return self.err.removeprefix("endoct: ").strip()
        facts = self.facts
        remarks = [doubt["what"] for doubt in facts.get("doubts", [])] + list(facts.get("notes", []))
        return "; ".join(remarks) or f"read: {facts.get('axes', facts.get('voxels', ''))}"


@dataclass(frozen=True)
class Input:
    """``words``: the command, paths relative to the input; ``before``: what became of it; ``right`` says of now."""

    before: str
    words: tuple[str, ...]
    right: Check


def endoct(words: tuple[str, ...]) -> Ran:
    """Run the command line in this process."""
    from endoct.workbench.cli import main

    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as scratch:
        given = ["endoct", *(word.replace("SCRATCH", scratch) for word in words)]
        status = 0
        with patch.object(sys, "argv", given), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                main()
            except SystemExit as left:
                status = int(left.code or 0)
    return Ran(status, out.getvalue(), err.getvalue(), Path(scratch))


def _refused(*words: str) -> Check:
    """Refused in one line that holds ``words``."""
    return lambda ran: ran.status == 1 and ran.err.strip().count("\n") == 0 and all(word in ran.err for word in words)


def _ct(place: tuple[float, float, float], *notes: str, lps: bool = True, high: float = MARK_HU) -> Check:
    """Read, its brightest voxel within 0.01 mm of ``place``, LPS, its values those of the file; saying ``notes``."""

    def check(ran: Ran) -> bool:
        facts = ran.facts
        values = tuple(facts.get("values", (0, 0)))
        return (
            facts.get("kind") == "CT"
            and values == (-1020.0, high)
            and facts["coordinates"] == ("lps" if lps else "ras")
            and all(note in ran.said for note in notes)
        )

    check.place = place  # type: ignore[attr-defined]  # for who reads the voxels
    return check


def _as_pydicom(n: int) -> Check:
    """Read with ``n`` frames, without a word, each as pydicom reads it."""
    right = _frames(n)

    def check(ran: Ran) -> bool:
        return right(ran)

    check.as_pydicom = True  # type: ignore[attr-defined]  # for who reads the frames
    return check


def _frames(n: int, *notes: str, doubts: tuple[str, ...] = ()) -> Check:
    """Read with ``n`` frames, saying ``notes``, with doubts of these codes and no others."""

    def check(ran: Ran) -> bool:
        facts = ran.facts
        return (
            facts.get("frames") == n
            and {doubt["code"] for doubt in facts["doubts"]} == set(doubts)
            and all(note in ran.said for note in notes)
        )

    return check


def _lost(ran: Ran) -> bool:
    """Five of twenty frames lost in the middle, and those beyond placed 1 mm farther."""
    places = ran.facts.get("sidecar", {}).get("positions_mm", [0.0])
    return _frames(15, "missing")(ran) and math.isclose(places[-1], 0.2 * (len(places) - 1 + 5), abs_tol=PLACE_MM)


def _in_place(ran: Ran) -> bool:
    """Twelve places in mm, ascending, as names have them."""
    named = [0.0, 0.2, 0.25, 0.4, 0.5, 0.6, 0.75, 0.8, 1.0, 1.2, 1.25, 1.4]
    places = ran.facts.get("sidecar", {}).get("positions_mm", [])
    return len(places) == len(named) and bool(np.allclose(places, named))


def _labels(ran: Ran) -> bool:
    return list(ran.facts.get("labels", {}).values()) == ["facial nerve", "cochlea", "chorda tympani"]


def _slicer_5(ran: Ran) -> bool:
    facts = ran.facts
    return (facts["entry_mm"], facts["target_mm"], facts["coordinates"]) == ([-5, 15, 102], [-5, 15, 112], "lps")


_UNROLL = ("unroll", "recording", "-o", "SCRATCH/x.zarr")
_INFO = ("info", "recording", "--json")
_CT = ("info", "series", "--json")
_LINE = ("--entry=0,0,0", "--target=0,0,10", "-o", "SCRATCH/out")


def _plan(ct: str) -> tuple[str, ...]:
    return ("pose", "--plan-only", "--ct", ct, *_LINE)


_MARK = (0.0, 18.2, 111.0)
INPUTS: Mapping[str, Input] = {
    "avi-h264-b-frames": Input("refused as damaged", _INFO, _refused("no times", "B-frames", "ffv1")),
    "chirp-dat-is-text": Input("refused: wrong length", _INFO, _frames(2)),
    "copy-of-one-slice": Input("13 frames of 12", _INFO, _frames(12, "slice_005 (1).png")),
    "ct-concatenation-half": Input("half a volume", _CT, _refused("series is a part", "found part 1 of 2")),
    "ct-dicomdir": Input('"damaged"', _CT, _ct(_MARK, "no images: DICOMDIR", high=2000)),
    "ct-enhanced-multiframe": Input("traceback", _CT, _ct(_MARK)),
    "ct-gantry-tilt": Input("straightened, 4.1 mm off", _CT, _ct((0.0, 17.818, 113.899), "tilted by 15.0°")),
    "ct-j2k-signed-stream": Input("680 to 64555", _CT, _ct(_MARK, "numbers have no sign", high=2000)),
    "ct-left-justified": Input("2000 HU as 2304", _CT, _ct(_MARK, high=2000)),
    "ct-missing-slice": Input("29 slices 0.518 mm apart", _CT, _refused("009.dcm", "011.dcm")),
    "ct-monochrome1": Input("bone as air", _CT, _ct(_MARK, "MONOCHROME1")),
    "ct-multiframe-secondary-capture": Input("traceback", _CT, _refused("does not say where its voxels lie")),
    "ct-no-position": Input("at 0, 0, 0, 1 mm apart", _CT, _refused("000.dcm", "does not say where its voxels lie")),
    "ct-padding-63536": Input("62512 HU outside", _CT, _ct(_MARK, "6870 voxels", "62512 HU", high=2000)),
    "ct-scout-in-series": Input("31 slices, 38.7 mm off", _CT, _ct(_MARK, "scout: 000.dcm")),
    "ct-scout-other-size": Input("a C++ exception", _CT, _refused("000.dcm", "64 × 32")),
    "ct-two-volumes-one-series": Input("30 slices, alternately", _CT, _refused("000_0.dcm and 000_1.dcm")),
    "dicom-big-endian-words": Input("neighbours exchanged", _INFO, _as_pydicom(8)),
    "dicom-slow": Input("15 to 25 s", _plan("."), _refused(".dcm")),
    "frames-tiff-by-ffmpeg-444": Input("59 counts off", _INFO, _refused("colours as YCbCr;", "rgb24")),
    "frames-tiff-by-ffmpeg-raw": Input("refused as truncated", _INFO, _refused("YCbCr, one for 2 × 2 pixels", "rgb24")),
    "grey-as-palette-png": Input("refused as colour", _INFO, _frames(12)),
    "imagej-signed-16-linear": Input("32768 too high", _INFO, _frames(12, "-32768 + 1 × what is stored")),
    "labels-named-segments": Input("facial nerve as bone", ("info", "labels.seg.nrrd", "--json"), _labels),
    "mask-imagej-overlay": Input("0.992 of the wall", (), _refused("202 values", "overlay")),
    "mask-inverting-lut-png": Input("0.967 of the wall", (), _refused("palette in which 0 is not black")),
    "mask-labels-from-1": Input('refused: "one and the same value"', (), _refused("values 1, 2, none of them 0")),
    "mask-miniswhite": Input("0.936 of the wall", (), lambda ran: math.isclose(float(ran.out), 0.064, abs_tol=0.001)),
    "mask-painted-over-picture": Input("0.992 of the wall", (), _refused("203 colours")),
    "metaimage-dimensions": Input("segmentation fault", _plan("ct.mhd"), _refused("ct.mhd")),
    "mp4-trimmed": Input('"truncated"', _INFO, _frames(15, "edit list")),
    "names-decimals": Input("0.2 0.4 … 0.25 0.75 0 1.2", _INFO, _in_place),
    "nifti-microns": Input('"sheared"', ("info", "ct.nii.gz", "--json"), _ct(_MARK, lps=False)),
    "nifti-no-codes": Input("RAS, no word", _plan("ct.nii.gz"), _refused("RAS or LPS")),
    "nrrd-detached-dot-slash": Input("not next to it", ("info", "ct.nhdr", "--json"), _ct(_MARK, high=2000)),
    "oct-miniswhite": Input("upside down in brightness", _INFO, _frames(12, "WhiteIsZero")),
    "oct-signed-16-log": Input("lost with its report's picture", _UNROLL, lambda ran: "100.0% valid" in ran.out),
    "plan-fcsv-slicer5": Input("refused as not placed", ("info", "plan.fcsv", "--json"), _slicer_5),
    "plan-undefined-point": Input("0, 0, 0", ("info", "plan.mrk.json"), _refused("the target", "not placed")),
    "processed-beside-raw": Input("12 frames of 6", _INFO, _refused("slice_000_filtered.png")),
    "twins-png-tif": Input("12 frames of 6", _INFO, _frames(6, "slice_000.png")),
    "video-lost-frames": Input("1 mm short", _INFO, _lost),
    "video-other-container": Input('"0 images"', _INFO, _frames(20)),
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What became of an input now, in a line, and whether that is right."""

    said: str
    right: bool


def outcome(folder: Path, name: str) -> Outcome:
    """Return what becomes of an input of ``folder``."""
    given = INPUTS[name]
    if name.startswith("mask-"):  # `compare --truth` reads it, which needs two recordings
        ran = _share_of_cells(next((folder / name).glob("mask.*")))
        return Outcome(ran.said if ran.status else f"read: {ran.out} of the wall is cell", given.right(ran))
    with contextlib.chdir(folder / name):
        ran = endoct(given.words)
    right = given.right(ran)
    if (place := getattr(given.right, "place", None)) is not None and right:
        far_mm = farthest_of_mark(folder / name / given.words[1], place)
        return Outcome(f"{ran.said}; {far_mm:.4f} mm off", far_mm <= PLACE_MM)
    if hasattr(given.right, "as_pydicom"):
        right = right and _frames_as_pydicom(folder / name / given.words[1])
    return Outcome(ran.said, right)


def _frames_as_pydicom(folder: Path) -> bool:
    from pydicom import dcmread

    from endoct.modalities.reading.recording import open_stack

    stack = open_stack(folder)
    return np.array_equal([stack[k] for k in range(len(stack))], dcmread(next(folder.glob("*.dcm"))).pixel_array)


def _share_of_cells(mask: Path) -> Ran:
    """Read a mask, and say which share of it is cell."""
    from endoct.base.errors import EndoctError
    from endoct.fusion.files.drawings import read_drawing

    try:
        return Ran(0, f"{read_drawing(mask, None).mean():.3f}", "", mask.parent)
    except EndoctError as error:
        return Ran(1, "", str(error), mask.parent)


def farthest_of_mark(path: Path, place: tuple[float, float, float]) -> float:
    """Return how far the brightest voxel of a CT lies from ``place``, mm."""
    from endoct.modalities.ct.ct_volume import read_ct

    ct = read_ct(path)
    at = np.argwhere(ct.voxels == ct.voxels.max())[0]
    return float(np.abs(ct.origin_mm + at @ ct.steps_mm - place).max())


def main() -> int:
    """Print the table."""
    there = {path.name: path for folder in sys.argv[1:] for path in Path(folder).resolve().iterdir()}
    outcomes = {name: outcome(there[name].parent, name) for name in INPUTS if name in there}
    print("| input | before | now | right |\n|---|---|---|---|")
    for name, now in outcomes.items():
        said, right = now.said.replace(str(there[name]), ""), "yes" if now.right else "NO"
        print(f"| {name} | {INPUTS[name].before} | {said} | {right} |")
    wrong = [name for name, now in outcomes.items() if not now.right]
    print(f"\n{len(outcomes) - len(wrong)} of {len(outcomes)} are read rightly, or refused for the right reason")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
