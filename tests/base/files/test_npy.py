"""NumPy's files are read without pickles, and their sizes are looked at first."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.base.files.npy import read_npy, read_npz, write_npz


def npy(shape: str, descr: str = "'<f4'", data: bytes = b"") -> bytes:
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data


@pytest.mark.parametrize(
    "values",
    [np.arange(12.0).reshape(3, 4), np.asfortranarray(np.arange(6, dtype="u2").reshape(2, 3)), np.array("text"),
     np.zeros((0, 3)), np.array([True, False]), np.arange(3, dtype=">i4")],
)  # fmt: skip
def test_what_numpy_writes_is_read(values: np.ndarray, tmp_path: Path) -> None:
    file = io.BytesIO()
    np.save(file, values)
    file.seek(0)
    found = read_npy(file, "x")
    assert found.dtype == values.dtype
    assert np.array_equal(found, values)
    np.savez_compressed(tmp_path / "x.npz", values=values)
    assert np.array_equal(read_npz(tmp_path / "x.npz")["values"], values)


def test_what_is_written_is_read_by_numpy_and_has_the_same_bytes_again(tmp_path: Path) -> None:
    arrays = {"image": np.arange(1200, dtype=np.float32).reshape(30, 40), "metadata": np.array("µ")}
    for name in ("one.npz", "two.npz"):
        write_npz(tmp_path / name, arrays)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    for found in (read_npz(tmp_path / "one.npz"), np.load(tmp_path / "one.npz")):
        assert all(np.array_equal(found[name], array) for name, array in arrays.items())


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (npy("(100000, 100000)"), "too much memory"),
        (npy("(-1, 3)"), "no array"),
        (npy("(3,)", data=b"\0" * 11), "cut off"),
        (npy("(3,)", descr="'|O'"), "no array"),
        (npy("()", descr="'<U500000000'"), "too much memory"),
        (npy("(3,)", descr="[('a', '<f4')]"), "no array"),
        (npy("(10000000000,)", descr="'<U0'"), "no array"),
        (npy("(" + "-" * 5000 + "1,)"), "no array"),
        (b"", "no array"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\x7f" + b"x" * 100, "header of"),
        (b"\x93NUMPY\x09\x00" + b"\0" * 100, "version"),
    ],
)
def test_what_is_no_array(data: bytes, message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        read_npy(io.BytesIO(data), "x")


def test_archives_that_expand_too_far(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as members, members.open("image.npy", "w") as file:
        file.write(npy("(150000000,)"))
        for _ in range(600):
            file.write(b"\0" * 1_000_000)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(EndoctError, match="holds too much"):
        read_npz(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as members:
        members.writestr("image.npy", npy("()", data=b"\0" * 4))
    with pytest.raises(EndoctError, match="packed in a way"):
        read_npz(path)
    with zipfile.ZipFile(path, "w") as members:
        for k in range(1001):
            members.writestr(f"{k}.npy", b"")
    with pytest.raises(EndoctError, match="holds too much"):
        read_npz(path)
