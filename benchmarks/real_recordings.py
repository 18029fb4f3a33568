"""What endoct makes of real recordings.

    ENDOCT_RECORDINGS=FOLDER python benchmarks/real_recordings.py [-o DIR]

Prints, for the clinical pullback in ``coronary-oct``, the fit of the sheath and the distance of the wall, mapped back
to the centre of the frame, from the data set's own outlines; and draws the annulus found over every image of
``omnidirectional`` and ``pipe-end`` into DIR.
"""

import argparse
import os
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from endoct.base.errors import EndoctError
from endoct.modalities.contract import Picture
from endoct.modalities.endoscope.manifest import MANIFEST, EndoscopeAcquisition
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.panorama import Panorama
from endoct.workbench import unroll

MM_PER_PX = 0.0067
RING_COLOURS = ("#e66100", "#40b0a6")


def distance_px(panorama: Panorama, slice_row: int, outline_px: np.ndarray) -> np.ndarray:
    """Return the distance of one slice's valid wall samples from the outline, along beams from the frame's centre."""
    assert panorama.depth_mm is not None
    valid = panorama.valid[slice_row]
    offset_mm = panorama.per_frame["offset_mm"].values[slice_row]
    direction_rad = panorama.per_frame["offset_direction_rad"].values[slice_row]
    radius_mm = panorama.grid.radius_mm + panorama.depth_mm[slice_row, valid]
    theta_rad = panorama.grid.theta_rad[valid]
    x_mm = radius_mm * np.cos(theta_rad) - offset_mm * np.cos(direction_rad)
    y_mm = radius_mm * np.sin(theta_rad) - offset_mm * np.sin(direction_rad)
    n = outline_px.size
    beam = np.mod(np.arctan2(y_mm, x_mm), 2 * np.pi) * n / (2 * np.pi)
    return np.asarray(np.hypot(x_mm, y_mm) / MM_PER_PX - np.interp(beam, np.arange(n), outline_px, period=n))


def wall_of_coronary(folder: Path) -> tuple[np.ndarray, float]:
    """Return how far off the outlines every valid sample lies, px, and the share of the samples that are valid."""
    panorama = unroll(folder, progress=False)
    error_px = np.concatenate(_errors_px(panorama, np.load(folder / "lumen_px.npy")))
    return np.abs(error_px), float(panorama.valid.mean())


def _errors_px(panorama: Panorama, outlines_px: np.ndarray) -> list[np.ndarray]:
    index = panorama.per_frame["slice_index"].values
    return [distance_px(panorama, row, outlines_px[index[row]]) for row in range(panorama.grid.n_z)]


def coronary(folder: Path) -> None:
    """Print how well the sheath is fitted and the wall is found."""
    panorama = unroll(folder)
    index = panorama.per_frame["slice_index"].values
    error = _errors_px(panorama, np.load(folder / "lumen_px.npy"))
    for name, rows in (("all", index >= 0), ("even", index % 2 == 0), ("odd", index % 2 == 1)):
        size = np.abs(np.concatenate([e for e, chosen in zip(error, rows, strict=True) if chosen]))
        print(
            f"{name:5s} slices: wall off by {np.median(size):.2f} px in the median, {np.percentile(size, 90):.2f} px "
            f"at the 90th percentile; {panorama.valid[rows].mean():.1%} valid"
        )
    residual_px = panorama.per_frame["residual_mm"].values / MM_PER_PX
    print(
        f"sheath: residual {np.median(residual_px):.2f} px in the median, {residual_px.max():.2f} px at most; "
        f"{int(panorama.per_frame['bridged'].values.sum())} of {residual_px.size} slices bridged"
    )
    for note in panorama.notes:
        print("not trusted:", note)


def draw_annuli(folder: Path, output: Path) -> None:
    """Draw the rings found over each image in ``folder``."""
    acquisition = EndoscopeAcquisition(modality="endoscope", bore_diameter_mm=2.5, visible_length_mm=1.0)
    modality = MANIFEST.load()
    for path in sorted(folder.glob("*.jpg")):
        try:
            stream = modality.open(path, acquisition)
            calibration = modality.survey(stream, EndoscopeParameters())
        except EndoctError as error:
            print(f"{path.name}: {error}")
            continue
        picture = modality.illustrate(stream[0], calibration)[0]
        target = output / f"annulus-{folder.name}.png"
        _drawn(picture).save(target)
        found = {k: round(float(v[0]), 1) for k, v in calibration.per_frame.items() if k.endswith("_px")}
        print(f"{target}: {found}")


def _drawn(picture: Picture) -> Image.Image:
    image = Image.fromarray(np.asarray(picture.image)).convert("RGB")
    draw = ImageDraw.Draw(image)
    (x0, x1), (y0, y1) = picture.x_extent, picture.y_extent
    for curve, colour in zip(picture.curves.values(), RING_COLOURS, strict=False):
        x = (curve[:, 0] - x0) / (x1 - x0) * (image.width - 1)
        y = (curve[:, 1] - y0) / (y1 - y0) * (image.height - 1)
        draw.line([(float(a), float(b)) for a, b in zip(x, y, strict=True) if np.isfinite(a + b)], colour, 3)
    return image


def main() -> None:
    """Go through the recordings that are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    recordings = Path(os.environ["ENDOCT_RECORDINGS"])
    coronary(recordings / "coronary-oct")
    for name in ("omnidirectional", "pipe-end", "endoscope-circle"):
        draw_annuli(recordings / name, output)


if __name__ == "__main__":
    main()
