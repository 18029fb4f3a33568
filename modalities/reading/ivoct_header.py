"""What the DICOM header of a turning catheter states: places of frames, the scale of depth, the meaning of samples."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.modalities.reading.dicom_recording import DicomRecording, as_number
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks, doubted

if TYPE_CHECKING:
    from pydicom import Dataset

KEYWORDS = (
    "EffectiveRefractiveIndex", "RangingDepth", "ALineRate", "ALinesPerFrame", "OCTZOffsetApplied",
    "RefractiveIndexApplied", "ALinePixelSpacing", "PixelIntensityRelationship", "FirstALineLocation",
    "IVUSAcquisition", "IVUSPullbackRate", "IVUSPullbackStartFrameNumber", "IVUSPullbackStopFrameNumber",
    "CatheterDirectionOfRotation", "CatheterRotationalRate", "FrameTime", "IntravascularLongitudinalDistance",
    "SeamLineLocation", "OCTZOffsetCorrection", "SeamLineIndex", "NumberOfPaddedALines",
    "PixelIntensityRelationshipLUTSequence",
)  # fmt: skip
CONTENT = "IntravascularFrameContentSequence"
EVEN = 0.01
"""Distances between frames that differ by no more than this share are one pitch."""
ALIKE = 0.03
"""Two statements on one thing may differ by this share."""
OFF_LINE = 0.02
"""Logarithms, base e, of a table may lie this far off a line, besides rounding, where it makes logarithms linear."""
LEAST_ENTRY = 16
"""Smaller numbers of a table are too coarse to see its form by."""
LEAST_ENTRIES = 8
MOST_ENTRIES = 65_536


@dataclass(frozen=True, eq=False)
class Said:
    """Keys of a sidecar that a header states, and what is to be said of them."""

    keys: dict[str, Any] = field(default_factory=dict)
    remarks: Remarks = NONE


@dataclass(frozen=True, eq=False)
class Travelled:
    """Which frames of a recording lie along the pullback, and where, with ``said`` of pitch and direction."""

    kept: range
    along: Along | None
    said: Said


def travelled(recording: DicomRecording) -> Travelled:
    """Return which frames were taken while the catheter moved, and how far apart they lie."""
    kept, remarks = _moving(recording)
    speed_mm_s = recording.number("IVUSPullbackRate") if recording.text("IVUSAcquisition") == "MOTORIZED" else None
    keys: dict[str, Any] = {}
    if speed_mm_s:
        keys |= {"scan": "helical", "travel": "out" if speed_mm_s > 0 else "in"}
        if (rate_hz := _frames_a_second(recording)) is not None:
            keys["pullback_pitch_mm"] = abs(speed_mm_s) / rate_hz
    along = recording.along
    distances = recording.each(CONTENT, "IntravascularLongitudinalDistance")[kept.start : kept.stop]
    steps = [as_number(value) for value in distances[1:]]
    if steps and None not in steps:
        by_distance, uneven, on_distances = _by_distance(np.array(steps, np.float64), keys.get("pullback_pitch_mm"))
        keys |= by_distance
        remarks += on_distances
        along = along if uneven is None else uneven
    return Travelled(kept, along, Said(keys, remarks))


def _moving(recording: DicomRecording) -> tuple[range, Remarks]:
    n = len(recording.frames)
    first, last = (
        recording.number(f"IVUSPullback{end}FrameNumber") if len(recording.images) == 1 else None
        for end in ("Start", "Stop")
    )
    if first is None or last is None or not 1 <= first < last <= n or last - first + 1 == n:
        return range(n), NONE
    kept = range(int(first) - 1, int(last))
    note = f"The catheter was pulled in frames {kept.start + 1} to {kept.stop} of {n}; the others were left out."
    return kept, Remarks(notes=(note,))


def _frames_a_second(recording: DicomRecording) -> float | None:
    """Return how many frames a second were taken: by the time of a frame, else by the turns."""
    if (milliseconds := recording.number("FrameTime")) is not None and milliseconds > 0:
        return 1000 / milliseconds
    turns_hz = recording.number("CatheterRotationalRate")
    return turns_hz if turns_hz is not None and turns_hz > 0 else None


def _by_distance(steps: Coordinates, by_speed_mm: float | None) -> tuple[dict[str, Any], Along | None, Remarks]:
    """Return pitch and direction by the distances between frames, and places where these are uneven."""
    if not ((steps > 0).all() or (steps < 0).all()):
        if not steps.any():
            return {}, None, NONE
        what = "The header's longitudinal distances lead to and fro; they were not used."
        return {}, None, doubted("frames-uneven", what)
    sizes = np.abs(steps)
    pitch = float(np.median(sizes))
    keys = {"pullback_pitch_mm": pitch, "travel": "out" if steps[0] > 0 else "in"}
    remarks = NONE
    if by_speed_mm is not None and abs(by_speed_mm / pitch - 1) > ALIKE:
        what = (
            f"By the header's longitudinal distances frames lie {pitch:.4g} mm apart, by the speed of its pullback "
            f"{by_speed_mm:.4g} mm; the distances were used."
        )
        remarks = doubted("pitch-against-speed", what, pitch, by_speed_mm, "mm")
    if (np.abs(sizes / pitch - 1) <= EVEN).all():
        return keys, None, remarks
    places = np.concatenate([[0.0], np.cumsum(sizes)])
    return keys, Along(places, "mm", "the longitudinal distances of the header"), remarks


def scale_of(recording: DicomRecording) -> Said:
    """Return the distance of depth samples in air, and the index of what the beam goes through."""
    spacing, index = recording.number("ALinePixelSpacing"), recording.number("EffectiveRefractiveIndex")
    applied = {"YES": True, "NO": False}.get(recording.text("RefractiveIndexApplied"))
    keys: dict[str, Any] = {} if index is None else {"medium_index": index}
    if spacing is None or spacing <= 0:
        return Said(keys)
    if applied is None or (applied and index is None):
        lacks = "whether its spacing of depth is that in air" if applied is None else "by which index it divided it"
        note = f"The header does not say {lacks} ({spacing:g} mm); the sidecar must state axial_pixel_mm."
        return Said(keys, Remarks(notes=(note,)))
    in_air = spacing * index if applied and index is not None else spacing
    range_mm, n_depth = recording.number("RangingDepth"), int(recording.header.Columns)
    remarks = NONE
    if range_mm and index is not None:
        other = spacing if applied else spacing * index
        fits, fits_other = (abs(each * n_depth / range_mm - 1) <= ALIKE for each in (in_air, other))
        if fits_other and not fits:
            what = (
                f"By its ranging depth the header's spacing is {'not ' if applied else ''}divided by the refractive "
                f"index, and it says otherwise: depth may be {other / in_air:.3f} times what was taken. If so, state "
                f"axial_pixel_mm = {other:.6g}."
            )
            remarks = doubted("index-applied", what, in_air, other, "mm")
    return Said({"axial_pixel_mm": in_air} | keys, remarks)


def intensity_of(recording: DicomRecording) -> tuple[NDArray[Any] | None, Said]:
    """Return a table that makes samples linear, None where they stay as they are, and what the header says of them."""
    relation = recording.text("PixelIntensityRelationship")
    if relation == "LIN":
        return None, Said({"intensity": "linear"})
    if relation != "LOG":
        said = f"says '{relation[:16]}'" if relation else "says nothing"
        note = f"Whether samples are linear or logarithmic, the header {said}; the sidecar's intensity counts."
        return None, Said({}, Remarks(notes=(note,)))
    table = _to_linear(recording)
    if table is None or _is_exponential(table):
        return None, Said({"intensity": "log"})
    note = "The header's table shows that samples are not logarithmic, as it says; the table made them linear."
    return table, Said({"intensity": "linear"}, Remarks(notes=(note,)))


def _to_linear(recording: DicomRecording) -> NDArray[Any] | None:
    """Return the numbers by which samples become linear, from sample 0 on; None where the header has no such table."""
    header = recording.header
    groups = (header.get("SharedFunctionalGroupsSequence"), header.get("PerFrameFunctionalGroupsSequence"), [header])
    for of in groups:
        for item in (of[0].get("PixelIntensityRelationshipLUTSequence") or []) if of else []:
            if str(item.get("LUTFunction") or "TO_LINEAR") == "TO_LINEAR":
                return _table(item)
    return None


def _table(item: "Dataset") -> NDArray[Any] | None:
    descriptor, data = item.get("LUTDescriptor"), item.get("LUTData")
    if descriptor is None or data is None or len(descriptor) != 3:
        return None
    count, first = int(descriptor[0]) or MOST_ENTRIES, int(descriptor[1])
    values = np.frombuffer(data[: len(data) // 2 * 2], "<u2") if isinstance(data, bytes) else np.array(data, np.uint16)
    if not 0 <= first < MOST_ENTRIES or not 0 < count <= values.size:
        raise ValueError(f"a table of {values.size} numbers for {count}")
    return np.concatenate([np.full(first, values[0]), values[:count]]).astype(np.uint16)


def _is_exponential(table: NDArray[Any]) -> bool:
    """Say whether numbers grow exponentially with the sample, as they must where samples are logarithms."""
    samples = np.flatnonzero((table >= LEAST_ENTRY) & (table < table.max()))
    if samples.size < LEAST_ENTRIES:
        return False
    logs = np.log(table[samples].astype(np.float64))
    line = np.polynomial.Polynomial.fit(samples, logs, 1)
    return bool((np.abs(line(samples) - logs) <= OFF_LINE + 1 / table[samples]).all())
