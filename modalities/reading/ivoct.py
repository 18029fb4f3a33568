"""DICOM of a catheter that turns in a vessel: optical coherence tomography (IVOCT, PS3.3 A.66 and C.8.27).

Images *for processing* are polar: a row is an A-scan, the catheter's optics at the left. A frame is one turn of 360°,
from top to bottom in the order of acquisition. What is done to them is what PS3.17 EEE.2 has done before display:

- Padded A-scans at the end of a frame (0052,0038) hold anything, and are dropped.
- Where the number of A-scans varies, turns are brought to one number, each A-scan by the nearest of its own turn.
- The A-scan at the seam (0052,0036) becomes the first. It is displayed at the first A-line location (0052,0034),
  in degrees clockwise from the top.
- Where frames have a seam line location (0052,0033) of their own, they are turned to that of the first.
- Every frame is shifted along depth by its Z offset (0052,0030), outward where that is positive, unless it was applied
  (0052,0026). Depth 0 is the catheter's axis then.

What the header states becomes keys of the sidecar. The traps:

- A-line pixel spacing (0052,0014) is divided by the effective refractive index (0052,0004) already where 0052,003A is
  YES. The index is that of tissue and flush, whatever the catheter was in.
- The ranging depth (0052,0009), which is in air, shows where 0052,003A lies.
- A longitudinal distance (0052,0028) is that to the frame before, positive where the catheter was pulled.
- Motorised pullbacks have a speed (0018,3101) in its place, and frames before and after at which the catheter stood.
- The direction of rotation (0052,0031) is seen from the motor to the tip, as θ is.
- Pixel intensity relationship (0028,1040) is LIN, or LOG with a table that makes it linear. A table that is no
  exponential shows that samples are not logarithmic: they are made linear by it then.

Images *for presentation* are round cross-sections, and are made polar again where the header says enough:

- No element of DICOM has the centre of such an image. But the ranging depth is, by PS3.3 C.8.27.3, "the radius of the
  FOR PRESENTATION image in air". Where it is half of both sides, in pixels, the catheter's axis is in the middle.
- Depth is corrected for the refractive index there (A.66.1).
- They are seen from the motor as the catheter turns, so that directions run clockwise from the top.
- What lies at the edges of pixels, or was burnt into them, is lost or stays.

Cross-sections of ultrasound, and captures of a console's screen, are round as well. No header says where their centre
lies: they are refused.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.dicom.dicom_file import OCT_FOR_PRESENTATION, OCT_FOR_PROCESSING, kind_of, name_of
from endoct.modalities.dicom.image import GREY
from endoct.modalities.dicom.samples import ReadSamples, as_seen
from endoct.modalities.reading.dicom_recording import DicomRecording, as_number, opened_recording
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.ivoct_header import ALIKE, CONTENT, KEYWORDS, intensity_of, scale_of, travelled
from endoct.modalities.reading.remarks import NONE, Remarks, doubted

RADIUS_WITHIN = 0.02
"""The stated radius may differ from half a side by this share of it."""
OCT_CONTENT = "IntravascularOCTFrameContentSequence"
LEAST_TURN = 2
ONE_DEGREE = 1.0
_MADE_POLAR = (
    "Round cross-sections for presentation were made polar: whether samples are logarithmic is not known, and export "
    "for processing loses nothing."
)


@dataclass(frozen=True)
class Disc:
    """A round image of ``side`` × ``side`` pixels, ``pixel_mm`` wide; ``index`` by which depth was divided."""

    side: int
    pixel_mm: float
    index: float

    @property
    def shape(self) -> tuple[int, int]:
        """Of a B-scan: a depth sample a pixel; as many A-scans as pixels lie around the edge."""
        return self.side // 2, math.ceil(math.pi * self.side)

    @property
    def keys(self) -> dict[str, Any]:
        """Keys of a sidecar that it states."""
        lengths = {"axial_pixel_mm": self.pixel_mm * self.index, "medium_index": self.index, "first_sample_mm": 0.0}
        return lengths | {"handedness": "same", "theta_origin_rad": 0.0}


def disc_of(recording: DicomRecording) -> Disc | None:
    """Return how the round images of a recording lie; None where the header does not say all of that."""
    header = recording.header
    spacing = recording.each("PixelMeasuresSequence", "PixelSpacing")[0]
    range_mm, index = recording.number("RangingDepth"), recording.number("EffectiveRefractiveIndex")
    rows, columns = int(header.Rows), int(header.Columns)
    if spacing is None or len(spacing) != 2 or not range_mm or not index or rows != columns:
        return None
    row_mm, column_mm = (as_number(value) or 0.0 for value in spacing)
    if row_mm <= 0 or row_mm != column_mm or abs(range_mm / index / row_mm / (rows / 2) - 1) > RADIUS_WITHIN:
        return None
    return Disc(rows, row_mm, index)


@dataclass(frozen=True, eq=False)
class ReadPolar:
    """Reads one round image as (depth, A-scan); picklable."""

    frames: tuple[tuple[ReadSamples, int], ...]
    disc: Disc

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one B-scan, interpolated linearly."""
        import cv2

        read, number = self.frames[index]
        image = as_seen(read(number), read)
        if image.ndim == 3 and (image == image[..., :1]).all():
            image = image[..., 0]
        if image.ndim == 3 or image.dtype not in (np.uint8, np.uint16):
            found = "colours" if image.ndim == 3 else str(image.dtype)
            raise EndoctError(f"{read.path} holds no grey cross-sections", found=found, remedy="export them in grey")
        n_depth, n_ascans = self.disc.shape
        check_array_size((n_depth, n_ascans), 8, f"a frame of {read.path}, made polar")
        middle = (self.disc.side - 1) / 2
        radius = np.arange(n_depth, dtype=np.float32)[:, None]
        angle = (2 * np.pi * np.arange(n_ascans) / n_ascans).astype(np.float32)
        x, y = middle + radius * np.sin(angle), middle - radius * np.cos(angle)
        return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


@dataclass(frozen=True)
class Turn:
    """One frame: how many A-scans are samples, at which it begins, by how many depth samples it is to be shifted."""

    n_ascans: int
    start: int
    shift: int


@dataclass(frozen=True, eq=False)
class ReadTurns:
    """Reads one turn as (depth, A-scan); picklable."""

    frames: tuple[tuple[ReadSamples, int], ...]
    turns: tuple[Turn, ...]
    n_ascans: int
    linear: NDArray[Any] | None = None

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one B-scan, in the numbers that are stored, or made linear by the table of the header."""
        (read, number), turn = self.frames[index], self.turns[index]
        ascans = as_seen(read(number), read)[: turn.n_ascans]
        if turn.start:
            ascans = np.roll(ascans, -turn.start, axis=0)
        if len(ascans) != self.n_ascans:
            nearest = np.rint(np.arange(self.n_ascans) * len(ascans) / self.n_ascans).astype(np.intp)
            ascans = ascans[nearest % len(ascans)]
        if self.linear is not None:
            ascans = self.linear[np.clip(ascans.astype(np.intp), 0, len(self.linear) - 1)]
        if turn.shift:
            ascans = _shifted(ascans, turn.shift)
        return np.ascontiguousarray(ascans.T)


def _shifted(ascans: NDArray[Any], shift: int) -> NDArray[Any]:
    """Return A-scans moved outward by ``shift`` samples, inward where it is negative, 0 where nothing was recorded."""
    moved, n = np.zeros_like(ascans), ascans.shape[1]
    moved[:, max(shift, 0) : n + min(shift, 0)] = ascans[:, max(-shift, 0) : n - max(shift, 0)]
    return moved


def _open(files: Files) -> Frames:
    with opened_recording(_one_kind(files), KEYWORDS) as recording:
        return _pullback(recording)[0]


def _states(files: Files) -> Stated:
    with opened_recording(_one_kind(files), KEYWORDS) as recording:
        name = files[0].name if len(files) == 1 else files[0].parent.name
        return Stated(_pullback(recording)[1], f"the DICOM header of {name}")


def _one_kind(files: Files) -> Files:
    """Return those of ``files`` that are for processing, of a console that wrote both; else all of them."""
    polar = tuple(file for file in files if kind_of(file).sop_class == OCT_FOR_PROCESSING)
    return polar or files


def _pullback(recording: DicomRecording) -> tuple[Frames, dict[str, Any]]:
    """Return the frames of a recording and the keys it states."""
    image, sop_class = recording.images[0], recording.text("SOPClassUID")
    disc = disc_of(recording) if sop_class == OCT_FOR_PRESENTATION else None
    if disc is None and sop_class != OCT_FOR_PROCESSING:
        kind = kind_of(image.path)
        raise EndoctError(
            f"{image.path} holds round cross-sections, whose centre its header does not say",
            found=f"{name_of(kind.sop_class)}, modality {kind.modality[:16]}",
            expected="IVOCT for processing",
            remedy="export the series for processing (polar), or make the frames polar before",
        )
    reads = [image.read for image in recording.images if image.read is not None]
    if len(reads) < len(recording.images) or (
        disc is None and any(read.stated.photometric not in GREY for read in reads)
    ):
        raise EndoctError(f"{image.path} holds no B-scans", found="a video, or colours", expected="grey frames")
    travel = travelled(recording)
    frames = tuple((read, index) for read in reads for index in range(len(read)))
    kept = slice(travel.kept.start, travel.kept.stop)
    if disc is not None:
        remarks = recording.remarks + travel.said.remarks + Remarks(notes=(_MADE_POLAR,))
        polar = ReadPolar(frames[kept], disc)
        return Frames(len(polar.frames), polar, travel.along, remarks), {
            "modality": "oct"
        } | travel.said.keys | disc.keys
    scale, (linear, intensity) = scale_of(recording), intensity_of(recording)
    turns, on_turns = _turns(recording)
    n_ascans = max(turn.n_ascans for turn in turns[kept])
    keys = {"modality": "oct"} | travel.said.keys | scale.keys | intensity.keys | _angles(recording)
    if recording.text("OCTZOffsetApplied") in ("YES", "NO"):
        keys["first_sample_mm"] = 0.0
    remarks = recording.remarks + travel.said.remarks + scale.remarks + intensity.remarks + on_turns
    remarks += _on_turns(recording, turns[kept], n_ascans)
    read = ReadTurns(frames[kept], turns[kept], n_ascans, linear)
    return Frames(len(read.frames), read, travel.along, remarks), keys


def _angles(recording: DicomRecording) -> dict[str, Any]:
    """Return which way A-scans run around, and where the first of them is displayed."""
    directions = {"CW": {"handedness": "same"}, "CC": {"handedness": "mirrored"}}
    keys: dict[str, Any] = directions.get(recording.text("CatheterDirectionOfRotation"), {})
    first = recording.number("FirstALineLocation")
    return dict(keys) if first is None else keys | {"theta_origin_rad": math.radians(first % 360)}


def _turns(recording: DicomRecording) -> tuple[tuple[Turn, ...], Remarks]:
    """Return what is to be done to every frame. Raises :class:`EndoctError` where a header asks for what cannot be."""
    elements = ((OCT_CONTENT, "NumberOfPaddedALines"), (OCT_CONTENT, "SeamLineIndex"))
    padded, seams = ([int(value or 0) for value in recording.each(*element)] for element in elements)
    offsets = [int(value or 0) for value in recording.each(OCT_CONTENT, "OCTZOffsetCorrection")]
    applied, remarks = recording.text("OCTZOffsetApplied"), NONE
    if applied != "NO":
        if applied != "YES" and any(offsets):
            what = "The header has Z offsets and does not say whether they were applied; they were not."
            remarks = doubted("z-offset", what)
        offsets = [0] * len(offsets)
    places = [as_number(value) for value in recording.each(CONTENT, "SeamLineLocation")]
    sense = -1 if recording.text("CatheterDirectionOfRotation") == "CC" else 1
    turns = []
    for (image, index), n_padded, seam, shift, place in zip(
        recording.frames, padded, seams, offsets, places, strict=True
    ):
        rows, columns = int(image.header.Rows), int(image.header.Columns)
        n_ascans = rows - n_padded
        if n_padded < 0 or n_ascans < LEAST_TURN or not 0 <= seam < rows or abs(shift) >= columns:
            found = f"{n_padded} of {rows} A-scans padded, the seam at {seam}, {shift} of {columns} samples off"
            raise EndoctError(f"frame {index + 1} of {image.path} cannot be as its header says", found=found)
        turned = 0
        if place is not None and places[0] is not None:
            turned = round(sense * (places[0] - place) * n_ascans / 360)
        turns.append(Turn(n_ascans, seam + turned, shift))
    return tuple(turns), remarks


def _on_turns(recording: DicomRecording, turns: tuple[Turn, ...], n_ascans: int) -> Remarks:
    """Return what was done to frames, and where the header contradicts itself about them."""
    rows = int(recording.header.Rows)
    least = min(turn.n_ascans for turn in turns)
    notes, remarks = [], NONE
    if least < rows:
        counts = f"{least}" if least == n_ascans else f"{least} to {n_ascans}, of which {n_ascans} were made"
        notes.append(f"Of {rows} A-scans a frame those that are padded were left out: there are {counts}.")
    if any(turn.start % turn.n_ascans for turn in turns):
        notes.append("Frames were turned so that they begin at the seam that the header states.")
    if shifts := sorted({turn.shift for turn in turns if turn.shift}):
        by = f"{shifts[0]}" if len(shifts) == 1 else f"{shifts[0]} to {shifts[-1]}"
        notes.append(f"Frames were shifted along depth by their Z offsets: {by} samples.")
    stated = recording.number("ALinesPerFrame")
    rate_hz, turns_hz = recording.number("ALineRate"), recording.number("CatheterRotationalRate")
    if stated is not None and stated != rows:
        what = f"Frames have {rows} A-scans, and by the header {stated:g}."
        remarks += doubted("ascans-against-header", what, rows, stated)
    if rate_hz and turns_hz and abs(n_ascans * turns_hz / rate_hz - 1) > ALIKE:
        expected = rate_hz / turns_hz
        what = (
            f"A turn has {n_ascans} A-scans, and {expected:.0f} by the header's rates: frames may hold more or less "
            "than one turn."
        )
        remarks += doubted("ascans-against-rate", what, n_ascans, expected)
    places, first = recording.each(CONTENT, "SeamLineLocation"), recording.number("FirstALineLocation")
    seam = as_number(places[0])
    if seam is not None and first is not None and abs((seam - first + 180) % 360 - 180) > ONE_DEGREE:
        what = (
            f"The header has the seam of the first frame at {seam:g}° and its first A-scan at {first:g}°; θ "
            "was taken to begin at the latter."
        )
        remarks += doubted("seam-against-start", what, seam, first, "°")
    return Remarks(tuple(notes)) + remarks


IVOCT = Format("DICOM of a turning catheter", lambda path: kind_of(path).is_catheter, _open, _states, joins=True)
