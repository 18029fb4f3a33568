"""A mark in a file: it is known again, every other byte counts, and the file stays what it is."""

from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from endoct.workbench.exporting.mark import BLANK, is_marked, mark


def test_a_picture_with_a_mark_is_one_that_others_read(tmp_path: Path) -> None:
    path, said = tmp_path / "figure.png", PngInfo()
    said.add_text("Software", BLANK)
    samples = np.arange(64, dtype=np.uint8).reshape(8, 8)
    Image.fromarray(samples).save(path, pnginfo=said)
    mark(path)
    assert is_marked(path)
    with Image.open(path) as read:  # which checks the sum of each chunk
        assert np.array_equal(np.asarray(read), samples)
        assert read.info["Software"].startswith(BLANK[:16])
        assert read.info["Software"] != BLANK
    whole = path.read_bytes()
    start = whole.index(BLANK[:16].encode())
    for place in (0, start - 1, start + 20, start + len(BLANK) + 4, len(whole) - 1):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert not is_marked(path)


def test_what_is_no_picture_has_no_such_sum(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(f"# {BLANK}1234")
    mark(path)
    assert is_marked(path)
    assert path.read_text().endswith("1234")
    path.write_text(path.read_text().replace("1234", "1235"))
    assert not is_marked(path)
