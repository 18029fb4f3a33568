"""Meshes as PLY, STL and GLB: three short headers before arrays, for which no library has to be installed.

Coordinates are mm in the bore frame. PLY and STL say "SPACE=LPS", by which 3D Slicer takes them as they are. A GLB is
in metres by its standard: its node is scaled by 0.001.
"""

import json
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.workbench.exporting.formats import Options
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Source
from endoct.workbench.exporting.wall_mesh import Mesh, wall_mesh
from endoct.workbench.running.progress import Stages

_STL_HEADER = f"SPACE=LPS {BLANK}".ljust(80).encode("ascii")
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _USHORT, _UINT = 5126, 5123, 5125


def write_ply(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the wall as binary PLY with colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, options, stages, coloured=True)
    save_ply(mesh, path, "bore frame: right-handed, z inward, x right and y down as seen looking in")
    return mesh.facts


def save_ply(mesh: Mesh, path: Path, frame: str) -> None:
    """Write a mesh as binary PLY with colours; ``frame`` says what its coordinates are, ASCII."""
    vertices = np.empty(len(mesh.points_mm), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = mesh.points_mm, mesh.colours
    faces = np.empty(len(mesh.faces), [("n", "u1"), ("of", "<i4", 3)])
    faces["n"], faces["of"] = 3, mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {BLANK}",
        "comment SPACE=LPS",
        f"comment mm; {frame}",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]
    with path.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        vertices.tofile(file)
        faces.tofile(file)
    mark(path)


def write_stl(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the wall as binary STL, without colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, options, stages, coloured=False)
    save_stl(mesh, path)
    return mesh.facts


def save_stl(mesh: Mesh, path: Path) -> None:
    """Write a mesh as binary STL, without colours."""
    corners = mesh.points_mm[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    triangles["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    triangles["corners"] = corners
    with path.open("wb") as file:
        file.write(_STL_HEADER + struct.pack("<I", len(triangles)))
        triangles.tofile(file)
    mark(path)


def write_glb(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the wall as binary glTF 2.0 with colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, options, stages, coloured=True)
    parts = [mesh.points_mm.astype("<f4"), _linear(mesh.colours), mesh.faces.astype("<u4")]
    blobs = [part.tobytes() for part in parts]  # of 12, 8 and 12 bytes an element: aligned to 4 as they are
    described = json.dumps(_gltf(mesh, [len(blob) for blob in blobs], source.title), separators=(",", ":"))
    text = described.encode("ascii")
    text += b" " * (-len(text) % 4)
    binary = sum(map(len, blobs))
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + binary))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", binary, b"BIN\0"))
        for blob in blobs:
            file.write(blob)
    mark(path)
    return mesh.facts


def _gltf(mesh: Mesh, sizes: list[int], title: str) -> dict[str, object]:
    starts = np.cumsum([0, *sizes[:-1]]).tolist()
    targets = _ARRAY_BUFFER, _ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER
    n, points = len(mesh.points_mm), mesh.points_mm
    corners = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    return {
        "asset": {
            "version": "2.0",
            "generator": "endoct",
            "extras": {"mark": BLANK, "frame": "bore: right-handed, z inward, x right and y down as seen looking in"},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": f"{title} (mm)", "scale": [0.001, 0.001, 0.001]}],
        "meshes": [
            {"name": title, "primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}]}
        ],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}}],
        "buffers": [{"byteLength": sum(sizes)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size, "target": target}
            for start, size, target in zip(starts, sizes, targets, strict=True)
        ],
        "accessors": [
            {"bufferView": 0, "componentType": _FLOAT, "count": n, "type": "VEC3", **corners},
            {"bufferView": 1, "componentType": _USHORT, "normalized": True, "count": n, "type": "VEC4"},
            {"bufferView": 2, "componentType": _UINT, "count": mesh.faces.size, "type": "SCALAR"},
        ],
    }


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return sRGB colours (n, 3) as linear light (n, 4), as glTF has it at vertices; 16 bits keep the dark ones."""
    share = np.arange(256) / 255
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    table = np.rint(light * 65535).astype("<u2")
    opaque = np.full((len(colours), 4), 65535, "<u2")
    opaque[:, :3] = table[colours]
    return opaque
