"""NIfTI-1 of a volume: a header of 348 bytes, then voxels as they are made, through gzip where the name ends in .gz."""

from pathlib import Path

import numpy as np

from endoct.stitching.arrays import Coordinates
from endoct.stitching.nifti import nifti_header
from endoct.workbench.exporting.cartesian import Volume
from endoct.workbench.exporting.gzip_stream import GzipStream
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.nrrd import volume_facts, volume_of
from endoct.workbench.exporting.options import Options
from endoct.workbench.exporting.source import Source
from endoct.workbench.running.progress import Stages


def write_nifti(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``; sform and qform place it. Returns what was written.

    World coordinates of NIfTI run right, anterior, superior (RAS): (−x, −y, z) of the bore frame, which is a half turn
    about z and no mirror image. Raises :class:`EndoctError` where there is no volume.
    """
    volume = volume_of(source, options)
    packed = path.suffix == ".gz"
    header = nifti_header(volume.shape, volume.dtype, _to_ras(volume), "bore, RAS", "" if packed else BLANK)
    with stages.stage("NIfTI") as advance, path.open("wb") as file:
        stream = GzipStream(file, BLANK) if packed else file
        stream.write(header)
        for done, voxels in enumerate(volume.slices(), 1):
            stream.write(voxels.astype(voxels.dtype.newbyteorder("<"), copy=False).tobytes())
            advance(done / volume.shape[2])
        if isinstance(stream, GzipStream):
            stream.finish()
    mark(path)
    return volume_facts(volume) | {"space": "RAS: −x, −y and z of the bore frame"}


def _to_ras(volume: Volume) -> Coordinates:
    (dx, dy, dz), (x, y, z) = volume.step_mm, volume.origin_mm
    return np.array([[-dx, 0, 0, -x], [0, -dy, 0, -y], [0, 0, dz, z], [0, 0, 0, 1]], dtype=np.float64)
