"""How much of the wall a panorama shows, and when that is too little."""

from endoct.stitching.doubt import Doubt
from endoct.stitching.panorama import Panorama

LEAST_VALID_SHARE = 0.9
"""Where less of the wall was observed, that is doubted."""


def doubts_of_observed(panorama: Panorama) -> tuple[Doubt, ...]:
    """Return the doubt that a panorama shows too little wall; nothing where it shows enough, or says so already."""
    code, share = "little-observed", float(panorama.valid.mean())
    if share >= LEAST_VALID_SHARE or any(doubt.code == code for doubt in panorama.doubts):
        return ()
    what = f"Only {share:.1%} of the panorama is observed wall."
    return (Doubt(code, what, value=share, unit="1", expected=(LEAST_VALID_SHARE, 1.0)),)
