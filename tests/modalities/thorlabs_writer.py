"""Writes ThorImage files from their documented layout, and from nothing of the reader."""

import io
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[Any]
TYPES = {"f": "Real", "c": "Complex", "u": "Raw", "i": "Raw"}


@dataclass
class Oct:
    """What lies in a file: members by name, with the attributes of their ``DataFile``; and the header's fields."""

    members: list[tuple[str, bytes, dict[str, object] | None]] = field(default_factory=list)
    size: tuple[int, int, int] = (64, 80, 1)
    """Pixels of the image: depth, A-scans, B-scans."""
    range_mm: tuple[float, float, float] = (0.64, 10.0, 3.0)
    index: float = 1.0
    averaged: dict[str, int] = field(default_factory=dict)
    signed: bool = False
    electrons_per_count: float = 540.0
    mode: str = "Mode3D"
    timestamp: int = 1_700_000_000
    extra: str = ""

    def add(self, name: str, samples: Samples, **attributes: object) -> "Oct":
        """Add samples, (slice, A-scan, depth) or fewer axes, with what their ``DataFile`` says of them."""
        shape = (1,) * (3 - samples.ndim) + samples.shape
        sizes: dict[str, object] = {"Type": TYPES[samples.dtype.kind], "SizeZ": shape[2]}
        if samples.ndim > 1:
            sizes |= {"SizeX": shape[1]}
        if samples.ndim > 2:
            sizes |= {"SizeY": shape[0]}
        ranges = dict(zip(("RangeZ", "RangeX", "RangeY"), self.range_mm, strict=True))
        sizes |= ranges | {"BytesPerPixel": samples.itemsize} | attributes
        data = np.ascontiguousarray(samples, samples.dtype.newbyteorder("<")).tobytes()
        self.members.append((name, data, {key: value for key, value in sizes.items() if value is not None}))
        return self

    def header(self) -> str:
        """The header as XML."""
        listed = "\n".join(_data_file(name, said) for name, _, said in self.members if said is not None)
        axes = ("SizeZ", "SizeX", "SizeY")
        pixels = "".join(f"<{axis}>{n}</{axis}>" for axis, n in zip(axes, self.size, strict=True))
        real = "".join(f"<{axis}>{mm:.6f}</{axis}>" for axis, mm in zip(axes, self.range_mm, strict=True))
        spacing = "".join(
            f"<{axis}>{mm / n:.6f}</{axis}>" for axis, mm, n in zip(axes, self.range_mm, self.size, strict=True)
        )
        get = self.averaged.get
        return f"""<?xml version="1.0" encoding="ENCODING"?>
<Ocity version="1.0">
  <DataFiles>
{listed}
  </DataFiles>
  <Image Type="RawSpectra">
    <SizePixel Unit="px">{pixels}</SizePixel>
    <SizeReal Unit="mm">{real}</SizeReal>
    <PixelSpacing Unit="mm">{spacing}</PixelSpacing>
    <AxisOrder>ZXYT</AxisOrder>
  </Image>
  <Acquisition>
    <IntensityAveraging><Spectra>{get("Spectra", 1)}</Spectra><AScans>{get("AScans", 1)}</AScans>
      <BScans>{get("BScans", 1)}</BScans></IntensityAveraging>
    <SpeckleAveraging><FastAxis>1</FastAxis><SlowAxis>{get("SlowAxis", 1)}</SlowAxis></SpeckleAveraging>
    <Timestamp>{self.timestamp}</Timestamp>
    <RefractiveIndex>{self.index:.6f}</RefractiveIndex>
  </Acquisition>
  <Instrument>
    <Model>TEL320C1</Model>
    <BytesPerPixel>2</BytesPerPixel>
    <RawDataIsSigned>{self.signed}</RawDataIsSigned>
    <BinaryToElectronCountScaling>{self.electrons_per_count}</BinaryToElectronCountScaling>
  </Instrument>
  <MetaInfo><AcquisitionMode>{self.mode}</AcquisitionMode><Comment>a µm &amp; b</Comment></MetaInfo>{self.extra}
</Ocity>
"""

    def bytes(
        self,
        *,
        separator: str = "\\",
        encoding: str = "utf-8",
        compression: int = zipfile.ZIP_STORED,
        header: str | None = None,
        leave_out: Sequence[str] = (),
    ) -> bytes:
        """The file; ``leave_out``: members that the header lists and the file lacks."""
        text = (self.header() if header is None else header).replace("ENCODING", encoding.removesuffix("-sig"))
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", compression) as archive:
            for name, data, _ in self.members:
                if name not in leave_out:
                    archive.writestr(zipfile.ZipInfo(f"data{separator}{name}.data"), data, compression)
            archive.writestr(zipfile.ZipInfo("Header.xml"), text.encode(encoding), compression)
        return buffer.getvalue()

    def write(self, path: Path, **how: Any) -> Path:
        """Write the file and return its path."""
        path.write_bytes(self.bytes(**how))
        return path


def _data_file(name: str, said: dict[str, object]) -> str:
    attributes = " ".join(f'{key}="{value}"' for key, value in said.items())
    return f"    <DataFile {attributes}>data\\{name}.data</DataFile>"


def with_vectors(made: Oct, chirp: Samples, offset: Samples | None = None, apodisation: Samples | None = None) -> Oct:
    """Add the chirp and what else the program writes next to raw spectra: float32, one value a sample."""
    vectors = (("Chirp", chirp), ("OffsetErrors", offset), ("ApodizationSpectrum", apodisation))
    for name, values in vectors:
        if values is not None:
            made.add(name, np.asarray(values, np.float32), RangeZ=1, RangeX=1, RangeY=1)
    return made


def raw_file(
    slices: Iterable[Samples], chirp: Samples | None, *, apodisation: Samples | None = None, **fields: Any
) -> Oct:
    """A file of raw spectra (A-scan, sample), one member a B-scan, with spectra without the sample before each."""
    listed = list(slices)
    n_ascans, n_samples = listed[0].shape
    made = Oct(size=(n_samples // 2, n_ascans, len(listed)), signed=listed[0].dtype.kind == "i", **fields)
    for k, spectra in enumerate(listed):
        n_apo = 0 if apodisation is None else len(apodisation)
        frame = spectra if apodisation is None else np.concatenate([apodisation, spectra]).astype(spectra.dtype)
        regions = {"ApoRegionStart0": 0, "ApoRegionEnd0": n_apo} if n_apo else {}
        scanned = {"ScanRegionStart0": n_apo, "ScanRegionEnd0": n_apo + n_ascans}
        made.add(f"Spectral{k}", frame, **regions, **scanned)
    return made if chirp is None else with_vectors(made, chirp, np.zeros(n_samples))
