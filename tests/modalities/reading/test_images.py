"""What the header of a single image says of its pixels."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from endoct.modalities.reading.recording import open_stack


@pytest.mark.parametrize("suffix", [".tif", ".png", ".jpg"])
@pytest.mark.parametrize(("dpi", "aspect"), [((150, 100), 2 / 3), ((100, 150), 1.5), ((100, 100), 1.0), (None, 1.0)])
def test_the_aspect_of_pixels_by_the_resolution(
    suffix: str, dpi: tuple[int, int] | None, aspect: float, tmp_path: Path
) -> None:
    image = Image.fromarray(np.zeros((16, 24, 3), np.uint8))
    image.save(tmp_path / f"a{suffix}", **({} if dpi is None else {"dpi": dpi}))
    assert open_stack(tmp_path / f"a{suffix}").pixel_aspect == pytest.approx(aspect, rel=1e-3)
