"""Tables of numbers."""

from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.unrolled.table import read_table


@pytest.mark.parametrize(
    "text",
    [
        "1,2,\n3,4,5\n",
        "1;2;\n3;4;5",
        "1\t2\t\n\n3\t4\t5",
        "a,b,c\n1,2,NaN\n3,4,5\n",
        "1 2 nan\n3  4 5\n",
        "\ufeff1,2,\n3,4,5",
    ],
)
def test_numbers_are_read_however_they_are_separated(tmp_path: Path, text: str) -> None:
    path = tmp_path / "wall.csv"
    path.write_text(text, encoding="utf-8")
    assert np.array_equal(read_table(path), [[1, 2, np.nan], [3, 4, 5]], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line"),
        ("a,b\n", "one line without a number"),
        ("a,b\nc,d\n1,2\n", "'c' in row 0"),
        ("1,2\n3\n", "1 fields in row 1, 2 in the first"),
        ("1,5;2,5\n3,5;4,5\n", "'1,5' in row 0"),
        ("1,2\n3,x\n", "'x' in row 1"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wall.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(EndoctError) as error:
        read_table(path)
    assert said in str(error.value)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "wall.csv").write_bytes(b"\x80\x81\xff" * 20)
    with pytest.raises(EndoctError, match="no text"):
        read_table(tmp_path / "wall.csv")
