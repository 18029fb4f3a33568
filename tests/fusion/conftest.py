"""Two panoramas of one made-up bore."""

from collections.abc import Callable

import pytest
from bore_pairs import Pair, make_pair, panorama

from endoct.stitching.panorama import Panorama


@pytest.fixture(scope="session")
def pair_of() -> Callable[..., Pair]:
    """Make a pair of panoramas, see :func:`bore_pairs.make_pair`."""
    return make_pair


@pytest.fixture(scope="session")
def panorama_of() -> Callable[..., Panorama]:
    """Make a panorama from an image, see :func:`bore_pairs.panorama`."""
    return panorama


@pytest.fixture(scope="session")
def pair() -> Pair:
    """One pair in place: nothing mirrored or reversed."""
    return make_pair()
