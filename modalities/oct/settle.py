"""The assembled panorama of a pullback: its last corrections."""

from endoct.modalities.oct.calibration import OctCalibration
from endoct.stitching.panorama import Panorama


def settle_pullback(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Return ``panorama`` with a helical scan's rows sheared into place."""
    return panorama
