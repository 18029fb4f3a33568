"""Whether a recording shows the marks of a tube well enough to be calibrated by."""

from collections.abc import Iterable

from endoct.base.arrays import Coordinates
from endoct.base.errors import NotSeen
from endoct.modalities.tube.locating import Pose, Template, poses, rings_sigmas
from endoct.modalities.tube.target import Target

LEAST_CORRELATION = 0.6
WINDING_LEAD = 0.03
"""By which the best orientation's correlation must exceed that with a helical groove that winds the other way."""
CLEAR_LEAD, LEAST_SIGMAS = 0.1, 2.0
"""By which it must exceed that of the tube turned end for end, or else rings must speak for it, in standard errors. It
was right in 28 of 28 recordings by endoscopes, by 2.1 to 10.5 standard errors and a lead of 0.02 to 0.14 (preset
`tube`, seeds 30–37, and independent recordings, seeds 10–29)."""
REMEDY = (
    "check that tube.toml is that of this tube, and that the recording reaches from before its first ring to behind "
    "its second"
)


def clear_pose(
    image: Coordinates, row_z_mm: Coordinates, target: Target, template: Template, scales: Iterable[float]
) -> Pose:
    """Return how an unrolled recording lies on a tube, by :func:`poses` of the same arguments.

    Raises :class:`NotSeen` where the tube's marks are not seen, or another orientation fits as well.
    """
    best, *others = poses(image, row_z_mm, target, template, scales)
    if best.correlation < LEAST_CORRELATION:
        raise NotSeen(
            "the marks of the tube are not seen",
            found=f"a correlation of {best.correlation:.2f} with its grooves and rings at best",
            expected=f"at least {LEAST_CORRELATION}",
            remedy=REMEDY,
        )
    for other in others:
        lead, turned = best.correlation - other.correlation, other.winding == best.winding
        if lead >= (CLEAR_LEAD if turned else WINDING_LEAD):
            continue
        sigmas = rings_sigmas(image, row_z_mm, template, best, other) if turned else 0.0
        if sigmas < LEAST_SIGMAS:
            raise NotSeen(
                "which way the tube lies cannot be told",
                found=f"correlations of {best.correlation:.2f} and {other.correlation:.2f} for two ways, of which "
                f"rings speak for the first by {sigmas:.1f} standard errors",
                expected=f"{LEAST_SIGMAS:g} standard errors",
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
