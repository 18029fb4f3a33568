"""Pictures to compare with real ones by eye: a B-scan of `hard`, a frame of `paper`, and all three of a `mastoid`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.physics.drawing import save
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.ct_scan import scan
from endoct.synthetic.draw import Scans, draw
from endoct.synthetic.endoscope.camera import render_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.oct.bscan import ascan_echoes, render_bscan
from endoct.synthetic.oct.sweep import build_appearance

SEED = 1000


def hard_bscan(path: Path, slice_index: int = 20) -> None:
    """Draw one B-scan of `hard`, with the rows at which the real one has what."""
    sample = draw("hard", SEED)
    oct_ = sample.oct
    wall = build_wall(sample)
    bscan = render_bscan(sample, wall, build_appearance(sample, wall), slice_index)
    echoes = ascan_echoes(sample, wall, slice_index)
    row = (echoes.wall_path_mm - oct_.first_sample_mm) / oct_.axial_pixel_mm
    level = float(np.nanmedian(row[echoes.cell == 0]))
    swing = oct_.offset_mm[slice_index] / oct_.axial_pixel_mm
    sheath = [(one.radius_mm - oct_.first_sample_mm) / oct_.axial_pixel_mm for one in oct_.sheath]
    notes = [
        (oct_.detector_line_px, f"detector line: row {oct_.detector_line_px:.0f}\n(real: 218–227)"),
        (level, f"wall: about row {level:.0f} (real: 335)\nsine of {swing:.0f} px (real: 77)"),
        (sheath[0] - 14, "sheath: rows " + ", ".join(f"{at:.0f}" for at in sheath) + "\n(real: 22, 68, 101, 127)"),
        (-oct_.first_sample_mm / oct_.axial_pixel_mm, "the catheter's own exit"),
    ]
    figure, axes = plt.subplots(figsize=(8.6, 4.2))
    axes.imshow(bscan[:, ::4], cmap="gray", aspect="auto", extent=(0, 360, bscan.shape[0], 0), vmin=20, vmax=200)
    for at, text in notes:
        axes.annotate(
            text,
            (360, at),
            (366, at),
            fontsize=8.5,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "lw": 0.6},
        )
    axes.set_xlabel("A-scan (° of the turn)")
    axes.set_ylabel("depth (row)")
    axes.set_title(f"preset hard, seed {SEED}, slice {slice_index}", fontsize=10)
    figure.subplots_adjust(left=0.07, right=0.68, top=0.92, bottom=0.12)
    save(figure, path)


def paper_frame(path: Path, frame_index: int = 60) -> None:
    """Draw one frame of `paper`."""
    sample = draw("paper", SEED)
    wall = build_wall(sample)
    frame = render_frame(sample, wall, lighting_of(sample, wall), frame_index)
    figure, axes = plt.subplots(figsize=(4.2, 3.4))
    axes.imshow(frame, cmap="gray")
    axes.set_axis_off()
    axes.set_title(f"preset paper, seed {SEED}, frame {frame_index}", fontsize=10)
    figure.tight_layout()
    save(figure, path, 256)


def mastoid(path: Path, seed: int = 100, index: int = 20) -> None:
    """Draw a cut through the CT of a `mastoid`, a B-scan and a frame."""
    sample = draw("mastoid", seed, ranges={"ct.voxel_mm": (0.15, 0.15)}, scans=Scans(ct=True))
    if sample.ct is None:
        raise RuntimeError("no CT was drawn")
    picture, wall = scan(sample, sample.ct, drilled=False), build_wall(sample)
    bscan = render_bscan(sample, wall, build_appearance(sample, wall), index)
    frame = render_frame(sample, wall, lighting_of(sample, wall), index)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), width_ratios=(1.0, 1.35, 1.1))
    axes[0].imshow(picture.hu[picture.hu.shape[0] // 2], cmap="gray", vmin=-1000, vmax=2200)
    axes[0].set_title("CT before drilling", fontsize=10)
    axes[1].imshow(bscan[:, ::4], cmap="gray", aspect="auto", vmin=20, vmax=200)
    axes[1].set_title(f"B-scan, slice {index}", fontsize=10)
    axes[2].imshow(frame, cmap="gray")
    axes[2].set_title(f"frame {index}", fontsize=10)
    for one in axes:
        one.set_axis_off()
    figure.tight_layout()
    save(figure, path, 256)
