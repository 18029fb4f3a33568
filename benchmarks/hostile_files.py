"""What hostile files cost: ``python benchmarks/hostile_files.py [--endoct COMMAND]`` prints time, peak memory, a line.

Each file, of a few bytes or kB, is given to the command that reads its like; `--endoct` names the command of another
version.
A command that has not ended after a minute is killed.
"""

import argparse
import json
import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import tifffile
import zarr

LIMIT_S = 60.0
MOST_GB = 12.0
OCT = (
    'modality = "oct"\naxial_pixel_mm = {axial}\npullback_pitch_mm = 0.2\nbore_diameter_mm = 2.5\n'
    "capillary_outer_diameter_mm = 1.7\n{more}"
)
ENDOSCOPE = 'modality = "endoscope"\nbore_diameter_mm = 2.5\nfeed_pitch_mm = {pitch}\nvisible_length_mm = 1.0\n'


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(path: Path, side: int = 32767) -> None:
    """A PNG that declares side × side pixels of four channels and brings some kB."""
    rows = zlib.compress(bytes(6_000_000), 9)
    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + _png_chunk(b"IHDR", header) + _png_chunk(b"IDAT", rows) + _png_chunk(b"IEND", b"")
    )


def _frames(folder: Path, pitch: float) -> list[str]:
    specimen(folder / "specimen")
    recording = folder / "specimen" / "endoscope"
    (recording / "acquisition.toml").write_text(ENDOSCOPE.format(pitch=pitch))
    return ["unroll", str(recording), "-o", str(folder / "out.zarr")]


def _pullback(folder: Path, axial: float, more: str = "") -> list[str]:
    specimen(folder / "specimen")
    recording = folder / "specimen" / "oct"
    (recording / "acquisition.toml").write_text(OCT.format(axial=axial, more=more))
    return ["unroll", str(recording), "-o", str(folder / "out.zarr")]


def specimen(folder: Path) -> None:
    """A small specimen, rendered once."""
    if not MADE:
        MADE.append(Path(tempfile.mkdtemp(prefix="hostile-")) / "specimen")
        command = [Path(sys.executable).with_name("endoct"), "simulate", "-o", MADE[0], "--preset", "learning"]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    shutil.copytree(MADE[0], folder)


MADE: list[Path] = []


def _image(folder: Path) -> list[str]:
    png(folder / "frame_0000.png")
    return _unroll(folder)


def _unroll(folder: Path) -> list[str]:
    (folder / "acquisition.toml").write_text(ENDOSCOPE.format(pitch=0.2))
    return ["unroll", str(folder), "-o", f"{folder}.zarr"]


def _mask(folder: Path) -> list[str]:
    png(folder / "mask.png")
    specimen(folder / "specimen")
    return ["compare", str(folder / "specimen/oct"), str(folder / "mask.png"), "-o", str(folder / "out")]


def _ome(folder: Path) -> list[str]:
    ome = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="80" SizeY="70" SizeZ="1" SizeC="1" '
        'SizeT="99999999"><TiffData/></Pixels></Image></OME>'
    )
    tifffile.imwrite(folder / "x.ome.tif", np.zeros((70, 80), np.uint8), description=ome, metadata=None)
    return ["info", str(folder / "x.ome.tif")]


def _tiff_bomb(folder: Path) -> list[str]:
    tifffile.imwrite(folder / "x.tif", np.zeros((30_000, 30_000), np.uint8), compression="zlib", rowsperstrip=30_000)
    return ["info", str(folder / "x.tif")]


def _zarr(folder: Path) -> list[str]:
    store = folder / "labels.zarr"
    zarr.create_array(store, shape=(45_000, 45_000), chunks=(45_000, 45_000), dtype="i4", zarr_format=3)
    specimen(folder / "specimen")
    return ["compare", str(folder / "specimen/oct"), str(store), "-o", str(folder / "out")]


def _panorama(folder: Path) -> list[str]:
    specimen(folder / "specimen")
    store = folder / "pan.zarr"
    unroll = [Path(sys.executable).with_name("endoct"), "unroll", folder / "specimen/oct", "-o", store]
    subprocess.run(unroll, check=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    (store / "endoct-output.json").unlink()
    for file in (store / "intensity" / "zarr.json", store / "zarr.json"):
        metadata = json.loads(file.read_text())
        of = metadata if "shape" in metadata else metadata["consolidated_metadata"]["metadata"]["intensity"]
        of["shape"] = [20_000, 100_000]
        file.write_text(json.dumps(metadata))
    return ["info", str(store)]


def _roi_bomb(folder: Path) -> list[str]:
    with zipfile.ZipFile(folder / "rois.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.roi", bytes(2_000_000_000))
    specimen(folder / "specimen")
    return ["compare", str(folder / "specimen/oct"), str(folder / "rois.zip"), "-o", str(folder / "out")]


def _device(folder: Path) -> list[str]:
    return _pullback(folder, 0.005, 'calibration = "/dev/zero"\n')


def _pipe(folder: Path) -> list[str]:
    os.mkfifo(folder / "pipe")
    return _pullback(folder, 0.005, f'calibration = "{folder / "pipe"}"\n')


def _frame_pipe(folder: Path) -> list[str]:
    os.mkfifo(folder / "frame_0000.png")
    cv2.imwrite(str(folder / "frame_0001.png"), np.zeros((40, 40), np.uint8))
    return _unroll(folder)


FILES: dict[str, Callable[[Path], list[str]]] = {
    "PNG that declares 32767² × RGBA": _image,
    "the same as a mask": _mask,
    "OME-TIFF of 99 999 999 frames": _ome,
    "TIFF of 0.9 GB in 0.9 MB": _tiff_bomb,
    "Zarr labels that declare 8 GB": _zarr,
    "panorama that declares 8 GB": _panorama,
    "zip of ROIs that expands to 2 GB": _roi_bomb,
    "calibration = /dev/zero": _device,
    "calibration = a pipe": _pipe,
    "a frame that is a pipe": _frame_pipe,
    "axial_pixel_mm = 1e-9": lambda folder: _pullback(folder, 1e-9),
    "feed_pitch_mm = 1e6": lambda folder: _frames(folder, 1e6),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endoct", default=str(Path(sys.executable).with_name("endoct")))
    command = parser.parse_args().endoct
    print("| file | s | peak GB | status | said |\n|---|---|---|---|---|", flush=True)
    for name, make in FILES.items():
        folder = Path(tempfile.mkdtemp(prefix="hostile-"))
        arguments = make(folder)
        seconds, peak_gb, status, said = measured([command, *arguments])
        print(f"| {name} | {seconds:.1f} | {peak_gb:.2f} | {status} | {said.replace(str(folder), 'DIR')} |", flush=True)
        shutil.rmtree(folder)
    if MADE:
        shutil.rmtree(MADE[0].parent)


def measured(command: list[str]) -> tuple[float, float, str, str]:
    """Run a command; return seconds, peak memory of its process in GB, how it ended and its last line."""
    start = time.monotonic()
    most = int(MOST_GB * 2**30)
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )  # fmt: skip
    timer = threading.Timer(LIMIT_S, lambda: os.killpg(process.pid, 9))
    timer.start()
    said = process.stderr.read() if process.stderr is not None else ""
    _, status, usage = os.wait4(process.pid, 0)
    timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    ended = "killed" if process.returncode < 0 else str(process.returncode)
    line = said.strip().splitlines()[-1][:160] if said.strip() else ""
    return time.monotonic() - start, usage.ru_maxrss / 2**20, ended, line.replace("|", "/")


if __name__ == "__main__":
    main()
