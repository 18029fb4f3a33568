"""One turn of the beam over the wall: the columns of a slice, and what their beams meet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.oct.appearance import Appearance
from endoct.synthetic.oct.beams import Echoes, stream_position, trace_slices
from endoct.synthetic.oct.spectrometer import Spectrometer, spectrometer
from endoct.synthetic.oct.turn import Turn, lateral_taps
from endoct.synthetic.sample.parameters import Oct, Sample
from endoct.synthetic.sample.presets import PRESETS

BEYOND = 3  # columns beyond those recorded that the interpolation between columns reads


@dataclass(frozen=True, eq=False)
class Sweep:
    """The instrument, the columns of one slice, and what their beams meet; arrays have one value a column.

    ``echoes``: surfaces. ``wall_db`` and ``glint_db``: how brightly the wall and its specular spots scatter there, see
    :class:`endoct.synthetic.oct.appearance.Appearance`. ``radius_mm``: of the bore, on which the beam is focused.
    """

    oct_: Oct
    spectrometer: Spectrometer
    turn: Turn
    echoes: Echoes
    wall_db: Coordinates
    glint_db: Coordinates
    radius_mm: float


def sweeps(
    sample: Sample, wall: Wall, appearance: Appearance, slices: Sequence[int]
) -> Iterator[tuple[Sweep, NDArray[np.intp]]]:
    """Yield for each of ``slices`` its sweep, and of the A-scans recorded how many were taken before each.

    Columns lie ``ascans_per_column`` of the preset apart; the first −``turn.first`` of them, and as many last, are a
    margin beyond the A-scans.
    """
    oct_, size = sample.oct, PRESETS[sample.preset]
    every, one = size.ascans_per_column, spectrometer(oct_, 2 * size.n_depth)
    taken = [stream_position(oct_, i, size.n_ascans) for i in slices]
    rings = [round(size.n_ascans / every / oct_.turn_length[i]) for i in slices]
    margins = [lateral_taps(oct_, wall.radius_mm, n_ring).size // 2 + BEYOND for n_ring in rings]
    columns = [
        np.arange(-margin, -(-int(position[-1] + 1) // every) + margin, dtype=np.float64)
        for position, margin in zip(taken, margins, strict=True)
    ]
    # a column stands for the middle of its A-scans
    traced = trace_slices(sample, wall.scene, slices, [(k + 0.5) * every - 0.5 for k in columns])
    for position, n_ring, margin, echoes in zip(taken, rings, margins, traced, strict=True):
        n = echoes.alpha_rad.size
        # one turn on, a helical scan is a pitch away
        turn = Turn(n if oct_.scan == "helical" else n_ring, -margin, n)
        wall_db, glint_db = (
            appearance.at(image, echoes.wall_z_mm, echoes.wall_theta_rad)
            for image in (appearance.wall_db, appearance.glint_db)
        )
        yield Sweep(oct_, one, turn, echoes, wall_db, glint_db, wall.radius_mm), position
