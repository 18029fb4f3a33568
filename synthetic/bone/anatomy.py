"""What a surgeon looks for in the CT of a mastoid: facial nerve, chorda, cochlea, sigmoid sinus, antrum.

All in the bore frame, mm. The head lies towards θ = 0, so that the nerve runs along x. It passes the bore two
millimetres before its end, the chorda on the other side. The cochlea's basal turn lies beyond the end. The sinus runs
down behind the bore, near the mouth; the antrum lies above it, deeper. Neither comes as near as the OCT can look.
"""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Bore

FACIAL_NERVE, CHORDA, COCHLEA, SINUS, ANTRUM = 2, 3, 4, 5, 6
"""Labels in truth/ct_labels.nii.gz; 0 is air, 1 bone."""
NERVE_RADIUS_MM, CHORDA_RADIUS_MM = 0.75, 0.25
BEFORE_END_MM = 2.0
COCHLEA_TURNS, COCHLEA_PLACES = 2.5, 40
COCHLEA_RADIUS_MM, COCHLEA_HEIGHT_MM = (3.3, 0.8), 3.6
DUCT_RADIUS_MM = (0.9, 0.45)
COVER_MM = 0.5  # There is at least this much bone around each.
RECESS_HALF_MM = 9.0
# These sizes are typical, and no method reads them.
SINUS_RADIUS_MM, SINUS_Z_MM, SINUS_SLOPE = 4.0, 6.0, 0.15
ANTRUM_RADIUS_MM, ANTRUM_LENGTH_MM = 3.5, 4.0
ANTRUM_BEFORE_END_MM, ANTRUM_LEAST_Z_MM = 8.0, 6.0


@dataclass(frozen=True, eq=False)
class Structure:
    """A tube along ``points_mm`` (n, 3), with ``radius_mm`` (n,) there."""

    label: int
    points_mm: Coordinates
    radius_mm: Coordinates

    def box(self, places: Lattice, margin_mm: float = 0.0) -> tuple[slice, slice, slice]:
        """Return a box of indices that holds all of ``places`` in it or within ``margin_mm`` of it."""
        boxes = [places.box(point, float(self.radius_mm.max()) + margin_mm) for point in self.points_mm]
        k, j, i = (
            slice(min(one.start for one in axis), max(one.stop for one in axis)) for axis in zip(*boxes, strict=True)
        )
        return k, j, i

    def distance_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the distance of places (any shape) to its surface, < 0 inside."""
        nearest = np.full(x.shape, np.inf, np.float32)
        ends = zip(self.points_mm[:-1], self.points_mm[1:], self.radius_mm[:-1], self.radius_mm[1:], strict=True)
        for first, last, from_mm, to_mm in ends:
            way = (last - first).astype(np.float32)
            ax, ay, az = x - np.float32(first[0]), y - np.float32(first[1]), z - np.float32(first[2])
            along = np.clip((ax * way[0] + ay * way[1] + az * way[2]) / float(way @ way), 0, 1).astype(np.float32)
            ax, ay, az = ax - along * way[0], ay - along * way[1], az - along * way[2]
            tube = np.sqrt(ax * ax + ay * ay + az * az) - (np.float32(from_mm) + along * np.float32(to_mm - from_mm))
            np.minimum(nearest, tube, out=nearest)
        return nearest


def structures(bore: Bore) -> tuple[Structure, ...]:
    """Return the structures of a simulated mastoid."""
    network = bore.network
    if network is None:
        return ()
    radius, length = bore.diameter_mm / 2, bore.length_mm
    side = 1.0 if network.entry_mm[0] > 0 else -1.0  # behind the bore the nerve, before it the chorda
    along = np.linspace(-RECESS_HALF_MM, RECESS_HALF_MM, 9)
    recess_z = length - BEFORE_END_MM
    nerve_y = side * (radius + network.nerve_mm + NERVE_RADIUS_MM)
    nerve = np.stack([along, np.full(9, nerve_y), recess_z + 0.02 * along**2], axis=1)
    # the chorda leaves the nerve below the bore and crosses to the other side as it rises
    chorda = _past_bore(nerve[0, :2], -side * (radius + network.chorda_mm + CHORDA_RADIUS_MM))
    chorda = np.append(chorda, np.full((len(chorda), 1), recess_z), axis=1)
    target = np.array([0.0, 0.0, length + network.cochlea_mm])
    turn = np.linspace(0, 2 * np.pi * COCHLEA_TURNS, COCHLEA_PLACES)
    spiral = np.linspace(*COCHLEA_RADIUS_MM, COCHLEA_PLACES)
    rise = COCHLEA_HEIGHT_MM * turn / turn[-1]
    # its axis lies across the bore, and the duct begins at the target
    cochlea = np.stack([spiral * np.sin(turn), side * -rise, -spiral * np.cos(turn)], axis=1)
    cochlea += target - cochlea[0] + np.array([0, 0, DUCT_RADIUS_MM[0]])
    return (
        Structure(FACIAL_NERVE, nerve, np.full(9, NERVE_RADIUS_MM)),
        Structure(CHORDA, chorda, np.full(len(chorda), CHORDA_RADIUS_MM)),
        Structure(COCHLEA, cochlea, np.linspace(*DUCT_RADIUS_MM, COCHLEA_PLACES)),
    )


def sinus_and_antrum(bore: Bore) -> tuple[Structure, ...]:
    """Return the sigmoid sinus, which holds blood, and the antrum, which holds air, of a simulated mastoid."""
    network = bore.network
    if network is None:
        return ()
    radius, side = bore.diameter_mm / 2, 1.0 if network.entry_mm[0] > 0 else -1.0
    along = np.linspace(-2 * RECESS_HALF_MM, 2 * RECESS_HALF_MM, 9)
    behind = side * (radius + network.sinus_mm + SINUS_RADIUS_MM)
    sinus = np.stack([along, np.full(9, behind), SINUS_Z_MM - SINUS_SLOPE * along], axis=1)
    deep = max(bore.length_mm - ANTRUM_BEFORE_END_MM, ANTRUM_LEAST_Z_MM)
    above = radius + network.antrum_mm + ANTRUM_RADIUS_MM
    half = ANTRUM_LENGTH_MM / 2
    antrum = np.array([[above, side * half, deep], [above, -side * half, deep]])
    return (
        Structure(SINUS, sinus, np.full(9, SINUS_RADIUS_MM)),
        Structure(ANTRUM, antrum, np.full(2, ANTRUM_RADIUS_MM)),
    )


def _past_bore(start: Coordinates, aside_mm: float) -> Coordinates:
    """Return points (n, 2) of a straight way from ``start`` (x, y) that passes the bore's axis at ``aside_mm`` in y."""
    apart = float(np.hypot(*start))
    # the way is a tangent to the circle of that radius about the axis, on the side of aside_mm
    to_axis = np.arctan2(-start[1], -start[0])
    turned = to_axis + np.copysign(np.arcsin(abs(aside_mm) / apart), aside_mm)
    along = np.linspace(0, 1.6 * apart, 9)[:, None]
    return np.asarray(start + along * np.array([np.cos(turned), np.sin(turned)]))


def target_mm(bore: Bore) -> Coordinates:
    """Return the place where the basal turn begins, (3,)."""
    beyond = 0.0 if bore.network is None else bore.network.cochlea_mm
    return np.array([0.0, 0.0, bore.length_mm + beyond])
