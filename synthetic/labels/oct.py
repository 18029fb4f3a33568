"""Labels of the pullback: layers, artefacts, noise-free twins, and the pixels that saw the same."""

from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.stitching.parallel import thread_map
from endoct.stitching.zarr_store import consolidate
from endoct.synthetic.labels.arrays import create
from endoct.synthetic.labels.artefacts import FLAGS, artefacts
from endoct.synthetic.labels.pullback import Pullback
from endoct.synthetic.model import Model
from endoct.synthetic.oct.bscan import noise_free
from endoct.synthetic.progress import Advance
from endoct.synthetic.sample.presets import PRESETS

ASCAN = ("slice", "ascan")
LAYERS = {
    "theta_rad": (ASCAN, "f4", "where the beam meets the first solid surface: θ in the bore frame, rad"),
    "z_mm": (ASCAN, "f4", "and z, mm from the mouth"),
    "radius_mm": (ASCAN, "f4", "and its distance from the bore's axis; NaN where none is within reach"),
    "inner_face_row": (ASCAN, "f4", "depth sample of the capillary's inner face"),
    "outer_face_row": (ASCAN, "f4", "depth sample of the capillary's outer face"),
    "fluid_row": (ASCAN, "f4", "depth sample of a fluid's surface, NaN where there is none"),
    "surface_row": (ASCAN, "f4", "depth sample of the first solid surface, may lie beyond the last sample"),
    "exit_row": (ASCAN, "f4", "depth sample at which the beam leaves a thin septum, NaN where it does not"),
    "reentry_row": (ASCAN, "f4", "depth sample at which it meets bone again"),
    "cell_id": (ASCAN, "i4", "1 + index in sample.json of the cell whose surface it is, 0 on the bore's own wall"),
    "dust": (ASCAN, "b1", "the surface is bone dust"),
    "shadow_db": (ASCAN, "f4", "light lost to dirt on the capillary, dB"),
}
OTHERS = {
    "artefact": (("slice", "depth", "ascan"), "u1", "what is not bone, bit flags: " + ", ".join(FLAGS)),
    "frame": (ASCAN, "i4", "endoscope frame that sees the same place most squarely, −1 for none"),
    "frame_row": (ASCAN, "i4", "row of the pixel in that frame, −1 for none"),
    "frame_column": (ASCAN, "i4", "column of the pixel in that frame, −1 for none"),
}


def write_oct_labels(
    folder: Path,
    model: Model,
    pullback: Pullback,
    pixels: NDArray[np.int32],
    advance: Advance,
    workers: int,
) -> None:
    """Write ``oct.zarr`` and the noise-free twins ``oct_clean.tif``.

    ``pixels`` (3, slice, A-scan): frame, row and column of the pixel that sees the same place, −1 for none.
    """
    sample, size = model.sample, PRESETS[model.sample.preset]
    sizes = {"slice": size.n_slices, "depth": size.n_depth, "ascan": size.n_ascans}
    arrays = create(folder / "oct.zarr", sizes, LAYERS | OTHERS, {"axial_pixel_mm": sample.oct.axial_pixel_mm})
    for name in LAYERS:
        arrays[name][:] = getattr(pullback, name)
    for name, values in zip(("frame", "frame_row", "frame_column"), pixels, strict=True):
        arrays[name][:] = values

    def twin(i: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        return noise_free(sample, model.wall, model.appearance, i), artefacts(model, i)

    with tifffile.TiffWriter(
        folder / "oct_clean.tif", bigtiff=size.n_slices * size.n_depth * size.n_ascans > 2**31
    ) as tiff:
        for i, (clean, flags) in enumerate(thread_map(twin, range(size.n_slices), workers)):
            tiff.write(clean, photometric="minisblack", contiguous=True, metadata={"axes": "ZYX"})
            arrays["artefact"][i] = flags
            advance((i + 1) / size.n_slices)
    consolidate(folder / "oct.zarr")
