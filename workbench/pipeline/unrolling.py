"""Unroll one recording into the store of its panorama.

The store holds the panorama, the volume where one is wanted, pictures of a few frames, and a report.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from endoct.base.compute.memory import give_back
from endoct.base.errors import EndoctError, refusing
from endoct.modalities.contract import VolumetricModality
from endoct.modalities.illustration import illustrated
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_notes, save_panorama
from endoct.workbench.report.figures.rendered import begin_pictures, begin_wall
from endoct.workbench.report.pictures import PICTURES, load_pictures, save_pictures
from endoct.workbench.report.side_findings import recording_in
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import Scheduler
from endoct.workbench.settings import parse
from endoct.workbench.sides.recordings import Unrolled, Watched, open_recording, unroll_recording

if TYPE_CHECKING:
    from endoct.workbench.requests import UnrollRequest

PLACES = (1 / 6, 1 / 2, 5 / 6)
"""Pictures of frames are taken at these shares of the recording's length."""


def unroll_source(request: "UnrollRequest", store: Path | None, stages: Stages, scheduler: Scheduler) -> Panorama:
    """Unroll a recording, and write everything `endoct unroll` promises into ``store`` where one is given.

    Raises :class:`EndoctError` where the recording cannot be used or shows no wall, or the modality has no volume.
    """
    recording = open_recording(
        Path(request.path), modality=request.modality, recipe=request.recipe, settings=parse(request.settings)
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
        if unpictured := save_sample_frames(unrolled, store, panorama.modality):
            panorama = replace(panorama, notes=(*panorama.notes, *unpictured))
            save_notes(panorama, store)
        side = recording_in(store, panorama)
        of_frames = begin_pictures(side, scheduler)
        from endoct.workbench.page.report import write_recording_report  # loaded while frames are drawn

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


def save_sample_frames(unrolled: Unrolled, folder: Path, name: str) -> tuple[str, ...]:
    """Write pictures of the frames at :data:`PLACES` into ``folder``, as those of the side ``name``.

    Return a note on each frame of which none could be made: for that no panorama is given up.
    """
    recording, calibration = unrolled.recording, unrolled.calibration
    order = np.argsort(calibration.per_frame["z_mm"], kind="stable")
    notes = []
    for place in sorted({round(share * (len(order) - 1)) for share in PLACES}):
        frame = recording.stream[int(order[place])]
        try:
            with refusing("it cannot be drawn"):
                pictures = illustrated(recording.manifest.load(), frame, calibration)
                save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
        except EndoctError as error:
            notes.append(f"The report shows no picture of {recording.manifest.frame_dim} {frame.index}: {error}.")
    give_back()
    return tuple(notes)


def copy_sample_frames(store: Path, folder: Path, name: str) -> None:
    """Write the pictures that lie in the ``store`` of a panorama into ``folder``, as those of the side ``name``.

    Raises :class:`EndoctError` where one of them cannot be read.
    """
    for of_side in load_pictures(store / PICTURES).values():
        for place, pictures in of_side.items():
            save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
