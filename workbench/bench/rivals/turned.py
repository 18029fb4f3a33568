"""A pullback unrolled as somebody says that the catheter turned: its A-scans are put where they belong beforehand.

So a rival for uneven rotation needs no more than the angle by which every A-scan is off. All else is ours, the
correction within turns switched off; where turns start is still found from the sheath.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.numeric.least_squares import harmonics
from endoct.modalities.contract import Frame, FrameStream, StreamOver
from endoct.stitching.panorama import Panorama
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.sides.recordings import open_recording, unroll_recording

STATED_HARMONICS = 12
"""The panorama states the errors of angle as a length of the turn and so many harmonics."""
EVEN_WITHIN = {f"correct_{step}": False for step in ("rotation", "turn_length", "lost_ascans")}


def nominal_rad(n_ascans: int) -> Coordinates:
    """Return the angles of A-scans in an even turn, float64 (n_ascans,), rad."""
    return 2 * np.pi * np.arange(n_ascans, dtype=np.float64) / n_ascans


def unrolled_as_turned(recording: Path, errors_of: Callable[[FrameStream], Coordinates]) -> Panorama:
    """Return the panorama of a pullback whose A-scans lie off their nominal angles by ``errors_of`` its stream.

    The errors are float64 (n_slices, n_ascans), rad, in recording order. The panorama's ``per_frame`` says the rotation
    that was corrected as :func:`endoct.workbench.unroll` does. Raises :class:`EndoctError` as that does.
    """
    opened = open_recording(recording, modality="oct", settings=EVEN_WITHIN)
    errors = errors_of(opened.stream)
    even = replace(opened, stream=_Straightened(opened.stream, errors))
    return _stating(unroll_recording(even, SilentStages()).panorama, errors)


@dataclass(frozen=True, eq=False)
class _Straightened(StreamOver):
    """A stream whose A-scans were moved to even angles; each angle shows the A-scan recorded nearest to it."""

    stream: FrameStream
    errors_rad: Coordinates

    def __getitem__(self, index: int) -> Frame:
        frame = self.stream[index]
        return replace(frame, samples=frame.samples[nearest_ascans(self.errors_rad[index])])


def nearest_ascans(error_rad: Coordinates) -> NDArray[np.intp]:
    """Return for even angles which A-scan was recorded nearest to each, intp (n,), where all are off by ``error_rad``.

    The turn is a circle: beams before its start are those of its end.
    """
    n = error_rad.size
    turn = nominal_rad(n)
    beams = np.maximum.accumulate(turn + error_rad)
    around = np.concatenate([beams - 2 * np.pi, beams, beams + 2 * np.pi])
    order = np.argsort(around, kind="stable")  # the ends of a long turn overlap
    place = np.tile(np.arange(n), 3)[order]
    after = np.clip(np.searchsorted(around[order], turn), 1, around.size - 1)
    before = after - 1
    nearer = turn - around[order][before] < around[order][after] - turn
    return np.where(nearer, place[before], place[after])


def stated_errors_rad(panorama: Panorama, n_ascans: int) -> tuple[Coordinates, Coordinates]:
    """Return the errors within turns that a panorama says it corrected, and how sure it is, in recording order.

    float64 (n_slices, n_ascans), and standard deviations (n_slices,), infinite where none could be measured; rad.
    """
    of, turn = {name: each.values for name, each in panorama.per_frame.items()}, nominal_rad(n_ascans)
    n_orders = of["rotation_harmonics_rad"].shape[1] // 2
    errors = (of["turn_length"][:, None] - 1) * (turn - np.pi)
    errors += of["rotation_harmonics_rad"] @ harmonics(turn, range(1, n_orders + 1)).T
    errors += np.where(turn >= of["lost_at_rad"][:, None], of["lost_rad"][:, None], 0)
    sigma = np.where(of["rotation_known"].astype(bool), of["rotation_sigma_rad"], np.inf)
    recorded = np.argsort(of[f"{panorama.frame_dim}_index"])
    return errors[recorded], np.nan_to_num(sigma, nan=np.inf)[recorded]


def _stating(panorama: Panorama, errors_rad: Coordinates) -> Panorama:
    """The panorama with what was corrected beforehand in its values per slice."""
    turn = nominal_rad(errors_rad.shape[1])
    waves = harmonics(turn, range(1, STATED_HARMONICS + 1))
    basis = np.concatenate([np.ones((turn.size, 1)), turn[:, None] - np.pi, waves], axis=1)
    order = panorama.per_frame[f"{panorama.frame_dim}_index"].values
    factors = np.linalg.lstsq(basis, errors_rad[order].T, rcond=None)[0].T
    stated = {
        **panorama.per_frame,
        "start_angle_rad": panorama.per_frame["start_angle_rad"].values + factors[:, 0],
        "turn_length": 1 + factors[:, 1],
        "rotation_harmonics_rad": factors[:, 2:],
    }
    return replace(panorama, per_frame=stated)
