"""Mutations of the metadata of Zarr stores, of the third format and of the second: what readers take sizes from."""

import json
from random import Random
from typing import Any

from benchmarks.fuzz.texts import mutate_json
from benchmarks.fuzz.values import NAMES, integer

_DATA_TYPES: tuple[Any, ...] = (
    "bool", "int8", "uint8", "int16", "uint16", "uint32", "int64", "uint64", "float16", "float32", "float64",
    "complex64", "complex128", "string", "bytes", "variable_length_bytes", "r8", "r16", "r99999999999", "r-8",
    "float128", "int", "", "numpy.datetime64",
    {"name": "numpy.datetime64", "configuration": {"unit": "s", "scale_factor": 1}},
    {"name": "fixed_length_utf32", "configuration": {"length_bytes": 2**31}},
    {"name": "fixed_length_utf32", "configuration": {"length_bytes": 20}},
    {"name": "null_terminated_bytes", "configuration": {"length_bytes": -1}},
    {"name": "null_terminated_bytes", "configuration": {"length_bytes": 3}},
    {"name": "raw_bytes", "configuration": {"length_bytes": 2**40}},
    {"name": "struct", "configuration": {"fields": [["a", "float32"], ["b", "uint8"]]}},
    {"name": "structured", "configuration": {"fields": [["a", "float32"]]}}, {"name": "float32"}, None, 3,
)  # fmt: skip


def _codec(name: str, **configuration: Any) -> dict[str, Any]:
    return {"name": name, "configuration": configuration}


_BYTES = _codec("bytes", endian="little")
_CODECS: tuple[Any, ...] = (
    [], [_BYTES], [{"name": "bytes"}], [_codec("bytes", endian="big")], [_BYTES, {"name": "gzip"}], [_BYTES] * 2,
    [_BYTES, _codec("gzip", level=99)], [_BYTES, {"name": "crc32c"}], ["bytes"], [None], [{"name": "vlen-utf8"}],
    [_BYTES, _codec("zstd", level=10**9, checksum=True)], [{"name": "vlen-bytes"}], [{"name": "x"}], [{"name": "../x"}],
    [_codec("numcodecs.zlib"), _BYTES], [_codec("numcodecs.pickle")], [_BYTES, _codec("numcodecs.lzma", level=1)],
    [_codec("transpose", order=[1, 0]), _BYTES], [_codec("transpose", order=[0, 0]), _BYTES],
    [_codec("transpose", order="F"), _BYTES], [_codec("numcodecs.delta", dtype="<i8"), _BYTES],
    [_BYTES, _codec("blosc", typesize=0, cname="lz4", clevel=5, shuffle="bitshuffle", blocksize=2**31)],
    [_codec("sharding_indexed", chunk_shape=[1, 1], codecs=[_BYTES], index_codecs=[_BYTES, {"name": "crc32c"}])],
    [_codec("sharding_indexed", chunk_shape=[0, 0], codecs=[], index_codecs=[])],
    [_codec("sharding_indexed", chunk_shape=[5, 7], codecs=[_BYTES], index_codecs=[_BYTES])],
)  # fmt: skip
_DTYPES_2: tuple[Any, ...] = (
    "|u1", "<f4", ">f8", "<i8", "|b1", "|O", "<U9", "|S0", "<M8[ns]", "<f2", "<c8", "|V10", "<U999999999", "x", "",
    [["a", "<f4"]], [["a", "<f4", [2, 3]]], 3, None,
)  # fmt: skip
_COMPRESSORS: tuple[Any, ...] = (
    None, {"id": "zlib", "level": 1}, {"id": "gzip"}, {"id": "blosc"}, {"id": "pickle"}, {"id": "x"}, {},
    {"id": None}, "zlib", {"id": "lzma", "filters": [{"id": 99}]}, {"id": "zstd", "level": 10**12},
    {"id": "bz2", "level": -1},
    {"id": "blosc", "cname": "x", "clevel": 99, "shuffle": 7, "blocksize": -1}, {"id": "zlib", "level": "x"},
)  # fmt: skip
_FILTERS: tuple[Any, ...] = (
    None, [], [{"id": "vlen-utf8"}], [{"id": "delta", "dtype": "<i4"}], [{"id": "pickle"}], [{"id": "json2"}],
    [{"id": "x"}], [{"id": "shuffle", "elementsize": 0}], [{"id": "vlen-array", "dtype": "<f4"}],
    [{"id": "packbits"}],
    [{"id": "fixedscaleoffset", "offset": 0, "scale": 0, "dtype": "<f4", "astype": "<u1"}],
    [{"id": "categorize", "labels": [], "dtype": "<U3", "astype": "u1"}],
)  # fmt: skip
_FILLS: tuple[Any, ...] = (
    0, -1, 1.5, "NaN", "Infinity", "-Infinity", "0x7fc00000", "", "x", None, True, [], [1, 2], {}, "AAAA", 2**64,
    1e308, 10**400,
)  # fmt: skip
_SEPARATORS = ("/", ".", "", "/../", "//", "\0", "x", None, 3)


def mutate_store_json(data: bytes, rng: Random) -> bytes:
    """Return a store's metadata with one of its fields at a border; the rest is as it was."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return mutate_json(data, rng)
    if not isinstance(document, dict) or rng.random() < 0.35:
        return mutate_json(data, rng)
    nodes = [document]
    consolidated = document.get("consolidated_metadata") or document
    inner = consolidated.get("metadata") if isinstance(consolidated, dict) else None
    if isinstance(inner, dict):
        nodes += [node for node in inner.values() if isinstance(node, dict)]
    node = rng.choice(nodes)
    if "codecs" in node or node.get("node_type") == "array":
        _change_array(node, rng)
    elif "compressor" in node:
        _change_array_2(node, rng)
    else:
        _change_group(node, rng)
    return json.dumps(document).encode()


def _change_array(node: dict[str, Any], rng: Random) -> None:
    kind = rng.randrange(9)
    if kind == 0:
        node["data_type"] = rng.choice(_DATA_TYPES)
    elif kind == 1:
        node["codecs"] = rng.choice(_CODECS)
    elif kind == 2:
        node["fill_value"] = rng.choice(_FILLS)
    elif kind in (3, 4):
        node["shape"] = _shape(node.get("shape"), rng)
    elif kind == 5:
        chunks = rng.choice((_shape(node.get("shape"), rng), [1] * 2, [0, 0], [1] * 40))
        node["chunk_grid"] = {"name": "regular", "configuration": {"chunk_shape": chunks}}
    elif kind == 6:
        form = {"name": rng.choice(("default", "v2", "x")), "configuration": {"separator": rng.choice(_SEPARATORS)}}
        node["chunk_key_encoding"] = form
    elif kind == 7:
        node["dimension_names"] = rng.choice((None, [], ["z"], [None] * 9, ["", "\0"], [1, 2], "zt"))
    else:
        key = rng.choice(("node_type", "zarr_format", "storage_transformers", "attributes", "must_understand"))
        node[key] = rng.choice(("array", "group", 2, 3, 4, None, [], {}, [{"name": "x"}], "x"))


def _change_array_2(node: dict[str, Any], rng: Random) -> None:
    keys = ("shape", "chunks", "dtype", "compressor", "filters", "fill_value", "order", "dimension_separator")
    key = rng.choice(("shape", *keys))
    if key in ("shape", "chunks"):
        node[key] = _shape(node.get(key), rng)
    else:
        hostile: dict[str, tuple[Any, ...]] = {
            "dtype": _DTYPES_2, "compressor": _COMPRESSORS, "filters": _FILTERS, "fill_value": _FILLS,
            "order": ("C", "F", "x", None), "dimension_separator": _SEPARATORS,
        }  # fmt: skip
        node[key] = rng.choice(hostile[key])


def _change_group(node: dict[str, Any], rng: Random) -> None:
    path: Any = rng.choice(("../../etc", "/etc", "", ".", "nowhere", 3, None, [], "fine/c", "a" * 300, *NAMES[:8]))
    levels: Any = [{"datasets": [{"path": path}]}]
    odd: tuple[Any, ...] = ([], {}, "x", [{}], [{"datasets": []}], [{"datasets": {}}], [[]], [{"datasets": [path]}])
    levels = rng.choice((levels, *odd))
    attributes = node.setdefault("attributes", {}) if "attributes" in node or "node_type" in node else node
    if not isinstance(attributes, dict) or rng.random() < 0.3:
        key = rng.choice(("node_type", "zarr_format", "consolidated_metadata", "attributes"))
        inline = {"kind": "inline", "metadata": {"x": {}}}
        node[key] = rng.choice((None, 2, 3, [], {}, "group", "array", {"metadata": {}}, inline))
    elif "multiscales" in attributes or "ome" in attributes:
        attributes.clear()
        document = {"multiscales": levels}
        attributes |= rng.choice((document, {"ome": document}, {"ome": levels}, {"ome": None}))
    elif attributes:
        key = rng.choice(list(attributes))
        numbers = (0, -1, 1e308, -1e308, 1e-308, float("nan"), float("inf"), 10**400, True)
        attributes[key] = rng.choice((*numbers, "x", None, [], {}, "nan", "1.25"))


def _shape(shape: Any, rng: Random) -> Any:
    kind = rng.random()
    if kind < 0.25:
        odd: tuple[Any, ...] = (None, "x", {}, [None, 2], ["3", "4"], [1.5, 2], [True, 3], [[2], 3])
        return rng.choice(([], [0], [0, 0], [-1, 4], [1] * 70, *odd))
    lengths = list(shape) if isinstance(shape, list) and shape else [3, 4]
    if kind < 0.85:
        lengths[rng.randrange(len(lengths))] = integer(rng)
    elif kind < 0.92:
        lengths = [integer(rng) for _ in lengths]
    else:
        lengths = rng.choice((lengths[1:], [1, *lengths], lengths[::-1], lengths * 2))
    return lengths
