"""Stores that are damaged or lie about themselves are refused in one line, before memory is taken or code is run."""

import json
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from numcodecs.zstd import Zstd

from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.base.zarr.zarr_metadata import expanded_bytes
from endoct.base.zarr.zarr_store import Named, read_arrays, write_arrays
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama, save_panorama

GRID = SurfaceGrid.full_circle(5, 8, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
MOST_TAKEN_BYTES = 400_000_000


def panorama(**changed: Any) -> Panorama:
    made = Panorama(
        GRID, np.ones(GRID.shape), np.zeros(GRID.shape), np.zeros(GRID.shape, np.bool_), np.ones(GRID.shape),
        "oct", True, False, "slice", {"slice_z_mm": np.arange(5.0), "bridged": np.zeros(5, np.bool_)}, {}, ("a",),
    )  # fmt: skip
    return replace(made, **changed)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    save_panorama(panorama(), tmp_path / "p.zarr")
    return tmp_path / "p.zarr"


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))


def set_attribute(store: Path, name: str, value: object) -> None:
    edit(store / "zarr.json", lambda told: told["attributes"].update({name: value}))


def test_what_is_written_is_the_same_every_time_and_has_every_chunk_with_its_sum(tmp_path: Path) -> None:
    for name in ("a.zarr", "b.zarr"):
        save_panorama(panorama(), tmp_path / name)
    one, other = (
        {f.relative_to(root).as_posix(): f.read_bytes() for f in sorted(root.rglob("*")) if f.is_file()}
        for root in (tmp_path / "a.zarr", tmp_path / "b.zarr")
    )
    assert one == other
    # all zero: Zarr leaves such chunks out by itself
    assert {"valid/c/0/0", "depth_mm/c/0/0", "bridged/c/0"} <= one.keys()
    assert json.loads(one["valid/zarr.json"])["codecs"][-1]["name"] == "crc32c"


def test_other_files_in_a_store_disturb_nobody(store: Path) -> None:
    seal(store, "panorama")
    (store / "notes.txt").write_text("mine")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_panorama(store).modality == "oct"
        with xr.open_zarr(store) as opened:
            assert opened["intensity"].dims == ("z", "theta")
            assert float(opened["intensity"].sum()) == 40


def test_what_consolidated_metadata_say_does_not_count(store: Path) -> None:
    def lie(metadata: dict[str, Any]) -> None:
        metadata["consolidated_metadata"]["metadata"]["intensity"]["shape"] = [10**6, 10**6]
        del metadata["consolidated_metadata"]["metadata"]["weight"]

    edit(store / "zarr.json", lie)
    assert load_panorama(store).intensity.shape == GRID.shape


@pytest.mark.parametrize("name", ["intensity", "bridged", "z"])
def test_a_missing_chunk_is_no_zero(name: str, store: Path) -> None:
    shutil.rmtree(store / name / "c")
    with pytest.raises(EndoctError, match="is not whole; found no chunk c/0"):
        load_panorama(store)


def test_a_bit_that_fell_over_is_seen(store: Path) -> None:
    chunk = store / "z" / "c" / "0"
    whole = chunk.read_bytes()
    for place in range(len(whole)):
        chunk.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(EndoctError):
            load_panorama(store)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t["codecs"].insert(0, {"name": "numcodecs.pickle", "configuration": {}}), "because of its codec"),
        (lambda t: t["codecs"].insert(1, {"name": "gzip"}), "because of its codec"),
        (lambda t: t["codecs"].append(t["codecs"][1]), "codecs in an order"),
        (lambda t: t.update(codecs=[]), "no list of codecs"),
        (lambda t: t.update(codecs=7), "no list of codecs"),
        (lambda t: t.update(data_type="variable_length_bytes"), "because of its data type"),
        (lambda t: t.update(data_type={"name": "struct"}), "because of its data type"),
        (lambda t: t.update(data_type="string"), "because of its codec"),
        (lambda t: t.update(shape=[5, -8]), "impossible shape"),
        (lambda t: t.update(shape=[5.0, 8]), "impossible shape"),
        (lambda t: t.update(shape=[5]), "no shape that can be used"),
        (lambda t: t.update(shape=[1] * 9), "no shape that can be used"),
        (lambda t: t.update(shape=[2**40, 2**40]), "impossible shape"),
        (lambda t: t.update(shape=[50_000, 50_000]), "asks for too much memory"),
        (lambda t: t["chunk_grid"]["configuration"].update(chunk_shape=[50_000, 50_000]), "asks for too much memory"),
        (lambda t: (t.update(shape=[4000, 4000]), t["chunk_grid"]["configuration"].update(chunk_shape=[1, 1])), "many"),
        (lambda t: t["chunk_grid"]["configuration"].update(chunk_shape=[0, 8]), "impossible shape"),
        (lambda t: t["chunk_grid"].update(name="rectangular"), "because of its chunk grid"),
        (lambda t: t["chunk_key_encoding"].update(configuration={"separator": "../"}), "separator"),
        (lambda t: t.update(storage_transformers=[{"name": "x"}]), "storage transformers"),
        (lambda t: t.update(zarr_format=2), "because of its format"),
        (lambda t: t.update(chunk_grid=None), "chunk grid"),
        (lambda t: t["codecs"][0]["configuration"].update(endian="middle"), "cannot be read"),
    ],
)
def test_an_array_that_declares_what_endoct_never_writes(
    change: Callable[[dict[str, Any]], object], message: str, store: Path
) -> None:
    edit(store / "intensity" / "zarr.json", change)
    with pytest.raises(EndoctError, match=message) as refused:
        load_panorama(store)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("radius_mm", "abc"), ("radius_mm", -1), ("dz_mm", 0), ("dz_mm", True), ("z0_mm", 1e300), ("theta0_rad", None),
        ("modality", "../../x"), ("modality", "/tmp/x"), ("modality", 3), ("modality", ""), ("frame_dim", "../x"),
        ("frame_dim", ["slice"]), ("provenance", "[]"), ("provenance", "{"), ("provenance", 5),
        ("provenance", "[" * 10**5),
        ("provenance", '{"notes": "one"}'), ("provenance", '{"doubts": [1]}'), ("provenance", '{"doubts": "x"}'),
        ("provenance", '{"doubts": [{"code": "A B", "what": "x"}]}'), ("provenance", '{"parameters": []}'),
        ("provenance", '{"x": ' + "9" * 5000 + "}"), ("provenance", '{"acquisition": "x"}'),
    ],
)  # fmt: skip
def test_attributes_that_cannot_be(name: str, value: object, store: Path) -> None:
    set_attribute(store, name, value)
    with pytest.raises(EndoctError) as refused:
        load_panorama(store)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "changed",
    [
        {"modality": "../x"},
        {"frame_dim": "a/b"},
        {"per_frame": {"../x": np.zeros(5)}},
        {"per_frame": {"intensity": np.zeros(5)}},
        {"per_frame": {"a": np.zeros(5), "b": np.zeros(6)}},
        {"per_frame": {"a": np.float64(1)}},
        {"per_frame": {"a": np.array(["x"] * 5)}},
    ],
)
def test_a_panorama_whose_parts_cannot_be(changed: dict[str, Any]) -> None:
    with pytest.raises(EndoctError):
        panorama(**changed)


def test_links_in_a_store_are_not_followed(store: Path, tmp_path: Path) -> None:
    chunk = store / "weight" / "c" / "0" / "0"
    chunk.rename(tmp_path / "elsewhere")
    chunk.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(EndoctError, match="found a link"):
        load_panorama(store)
    chunk.unlink()
    (tmp_path / "elsewhere").rename(chunk)
    (store / "weight").rename(tmp_path / "weight")
    (store / "weight").symlink_to(tmp_path / "weight")
    with pytest.raises(EndoctError, match="found a link"):
        load_panorama(store)


def bomb(expands_to: int) -> bytes:
    """Return a frame of Zstandard of some kilobytes that states no size and expands to ``expands_to`` zeros."""
    block = 128 * 1024
    n_blocks = expands_to // block
    blocks = b"".join(
        (block << 3 | 1 << 1 | (k == n_blocks - 1)).to_bytes(3, "little") + b"\0" for k in range(n_blocks)
    )
    return b"\x28\xb5\x2f\xfd\x00\x58" + blocks


def test_a_chunk_that_states_no_size_is_expanded_no_further_than_it_may_be() -> None:
    assert expanded_bytes(bomb(2**20), "zstd", 2**20, "x") == 2**20
    assert expanded_bytes(bomb(2**33), "zstd", 2**20, "x") > 2**20
    assert len(bomb(2**33)) < 300_000
    two = Zstd().encode(b"a" * 1000) * 2
    assert expanded_bytes(two, "zstd", 5000, "x") == 2000
    assert expanded_bytes(two, "zstd", 1999, "x") > 1999


@pytest.mark.parametrize("kind", ["expands", "states", "declares", "texts"])
def test_eight_gigabytes_end_in_one_line_and_little_memory(kind: str, store: Path) -> None:
    chunk = store / "intensity" / "c" / "0" / "0"
    if kind == "expands":
        chunk.write_bytes(bomb(2**33) + b"\0\0\0\0")
    elif kind == "states":
        chunk.write_bytes(b"\x28\xb5\x2f\xfd\xe0" + (2**33).to_bytes(8, "little") + bomb(2**20)[6:] + b"\0\0\0\0")
    elif kind == "declares":
        edit(store / "intensity" / "zarr.json", lambda told: told.update(shape=[2**16, 2**15]))
    else:
        shutil.rmtree(store)
        write_arrays(store, {"t": Named(("t",), np.array(["a", "b"], object))}, {"format": "endoct-panorama-1"})
        (store / "t" / "c" / "0").write_bytes(Zstd().encode(b"\xff\xff\xff\x3f" + b"\0" * 8) + b"\0\0\0\0")
    code = (
        "import resource, sys; from pathlib import Path\n"
        "from endoct.stitching.store import load_panorama; from endoct.base.errors import EndoctError\n"
        "from endoct.base.zarr.zarr_store import read_arrays\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: read_arrays(Path(sys.argv[1]))\n"
        "except EndoctError as error: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(store)], capture_output=True, text=True, check=True)
    taken_kb, said = done.stdout.split(" ", 1)
    assert int(taken_kb) * 1024 < MOST_TAKEN_BYTES
    assert said.count("\n") == 1


def test_texts_and_empty_arrays_survive(tmp_path: Path) -> None:
    arrays = {
        "t": Named(("t",), np.array(["oct", "größer"], object)),
        "e": Named(("a", "b"), np.zeros((0, 3))),
        "s": Named((), np.array(2.5)),
    }
    write_arrays(tmp_path / "x.zarr", arrays, {})
    found = read_arrays(tmp_path / "x.zarr")
    assert found["t"].tolist() == ["oct", "größer"]
    assert found["e"].shape == (0, 3)
    assert found["s"] == 2.5


def test_a_store_of_zarr_2_is_no_panorama(tmp_path: Path) -> None:
    zarr.create_group(tmp_path / "p.zarr", zarr_format=2, attributes={"format": "endoct-panorama-1"})
    with pytest.raises(EndoctError, match="is no panorama"):
        load_panorama(tmp_path / "p.zarr")


def test_an_array_without_samples_states_no_chunks_however_long_it_is(store: Path) -> None:
    def empty(metadata: dict[str, Any]) -> None:
        metadata["shape"], metadata["chunk_grid"]["configuration"]["chunk_shape"] = [2**62, 0], [1, 1]

    edit(store / "intensity" / "zarr.json", empty)
    with pytest.raises(EndoctError):
        load_panorama(store)


def test_places_of_frames_are_one_number_each(store: Path) -> None:
    panorama = load_panorama(store)
    with pytest.raises(EndoctError, match=r"frame_z_mm of a panorama cannot be used; found .*one a frame"):
        replace(panorama, frame_dim="frame", per_frame={"frame_z_mm": np.zeros((3, 1))})
