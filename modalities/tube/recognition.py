"""Whether a recording shows the marks of a tube well enough to be calibrated by."""

from collections.abc import Sequence

from endoct.base.arrays import Coordinates
from endoct.base.errors import NotSeen
from endoct.modalities.tube.locating import Pose
from endoct.modalities.tube.target import Target

LEAST_CORRELATION = 0.6
LEAST_LEAD = 0.03
"""By which the best orientation's correlation must exceed that of the next."""
REMEDY = (
    "check that tube.toml is that of this tube, and that the recording reaches from before its first ring to behind "
    "its second"
)


def clear_pose(poses: Sequence[Pose]) -> Pose:
    """Return the best of ``poses``, one for each orientation, the best first.

    Raises :class:`NotSeen` where it does not fit, or another orientation fits as well.
    """
    best, *others = poses
    if best.correlation < LEAST_CORRELATION:
        raise NotSeen(
            "the marks of the tube are not seen",
            found=f"a correlation of {best.correlation:.2f} with its grooves and rings at best",
            expected=f"at least {LEAST_CORRELATION}",
            remedy=REMEDY,
        )
    if others and best.correlation - others[0].correlation < LEAST_LEAD:
        raise NotSeen(
            "which way the tube lies cannot be told",
            found=f"correlations of {best.correlation:.2f} and {others[0].correlation:.2f} for two orientations",
            remedy=REMEDY,
        )
    return best


def check_rings(target: Target, z_mm: Coordinates) -> None:
    """Raise :class:`NotSeen` where a recording at ``z_mm`` (n,) of the tube does not show both rings."""
    edges = target.ring_edges_mm
    whole = [
        name
        for name, low, high in (("narrow", edges[0], edges[1]), ("wide", edges[2], edges[3]))
        if ((z_mm > low) & (z_mm < high)).any() and z_mm.min() < low and z_mm.max() > high
    ]
    if len(whole) < 2:
        raise NotSeen(
            "the recording does not show both rings of the tube",
            found=f"the {whole[0]} one alone" if whole else "neither, whole",
            expected="both, from one edge to the other",
            remedy=f"record the tube from {edges[0] - 0.5:.1f} to {edges[3] + 0.5:.1f} mm at least",
        )
