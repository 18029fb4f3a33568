"""Pictures of a few frames of a recording, kept for its report: as recorded, with what was found, and unrolled."""

from pathlib import Path

import numpy as np

from endoct.base.compute.own_process import give_back
from endoct.modalities.illustration import illustrated
from endoct.workbench.pipeline.unrolling import Unrolled
from endoct.workbench.report.pictures import PICTURES, load_pictures, save_pictures

PLACES = (1 / 6, 1 / 2, 5 / 6)
"""Where along the recording frames are shown."""


def save_sample_frames(made: Unrolled, folder: Path, name: str) -> None:
    """Write pictures of the frames at :data:`PLACES` into ``folder``, as those of the side ``name``."""
    order = np.argsort(made.calibration.per_frame["z_mm"], kind="stable")
    for place in sorted({round(share * (len(order) - 1)) for share in PLACES}):
        pictures = illustrated(made.manifest.load(), made.stream[int(order[place])], made.calibration)
        save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
    give_back()


def copy_sample_frames(store: Path, folder: Path, name: str) -> None:
    """Write the pictures that lie in the ``store`` of a panorama into ``folder``, as those of the side ``name``.

    Raises :class:`EndoctError` where one of them cannot be read.
    """
    for of_side in load_pictures(store / PICTURES).values():
        for place, pictures in of_side.items():
            save_pictures(folder / PICTURES, name, f"{place:04d}", pictures)
