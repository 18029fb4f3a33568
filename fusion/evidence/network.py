"""The small networks: from what sides show of a sample to a cell's odds, and to its depth.

``benchmarks/wall.py`` trains two, ``benchmarks/light_alone.py`` the third, on simulated bores of two generators. They
say how well these do on others.
"""

from functools import lru_cache
from importlib.resources import files
from itertools import count
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load

Network = Literal["cell", "depth", "light"]
Layers = tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
WEIGHTS = "networks.safetensors"
AT_ONCE = 65_536
"""So many samples keep what is made of them in the cache."""


def answers(network: Network, features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what ``network`` makes of ``features``, float32 (n_features, n), as float32 (n_answers, n)."""
    layers = _layers(network)
    made = np.empty((layers[-1][1].size, features.shape[1]), np.float32)
    for first in range(0, features.shape[1], AT_ONCE):
        part = np.ascontiguousarray(features[:, first : first + AT_ONCE])
        for k, (kernel, bias) in enumerate(layers):
            part = kernel @ part
            part += bias[:, np.newaxis]
            if k < len(layers) - 1:
                np.maximum(part, 0, out=part)
        made[:, first : first + AT_ONCE] = part
    return made


@lru_cache
def _layers(network: Network) -> Layers:
    weights = load(files(__package__).joinpath(WEIGHTS).read_bytes())
    names = ((f"{network}.{k}.weight", f"{network}.{k}.bias") for k in count(0, 2))
    layers = []
    for kernel, bias in names:
        if kernel not in weights:
            break
        layers.append((weights[kernel], weights[bias]))
    return tuple(layers)
