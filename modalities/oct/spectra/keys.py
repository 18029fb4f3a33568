"""What a sidecar says of raw spectra: its table ``spectra``."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

EVEN = "even"
COUNTS_PER_DB = 256
ZERO_DB = -100.0
"""B-scans made of spectra have 256 counts a decibel, from −100 dB on. 0 dB is a cosine of amplitude 1."""
LEAST_SAMPLES, MOST_SAMPLES = 96, 65536
LEAST_ASCANS = 64
MOST_RAD = 1e4
Radians = Annotated[float, Field(ge=-MOST_RAD, le=MOST_RAD)]


class SpectraKeys(BaseModel):
    """The table ``spectra`` of the sidecar: where the samples lie and how B-scans are made of them.

    The files that it names lie in the folder of the sidecar. Vectors have one value a sample, as little-endian float64
    or float32, or as text.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    file: str = Field(
        description="file of the samples, one spectrum behind the other, little-endian, no header; or a name with *, "
        "as stop_*.bin: a file a slice, of which the first turn is read"
    )
    samples: int = Field(
        ge=LEAST_SAMPLES, le=MOST_SAMPLES, multiple_of=2, description="samples of one spectrum, an even number"
    )
    ascans: int | None = Field(
        default=None,
        ge=LEAST_ASCANS,
        le=1_000_000,
        description="A-scans of one slice, of one turn; left out where turns are not all as long: they are found",
    )
    slices: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="slices to read; default: all, and where ascans is stated the file must end with one",
    )
    sample_type: Literal["u16", "i16"] = Field(default="u16", description="samples without (u16) or with a sign (i16)")
    chirp: str = Field(
        description="file of places on even wavenumbers; or even, for a source that is clocked evenly in wavenumber"
    )
    chirp_gives: Literal["wavenumber", "sample"] = Field(
        default="wavenumber",
        description="wavenumber: the chirp's value i is where sample i lies among the even wavenumbers 0, 1, …; "
        "sample: it is where the even wavenumber i lies among the samples",
    )
    offset: str | None = Field(default=None, description="file of what each sample gives in the dark, or a background")
    electrons_per_count: float = Field(
        default=1.0, ge=1e-6, le=1e9, description="what samples are multiplied by before the offset is subtracted"
    )
    background: Literal["mean", "offset", "apodisation"] = Field(
        default="mean",
        description="what is subtracted: the mean over the A-scans of a slice (and with it any offset), the offset, or "
        "the spectra without the sample that a ThorImage file holds",
    )
    interpolation: Literal["cubic", "linear", "sinc"] = Field(
        default="cubic", description="how samples are read at even wavenumbers: by 4 samples, 2, or 8"
    )
    window: Literal["hann", "hamming", "blackman", "flat"] = Field(
        default="hann", description="window over the spectrum: narrower points or lower side lobes"
    )
    dispersion_rad: tuple[Radians, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=2,
        description="[a, b] of the phase a·x² + b·x³ to take off, x from −1 to 1 over the even wavenumbers",
    )
    dispersion: str | None = Field(
        default=None, description="file of the phase to take off at each even wavenumber, rad"
    )

    @property
    def dtype(self) -> np.dtype[np.uint16] | np.dtype[np.int16]:
        """Type of a sample in the file."""
        return np.dtype("<u2") if self.sample_type == "u16" else np.dtype("<i2")

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        if self.dispersion is not None and self.dispersion_rad is not None:
            raise ValueError("one of dispersion and dispersion_rad")
        if self.background == "offset" and self.offset is None:
            raise ValueError("an offset, where background is offset")
        return self


class StatedSpectra(BaseModel):
    """The table of a sidecar alone, which may be there before the rest is filled in."""

    spectra: SpectraKeys
