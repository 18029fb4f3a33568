"""Phantoms on disk."""

from pathlib import Path
from typing import Any

import pytest
import tifffile
from numpy.typing import NDArray

from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import Unrolled, UnrollPhantom, unroll


@pytest.fixture
def unrolled(tmp_path: Path) -> UnrollPhantom:
    """Unroll a phantom, or other pages with its sidecar."""

    def make(phantom: Phantom, pages: NDArray[Any] | None = None, **parameters: Any) -> Unrolled:
        path = tmp_path / "pullback.tif"
        tifffile.imwrite(path, phantom.log_counts() if pages is None else pages, photometric="minisblack")
        return unroll(path, phantom.acquisition(), **parameters)

    return make
