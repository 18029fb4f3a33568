"""One turn of the beam over the wall."""

from dataclasses import dataclass

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.oct.beams import Echoes
from endoct.synthetic.oct.spectrometer import Spectrometer
from endoct.synthetic.oct.turn import Turn
from endoct.synthetic.sample.parameters import Oct


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
