"""Writes the CT of a simulated bone and its labels as NIfTI."""

import gzip
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.ct.nifti import OUR_LABELS
from endoct.stitching.nifti import nifti_header
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.ct.scanning import scan
from endoct.synthetic.sample.parameters import Sample

LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
LEVEL = 4  # of the compression: more takes long and gains little on noise


def write_ct(folder: Path, sample: Sample) -> None:
    """Write what the sample has of ``ct.nii.gz`` with ``_labels`` and ``_cells``, and of ``cone_beam.nii.gz``."""
    if sample.ct is not None:
        before = scan(sample, sample.ct, drilled=False)
        _write(folder / "ct.nii.gz", before.hu, before.lattice, "HU before drilling")
        _write(folder / "ct_labels.nii.gz", before.label, before.lattice, OUR_LABELS)
        _write(folder / "ct_cells.nii.gz", before.cell, before.lattice, "cell_id as in wall.zarr")
    if sample.cone_beam is not None:
        after = scan(sample, sample.cone_beam, drilled=True)
        _write(folder / "cone_beam.nii.gz", after.hu, after.lattice, "HU after drilling")


def _write(path: Path, voxels: NDArray[np.generic], lattice: Lattice, text: str) -> None:
    to_lps = np.eye(4)
    to_lps[:3, :3], to_lps[:3, 3] = lattice.steps_mm[::-1].T, lattice.origin_mm
    k, j, i = lattice.shape
    with path.open("wb") as file, gzip.GzipFile("", "wb", LEVEL, file, mtime=0) as stream:
        stream.write(nifti_header((i, j, k), voxels.dtype, LPS_TO_RAS @ to_lps, "patient, RAS", text))
        for slice_ in voxels:
            stream.write(slice_.astype(slice_.dtype.newbyteorder("<"), copy=False).tobytes())
