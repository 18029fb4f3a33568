"""What a Zarr array declares, and how much its compressed bytes expand to.

Metadata are taken from the disk only where they are on the lists. How much compressed bytes expand to is known
before they are expanded. Chunks and the like come from files: one of a kilobyte may state, or hold, gigabytes.
"""

import gzip
import io
import itertools
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.json_values import an_object, read_object

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_RAW, _REPEATED, _COMPRESSED = range(3)
_PIECE = 1 << 20
CHECKSUM = "crc32c"
TEXTS = "string"
MOST_AXES = 8
_WHOLE = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_V2_LETTERS = "biuf"


def expanded_bytes(data: bytes, codec: str, most: int, subject: str) -> int:
    """Return how many bytes ``data`` expands to, any number above ``most`` where it is more than that.

    ``codec`` is zstd, blosc, lz4, gzip or zlib, framed as Zarr has them. Takes no more than about ``most`` bytes of
    memory. Raises :class:`EndoctError`, naming ``subject``, where ``data`` is no such stream.
    """
    with refusing(f"{subject} is not compressed with {codec}, or damaged"):
        return _CODECS[codec](data, most)


def _zstd(data: bytes, most: int) -> int:
    stated = _stated_zstd(data)
    return _expanded_zstd(data, most) if stated is None else stated


def _stated_zstd(data: bytes) -> int | None:
    """Return the size that the only frame of ``data`` states (RFC 8878), None where it states none or others follow."""
    if data[:4] != _ZSTD_MAGIC:
        raise ValueError("another beginning")
    flags = data[4]
    single, checksum = bool(flags & 0x20), bool(flags & 0x04)
    place = 5 + (0 if single else 1) + (0, 1, 2, 4)[flags & 3]
    width = (1 if single else 0, 2, 4, 8)[flags >> 6]
    stated = int.from_bytes(data[place : place + width], "little") + (256 if width == 2 else 0)
    place += width
    last = False
    while not last:
        if place + 3 > len(data):
            raise ValueError("cut off")
        header = int.from_bytes(data[place : place + 3], "little")
        last, kind, size = bool(header & 1), header >> 1 & 3, header >> 3
        if kind not in (_RAW, _REPEATED, _COMPRESSED):
            raise ValueError("damaged")
        place += 3 + (1 if kind == _REPEATED else size)
    return stated if width and place + 4 * checksum == len(data) else None


def _expanded_zstd(data: bytes, most: int) -> int:
    try:
        return len(imagecodecs.zstd_decode(data, out=bytearray(most)))
    except imagecodecs.ZstdError as error:
        if "too small" not in str(error):
            raise
        return most + 1


def _blosc(data: bytes, _most: int) -> int:
    n_bytes, block, n_compressed = struct.unpack_from("<III", data, 4)
    if n_compressed != len(data) or block > max(n_bytes, 1):
        raise ValueError("its header does not fit it")
    return int(n_bytes)


def _lz4(data: bytes, _most: int) -> int:
    return int(struct.unpack_from("<I", data)[0])


def _gzip(data: bytes, most: int) -> int:
    total = 0
    with gzip.open(io.BytesIO(data)) as file:
        while total <= most and (piece := file.read(_PIECE)):
            total += len(piece)
    return total


def _zlib(data: bytes, most: int) -> int:
    stream, total = zlib.decompressobj(), 0
    while total <= most and not stream.eof:
        piece = stream.decompress(data, _PIECE)
        data = stream.unconsumed_tail
        total += len(piece)
        if not piece and not data and not stream.eof:
            raise ValueError("cut off")
    return total


_CODECS: Mapping[str, Callable[[bytes, int], int]] = {
    "zstd": _zstd,
    "blosc": _blosc,
    "lz4": _lz4,
    "gzip": _gzip,
    "zlib": _zlib,
}
COMPRESSORS = frozenset(_CODECS)


@dataclass(frozen=True)
class Allowed:
    """Data types, by Zarr's names, and codecs that arrays may have."""

    types: frozenset[str]
    codecs: frozenset[str]


OWN = Allowed(
    frozenset(("bool", *_WHOLE, "float16", "float32", "float64", TEXTS)),
    frozenset(("bytes", "vlen-utf8", "zstd", CHECKSUM)),
)
"""These are the types and codecs that endoct itself writes."""
LABELS = Allowed(
    frozenset(("bool", *_WHOLE)),
    frozenset(("bytes", "transpose", "sharding_indexed", "zstd", "gzip", "blosc", "zlib", "lz4", CHECKSUM)),
)
"""These are the types and codecs that other programs write labels with."""


@dataclass(frozen=True)
class Declared:
    """An array as its metadata declare it.

    ``shape``, ``chunk`` and, within a shard, ``inner`` in samples of ``dtype`` (None: texts); ``compression`` by name
    in the order of writing; ``key`` the beginning of the names of chunks and what stands between their numbers.
    """

    folder: Path
    zarr_format: int
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    dtype: np.dtype[Any] | None
    compression: tuple[str, ...]
    key: tuple[str, str]
    inner: tuple[int, ...] = ()
    index_first: bool = False
    index_checksum: bool = False

    @property
    def is_sharded(self) -> bool:
        """Whether a chunk is a shard of smaller ones."""
        return bool(self.inner)

    @property
    def itemsize(self) -> int:
        """Bytes of a sample; of a text those of the reference to it."""
        return 8 if self.dtype is None else self.dtype.itemsize

    @property
    def n_bytes(self) -> int:
        """Bytes of all samples."""
        return math.prod(self.shape) * self.itemsize

    @property
    def n_chunks(self) -> tuple[int, ...]:
        """How many chunks lie along every axis."""
        return tuple(-(-n // c) for n, c in zip(self.shape, self.chunk, strict=True))

    @property
    def n_inner(self) -> tuple[int, ...]:
        """How many smaller chunks lie along every axis of a shard."""
        return tuple(n // c for n, c in zip(self.chunk, self.inner, strict=True)) if self.inner else ()

    def chunk_keys(self) -> Iterator[str]:
        """Yield the names of all chunks, relative to the array's folder."""
        if 0 in self.n_chunks:  # however many there would be along the other axes
            return
        prefix, separator = self.key
        for index in itertools.product(*map(range, self.n_chunks)):
            yield separator.join([*([prefix] if prefix else []), *map(str, index)]) or "0"


def declared(folder: Path, allowed: Allowed) -> Declared:
    """Return what the Zarr array in ``folder``, of format 3 or 2, declares.

    Raises :class:`EndoctError` where there is none, or it has a codec, a data type or a form that is not allowed.
    """
    with refusing(f"{folder} is no Zarr array that can be read"):
        if (folder / "zarr.json").is_file():
            return _third(folder, read_object(folder / "zarr.json"), allowed)
        found = read_object(folder / ".zarray")
        if (folder / ".zattrs").exists():  # Zarr reads it as well
            read_object(folder / ".zattrs")
        return _second(folder, found, allowed)


def _third(folder: Path, metadata: Mapping[str, Any], allowed: Allowed) -> Declared:
    _expect(folder, "node type", metadata.get("node_type"), ["array"])
    _expect(folder, "format", metadata.get("zarr_format"), [3])
    _expect(folder, "storage transformers", metadata.get("storage_transformers", []), [[]])
    data_type = _expect(folder, "data type", metadata.get("data_type"), sorted(allowed.types))
    shape = _lengths(folder, metadata.get("shape"), least=0)
    grid = an_object(metadata.get("chunk_grid"), f"the chunk grid of {folder}")
    _expect(folder, "chunk grid", grid.get("name"), ["regular"])
    chunk = _lengths(folder, _configuration(grid).get("chunk_shape"), least=1, like=shape)
    names = an_object(metadata.get("chunk_key_encoding"), f"the chunk names of {folder}")
    kind = _expect(folder, "chunk names", names.get("name"), ["default", "v2"])
    separator = _configuration(names).get("separator", "/" if kind == "default" else ".")
    _expect(folder, "separator of chunk names", separator, ["/", "."])
    codecs = _codecs(folder, metadata.get("codecs"), allowed)
    first = _serializer(folder, codecs, data_type)
    declared = Declared(
        folder=folder,
        zarr_format=3,
        shape=shape,
        chunk=chunk,
        dtype=None if data_type == TEXTS else np.dtype(data_type),
        compression=_compression(folder, [name for name, _ in codecs[first + 1 :]]),
        key=("c" if kind == "default" else "", separator),
    )
    return _sharded(declared, codecs[first][1], allowed) if codecs[first][0] == "sharding_indexed" else declared


def _second(folder: Path, metadata: Mapping[str, Any], allowed: Allowed) -> Declared:
    _expect(folder, "format", metadata.get("zarr_format"), [2])
    _expect(folder, "filters", metadata.get("filters"), [None, []])
    _expect(folder, "order", metadata.get("order"), ["C", "F"])
    # the letters are looked at before the text is made a data type of: NumPy knows many more
    text = metadata.get("dtype")
    if not isinstance(text, str) or len(text) != 3 or text[0] not in "<>|" or text[1] not in _V2_LETTERS:
        _expect(folder, "data type", text, sorted(allowed.types))
    dtype = np.dtype(str(text))
    _expect(folder, "data type", dtype.name, sorted(allowed.types))
    shape = _lengths(folder, metadata.get("shape"), least=0)
    compressor = metadata.get("compressor")
    name = None if compressor is None else an_object(compressor, f"the compressor of {folder}").get("id")
    _expect(folder, "compressor", name, [None, *sorted(COMPRESSORS & allowed.codecs)])
    separator = _expect(folder, "separator of chunk names", metadata.get("dimension_separator", "."), ["/", "."])
    return Declared(
        folder=folder,
        zarr_format=2,
        shape=shape,
        chunk=_lengths(folder, metadata.get("chunks"), least=1, like=shape),
        dtype=dtype,
        compression=() if name is None else (str(name),),
        key=("", separator),
    )


def _sharded(outer: Declared, metadata: Mapping[str, Any], allowed: Allowed) -> Declared:
    folder = outer.folder
    if outer.compression:
        raise EndoctError(f"{folder} has shards that are compressed as a whole", expected="shards as they are")
    inner = _lengths(folder, metadata.get("chunk_shape"), least=1, like=outer.shape)
    if any(n % c for n, c in zip(outer.chunk, inner, strict=True)):
        raise EndoctError(f"{folder} has shards that its chunks do not fill", found=f"{inner} in {outer.chunk}")
    plain = Allowed(allowed.types, allowed.codecs - {"sharding_indexed"})
    codecs = _codecs(folder, metadata.get("codecs"), plain)
    first = _serializer(folder, codecs, "")
    index = _codecs(folder, metadata.get("index_codecs"), Allowed(frozenset(), frozenset(("bytes", CHECKSUM))))
    if (found := [name for name, _ in index]) not in (["bytes"], ["bytes", CHECKSUM]) or index[0][1].get(
        "endian", "little"
    ) != "little":
        raise EndoctError(f"{folder} has an index of shards that is not known", found=", ".join(found))
    where = _expect(folder, "place of the index", metadata.get("index_location", "end"), ["start", "end"])
    return replace(
        outer,
        compression=_compression(folder, [name for name, _ in codecs[first + 1 :]]),
        inner=inner,
        index_first=where == "start",
        index_checksum=len(index) == 2,
    )


def _codecs(folder: Path, metadata: object, allowed: Allowed) -> list[tuple[str, dict[str, Any]]]:
    """Return (name, configuration) of every codec listed."""
    if not isinstance(metadata, list) or not 0 < len(metadata) <= MOST_AXES:
        raise EndoctError(f"{folder} has no list of codecs", expected=f"one to {MOST_AXES}")
    found = []
    for codec in metadata:
        given = {"name": codec} if isinstance(codec, str) else an_object(codec, f"a codec of {folder}")
        name = _expect(folder, "codec", given.get("name"), sorted(allowed.codecs - {"zlib", "lz4"}))
        found.append((name, _configuration(given)))
    return found


def _serializer(folder: Path, codecs: Sequence[tuple[str, object]], data_type: str) -> int:
    """Return the place of the codec that makes bytes of samples; before it come those that reorder them."""
    names = [name for name, _ in codecs]
    first = next((k for k, name in enumerate(names) if name != "transpose"), len(names) - 1)
    wanted = ["vlen-utf8"] if data_type == TEXTS else ["bytes", "sharding_indexed"]
    _expect(folder, "codec", names[first], wanted)
    return first


def _compression(folder: Path, names: list[str]) -> tuple[str, ...]:
    if set(names) - COMPRESSORS - {CHECKSUM} or sum(name in COMPRESSORS for name in names) > 1 or len(names) > 3:
        raise EndoctError(f"{folder} has codecs in an order that is not known", found=", ".join(names))
    return tuple(names)


def _configuration(named: Mapping[str, Any]) -> dict[str, Any]:
    found = named.get("configuration", {})
    return found if isinstance(found, dict) else {}


def _lengths(folder: Path, metadata: object, *, least: int, like: tuple[int, ...] | None = None) -> tuple[int, ...]:
    axes = len(metadata) if isinstance(metadata, list) else -1
    if not isinstance(metadata, list) or axes > MOST_AXES or (like is not None and axes != len(like)):
        expected = f"a list of {f'at most {MOST_AXES}' if like is None else len(like)} whole numbers"
        raise EndoctError(f"{folder} has no shape that can be used", found=repr(metadata)[:80], expected=expected)
    if any(isinstance(n, bool) or not isinstance(n, int) or not least <= n < 2**62 for n in metadata):
        raise EndoctError(f"{folder} has an impossible shape", expected=f"whole numbers from {least}")
    if math.prod(max(n, 1) for n in metadata) >= 2**62:
        raise EndoctError(f"{folder} has an impossible shape", expected="fewer samples")
    return tuple(metadata)


def _expect(folder: Path, subject: str, value: Any, wanted: Sequence[Any]) -> Any:
    # 1 == True: of equal values only those of one type are the same
    if not any(type(value) is type(wished) and value == wished for wished in wanted):
        raise EndoctError(
            f"{folder} is not read because of its {subject}",
            found=repr(value)[:80],
            expected=", ".join(map(str, wanted)),
            remedy="save it with one of these",
        )
    return value
