"""A frame's light sampled and averaged by torch: the steps of the reference in :mod:`.unroll`. Loads torch."""

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.device import memory_of
from endoct.modalities.endoscope.flatfield import FlatField
from endoct.modalities.endoscope.light import DARKEST, UNSEEN


def averaged(
    image: Image,
    places: tuple[Image, Image],
    flat: FlatField,
    flat_places: tuple[Coordinates, Coordinates],
    shape: tuple[int, int],
    device: str,
) -> tuple[Image, Mask]:
    """Return means of ``image`` over its light on bone, of equal blocks, and where all of a block is seen: ``shape``.

    ``places`` are columns and rows of the image, float32 (n_rows, n_columns); ``flat_places`` the rows and the columns
    of ``flat`` at these, float64 (n_rows,) and (n_columns,). ``device``, as torch names it. Places round to float32
    shares of the image, which is 1e-4 px. Raises ``MemoryError`` where the device's memory does not hold the frame.
    """
    with memory_of(device):
        columns, rows = (torch.from_numpy(one).to(device) for one in places)
        around = pad(torch.from_numpy(image).to(device)[None], (1, 1, 1, 1), value=UNSEEN)
        light = _sampled(around, columns + 1, rows + 1)[0]
        flat_rows, flat_columns = (torch.from_numpy(one.astype(np.float32)).to(device) for one in flat_places)
        maps = _maps(flat, device)
        flat_columns = flat_columns.remainder(maps.shape[2] - 1)
        log_light, usable = _sampled(maps, *torch.meshgrid(flat_columns, flat_rows, indexing="xy"))
        ratio = light.clamp(min=DARKEST) / log_light.exp()
        ratio[(light > 1) | (usable <= 0.5)] = torch.nan
        blocks = ratio.reshape(shape[0], light.shape[0] // shape[0], shape[1], light.shape[1] // shape[1])
        mean = blocks.mean(dim=(1, 3))
        return mean.nan_to_num(0).cpu().numpy(), ~mean.isnan().cpu().numpy()


@lru_cache(maxsize=2)  # two sides of a comparison
def _maps(flat: FlatField, device: str) -> Tensor:
    """Logarithm of the light and where it is usable, closed to a circle: float32 (2, n_rows, n_theta + 1)."""
    maps = np.stack([flat.log_light, flat.usable.astype(np.float32)])
    return torch.from_numpy(np.concatenate([maps, maps[:, :, :1]], axis=2)).to(device)


def _sampled(maps: Tensor, columns: Tensor, rows: Tensor) -> Tensor:
    """Return ``maps`` (n, row, column) bilinearly at fractional places, those beyond them at their edge."""
    n_rows, n_columns = maps.shape[1:]
    shares = torch.stack([columns * (2 / (n_columns - 1)) - 1, rows * (2 / (n_rows - 1)) - 1], dim=-1)
    return grid_sample(maps[None], shares[None], padding_mode="border", align_corners=True)[0]
