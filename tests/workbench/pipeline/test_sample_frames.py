"""Pictures of frames go along with the panorama that is compared."""

from pathlib import Path

import numpy as np
import pytest

from endoct.workbench import compare, unroll
from endoct.workbench.report.pictures import PICTURES, load_pictures


@pytest.mark.usefixtures("without_report")
def test_a_comparison_has_the_pictures_of_its_panoramas(short: Path, tmp_path: Path) -> None:
    stores = []
    for name in ("first", "second"):
        stores.append(tmp_path / f"{name}.zarr")
        settings = {"feed_sigma": 0.2 if name == "first" else 0.25}
        unroll(short / "endoscope", stores[-1], settings=settings, progress=False)
    compare(*stores, tmp_path / "result", settings={"n_theta": 512}, progress=False)
    found = load_pictures(tmp_path / "result" / PICTURES)
    assert set(found) == {"endoscope-1", "endoscope-2"}
    for store, side in zip(stores, found.values(), strict=True):
        of_store = load_pictures(store / PICTURES)["endoscope"]
        assert side.keys() == of_store.keys() == {2, 6, 10}
        for mine, its in zip(side[6], of_store[6], strict=True):
            assert (mine.name, mine.title, list(mine.curves)) == (its.name, its.title, list(its.curves))
            np.testing.assert_array_equal(mine.image, its.image)
