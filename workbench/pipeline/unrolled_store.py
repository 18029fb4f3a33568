"""The store of an unrolled recording: its panorama, the volume, pictures of a few frames, and a report."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from endoct.base.compute.own_process import give_back
from endoct.base.errors import EndoctError
from endoct.modalities.contract import VolumetricModality
from endoct.modalities.illustration import illustrated
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.pipeline.settings import parse
from endoct.workbench.pipeline.unrolling import Unrolled, Watched, open_recording, unroll_recording
from endoct.workbench.report.figures.rendered import begin_pictures, begin_wall
from endoct.workbench.report.pictures import PICTURES, load_pictures, save_pictures
from endoct.workbench.report.side_findings import recording_in
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import Scheduler

if TYPE_CHECKING:
    from endoct.workbench.requests import UnrollRequest

PLACES = (1 / 6, 1 / 2, 5 / 6)
"""Where along the recording pictures of frames are taken."""


def unroll_source(request: "UnrollRequest", store: Path | None, stages: Stages, scheduler: Scheduler) -> Panorama:
    """Unroll a recording, and write everything `endoct unroll` promises into ``store`` where one is given.

    Raises :class:`EndoctError` where the recording cannot be used or shows no wall, or the modality has no volume.
    """
    recording = open_recording(
        Path(request.path), modality=request.modality, settings=parse(request.settings), device=request.device
    )
    unrolled = unroll_recording(recording, stages)
    panorama = unrolled.panorama
    if store is None:
        return panorama
    of_wall = begin_wall(panorama, scheduler)
    save_panorama(panorama, store)
    if request.volume:
        write_volume(unrolled, store, stages)
    with stages.stage("report"):
        save_sample_frames(unrolled, store, panorama.modality)
        side = recording_in(store, panorama)
        of_frames = begin_pictures(side, scheduler)
        from endoct.workbench.page.report import write_recording_report  # a page is loaded while frames are drawn

        write_recording_report(store, side, [of_wall, of_frames])
    return panorama


def write_volume(unrolled: Unrolled, store: Path, stages: Stages) -> None:
    """Write the group ``volume`` into ``store``. Raises :class:`EndoctError` where the modality has none."""
    recording = unrolled.recording
    if "volume" not in recording.manifest.provides:
        raise EndoctError(
            f"the modality '{recording.manifest.name}' has no volume", remedy="leave out volume=True for this recording"
        )
    implementation = cast(VolumetricModality[Any, Any], recording.manifest.load())
    with stages.stage("volume") as advance:
        implementation.write_volume(Watched(recording.stream, advance), unrolled.calibration, store)


def save_sample_frames(unrolled: Unrolled, folder: Path, name: str) -> None:
    """Write pictures of the frames at :data:`PLACES` into ``folder``, as those of the side ``name``."""
    recording, calibration = unrolled.recording, unrolled.calibration
    order = np.argsort(calibration.per_frame["z_mm"], kind="stable")
    for place in sorted({round(share * (len(order) - 1)) for share in PLACES}):
        pictures = illustrated(recording.manifest.load(), recording.stream[int(order[place])], calibration)
        save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
    give_back()


def copy_sample_frames(store: Path, folder: Path, name: str) -> None:
    """Write the pictures that lie in the ``store`` of a panorama into ``folder``, as those of the side ``name``.

    Raises :class:`EndoctError` where one of them cannot be read.
    """
    for of_side in load_pictures(store / PICTURES).values():
        for place, pictures in of_side.items():
            save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
