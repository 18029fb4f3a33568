"""Unrolling a pullback as the workbench does."""

from pathlib import Path
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from endoct.modalities.assembly import assemble
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.manifest import MANIFEST, OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.pullback_stream import Pullback
from endoct.stitching.panorama import Panorama
from tests.modalities.oct.phantom import Phantom


class Unrolled(NamedTuple):
    """A pullback, its calibration and its panorama."""

    stream: Pullback
    calibration: OctCalibration
    panorama: Panorama


class UnrollPhantom(Protocol):
    """Unrolls a phantom, or other pages with its sidecar."""

    def __call__(self, phantom: Phantom, pages: NDArray[Any] | None = None, **parameters: Any) -> Unrolled: ...


def unroll(path: Path, acquisition: OctAcquisition, **parameters: Any) -> Unrolled:
    """Open, survey, unroll and settle, as the workbench does."""
    stream = OCT.open(path, acquisition)
    calibration = OCT.survey(stream, OctParameters(**parameters))
    strips = [OCT.unroll(stream[i], calibration) for i in range(len(stream))]
    panorama = OCT.settle(assemble(strips, calibration, MANIFEST), calibration)
    return Unrolled(stream, calibration, panorama)
