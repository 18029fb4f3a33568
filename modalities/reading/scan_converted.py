"""Round cross-sections of IVOCT (for presentation), made polar again where the header says enough.

No element of DICOM has the centre of such an image. But the ranging depth is, by PS3.3 C.8.27.3, "the radius of the FOR
PRESENTATION image in air". Where that radius in pixels is half of both sides, the middle of the image is the catheter's
axis. Depth is corrected for the refractive index there (A.66.1), and seen from the motor as the catheter turns, so that
directions run clockwise from the top. What lies at the edges of pixels, or was burnt into them, is lost or stays.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.dicom.samples import ReadSamples, as_seen
from endoct.modalities.reading.dicom_recording import DicomRecording, as_number

RADIUS_WITHIN = 0.02
"""Share of half a side by which the stated radius may differ from it."""


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
        axial_mm = self.pixel_mm * self.index
        return {
            "axial_pixel_mm": axial_mm,
            "medium_index": self.index,
            "handedness": "same",
            "theta_origin_rad": 0.0,
            "first_sample_mm": 0.0,
        }


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
