"""What burnt-in overlays cost a panorama, and what finding them is worth.

    python -m benchmarks.overlays --seeds 1000-1011 [--preset quick] [--csv FILE] [--worlds DIR]

Simulates the endoscope's recording of a bore, and draws an overlay into its frames: a kind for each seed, in turn, as
PNG and as H.264. Unrolls the recording without the overlay, and with it while overlays are looked for and while they
are not. A row for each: valid share, Jaccard index of its cells against the true ones, errors of feed and annulus
against truth, and the share of the ring that was masked. Seeds 0–99 are for tuning, from 1000 on for reporting.
"""

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import av
import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.fusion.evidence.side import Side
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment
from endoct.modalities.endoscope.mirror import ring_search
from endoct.stitching.panorama import Panorama
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import stored_frame
from endoct.synthetic.model import build_model
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.specimen_files import write_endoscope
from endoct.synthetic.truth import write_truth
from endoct.workbench import unroll
from endoct.workbench.pipeline.truth import Truth, load_truth, true_cells, true_pose

Picture = NDArray[np.uint8]
Ring = tuple[float, float, float, float]
"""Column and row of the outer rim's centre, and the radii of the inner and of the outer rim, px."""
FONT = cv2.FONT_HERSHEY_SIMPLEX


def make_world(folder: Path, preset: Any, seed: int) -> None:
    """Write the endoscope's recording of a simulated bore, and its truth, unless they are there."""
    if (folder / "truth").is_dir():
        return
    folder.mkdir(parents=True)
    sample = draw(preset, seed)
    model = build_model(sample)
    frames = (stored_frame(sample, model.wall, model.lighting, k) for k in range(PRESETS[preset].n_frames))
    write_endoscope(folder / "endoscope", sample, frames)
    write_truth(folder / "truth", sample, model.wall)


def _text(
    image: Picture, text: str, x: float, y: float, height: float, value: int = 255, outline: bool = False
) -> None:
    scale = height / 21
    at = (round(x), round(y))
    around = [(dx, dy) for dx in (-2, 0, 2) for dy in (-2, 0, 2)] if outline else []
    for dx, dy, grey in [*((dx, dy, 0) for dx, dy in around), (0, 0, value)]:
        cv2.putText(image, text, (at[0] + dx, at[1] + dy), FONT, scale, (grey,) * 3, 1 if height < 18 else 2)


def clock(image: Picture, ring: Ring, index: int) -> None:
    """A date and a running clock in white, across the lower part of the ring."""
    x, y, _, outer = ring
    _text(image, f"2026-11-25 10:42:{index // 4 % 60:02d}.{index % 4 * 25:02d}", x - 0.55 * outer, y + 0.8 * outer, 16)


def outlined(image: Picture, ring: Ring, index: int) -> None:
    """A counter of frames with a dark outline, over the left part of the ring."""
    x, y, _, outer = ring
    _text(image, f"F {index:05d}", x - 0.95 * outer, y - 0.35 * outer, 18, 235, outline=True)


def logo(image: Picture, ring: Ring, index: int) -> None:  # noqa: ARG001
    """A maker's sign: a filled shape with letters in it, and a name, over the upper right of the ring."""
    x, y, _, outer = ring
    at = round(x + 0.35 * outer), round(y - 0.75 * outer)
    cv2.rectangle(image, at, (at[0] + 46, at[1] + 30), (210, 210, 210), -1)
    cv2.putText(image, "SC", (at[0] + 7, at[1] + 22), FONT, 0.8, (40, 40, 40), 2, cv2.LINE_AA)
    _text(image, "scopecam", at[0] + 52, at[1] + 20, 14, 220)


def box(image: Picture, ring: Ring, index: int) -> None:
    """Lines of text in a black box with a bright border, over the left part of the ring."""
    x, y, _, outer = ring
    left, top = round(x - 1.25 * outer), round(y + 0.1 * outer)
    cv2.rectangle(image, (left, top), (left + round(0.62 * outer), top + 64), (0, 0, 0), -1)
    cv2.rectangle(image, (left, top), (left + round(0.62 * outer), top + 64), (200, 200, 200), 1)
    for line, text in enumerate(("ID 4711", "Zoom x1.0", f"No {index:03d}")):
        _text(image, text, left + 8, top + 18 + 19 * line, 12, 230)


def frame(image: Picture, ring: Ring, index: int) -> None:  # noqa: ARG001
    """A bright frame around the picture, and text in its corners: next to the ring, and hardly over it."""
    height, width = image.shape[:2]
    cv2.rectangle(image, (6, 6), (width - 7, height - 7), (200, 200, 200), 2)
    for k, text in enumerate(("NAME", "1996-04-01", "M", "#22", f"00:00:{index // 5:02d}")):
        _text(image, text, 16, 34 + 22 * k, 13)
    _text(image, "Gain Mid  WB auto", 0.62 * width, height - 18, 12)


def notch(image: Picture, ring: Ring, index: int) -> None:  # noqa: ARG001
    """A black mask that cuts the ring off left and right, with a notch at its lower edge."""
    x, y, _, outer = ring
    height, width = image.shape[:2]
    image[:, : max(round(x - 0.86 * outer), 0)] = 0
    image[:, min(round(x + 0.9 * outer), width) :] = 0
    foot = min(round(y + 1.05 * outer), height)
    corners = np.array([[x - 0.1 * outer, foot], [x + 0.1 * outer, foot], [x, y + 0.75 * outer]]).round().astype(int)
    cv2.fillPoly(image, [corners], (0, 0, 0))


KINDS: dict[str, Callable[[Picture, Ring, int], None]] = {
    each.__name__: each for each in (clock, logo, box, frame, notch, outlined)
}


def pictures(folder: Path) -> list[Picture]:
    """Return the frames of a simulated recording, in colour."""
    if (video := folder / "frames.mkv").is_file():
        with av.open(str(video)) as container:
            return [one.to_ndarray(format="rgb24") for one in container.decode(video=0)]
    files = sorted(folder.glob("frame_*.png"))
    return [cv2.cvtColor(cv2.imread(str(file), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB) for file in files]


def write_pictures(folder: Path, frames: Sequence[Picture], video: bool) -> None:
    """Write frames as PNG or as H.264, in place of those that are there."""
    for file in [*folder.glob("frame_*.png"), *folder.glob("frames.mkv")]:
        file.unlink()
    if not video:
        for k, image in enumerate(frames):
            cv2.imwrite(str(folder / f"frame_{k:04d}.png"), image[..., ::-1])
        return
    av.logging.set_level(av.logging.PANIC)
    with av.open(str(folder / "frames.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "18"})
        stream.height, stream.width = (side // 2 * 2 for side in frames[0].shape[:2])
        stream.pix_fmt, stream.thread_count = "yuv420p", 1
        for k, image in enumerate(frames):
            even = np.ascontiguousarray(image[: stream.height, : stream.width])
            picture = av.VideoFrame.from_ndarray(even, format="rgb24")
            picture.pts = k
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))


def draw_overlay(world: Path, folder: Path, kind: str, video: bool) -> None:
    """Write a recording again, with an overlay where ``kind`` names one."""
    shutil.copytree(world / "endoscope", folder)
    true = json.loads((world / "truth" / "recording.json").read_text(encoding="utf-8"))["endoscope"]
    centre = np.mean(true["centre_px"], axis=0)
    ring = float(centre[0]), float(centre[1]), float(np.mean(true["inner_px"])), float(np.mean(true["outer_px"]))
    frames = [np.ascontiguousarray(image) for image in pictures(folder)]
    if kind:
        for k, image in enumerate(frames):
            KINDS[kind](image, ring, k)
    write_pictures(folder, frames, video)


def judge(panorama: Panorama, truth: Truth) -> dict[str, float | str]:
    """Return how close an unrolled recording is to the truth."""
    of = truth.recording["endoscope"]
    pose = true_pose(panorama, truth)
    cells = segment(Side("endoscope", panorama), SegmentParameters())
    index = panorama.per_frame["frame_index"].values
    z_mm = panorama.per_frame["frame_z_mm"].values
    off_mm = z_mm - np.asarray(of["z_mm"])[index]
    x_px, y_px = (panorama.per_frame[f"annulus_{axis}_px"].values for axis in "xy")
    off_px = np.hypot(*(np.stack([x_px, y_px], axis=1) - np.asarray(of["centre_px"])[index]).T)
    masked = [doubt.value for doubt in panorama.doubts if doubt.code == "overlay-masked"]
    return {
        "outcome": "unrolled",
        "valid": float(panorama.valid.mean()),
        "jaccard": jaccard(cells, true_cells(truth, pose, panorama), panorama.valid) or 0.0,
        "z_um": float(1e3 * np.percentile(np.abs(off_mm - np.median(off_mm)), 95)),
        "ring_px": float(np.median(off_px)),
        "rims_px": float(
            np.median(np.abs(panorama.per_frame["annulus_inner_px"].values - np.mean(of["inner_px"])))
            + np.median(np.abs(panorama.per_frame["annulus_outer_px"].values - np.mean(of["outer_px"])))
        ),
        "masked": float(masked[0] or 0) if masked else 0.0,
        "doubts": " ".join(doubt.code for doubt in panorama.doubts),
    }


def rows_of(preset: str, seed: int, worlds: Path, kinds: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield a row for each way a recording is unrolled."""
    world = worlds / f"{preset}-{seed}"
    make_world(world, preset, seed)
    truth = load_truth(world)
    video = bool(seed // len(KINDS) % 2)
    with tempfile.TemporaryDirectory() as scratch:
        for kind in ("", *(kinds or [tuple(KINDS)[seed % len(KINDS)]])):
            recording = Path(scratch) / f"recording-{kind}"
            draw_overlay(world, recording, kind, video)
            for looked in (True, False) if kind else (True,):
                row = {"preset": preset, "seed": seed, "kind": kind or "none", "video": video, "looked": looked}
                try:
                    if looked:
                        panorama = unroll(recording, progress=False)
                    else:
                        with patch.object(ring_search, "find_overlay", lambda *_: None):
                            panorama = unroll(recording, progress=False)
                    yield row | judge(panorama, truth)
                except EndoctError as error:
                    yield row | {"outcome": str(error)}


def main() -> None:
    """Print a row for each recording, and medians of each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-5", help="first-last")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--kinds", nargs="*", choices=list(KINDS), default=())
    parser.add_argument("--worlds", type=Path, help="where simulated recordings are kept")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(int(first), int(last or first) + 1):
            for row in rows_of(options.preset, seed, options.worlds or Path(scratch), options.kinds):
                rows.append(row)
                shown = (f"{k}={v:.3f}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items())
                print("  ".join(shown), flush=True)
    table = pd.DataFrame(rows)
    if options.csv:
        table.to_csv(options.csv, index=False)
    figures = ["valid", "jaccard", "z_um", "ring_px", "rims_px", "masked"]
    groups = table.groupby([table["kind"] != "none", "looked"])[figures]
    print(groups.agg(["median", "mean", "min", "max"]).T.to_string(float_format="%.3f"))


if __name__ == "__main__":
    main()
