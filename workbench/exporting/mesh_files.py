"""The wall as triangles, and meshes as PLY, STL and GLB.

The wall lies at r = bore radius + relief, mm in the bore frame. It is closed around the circle and open where nothing
was observed. Triangles face the axis, as the bone does that they bound.

The three formats are short headers before arrays, for which no library has to be installed. PLY and STL say
"SPACE=LPS", by which 3D Slicer takes coordinates as they are. A GLB is in metres by its standard: its node is scaled by
0.001.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.fusion.geometry.placement import column_weights, resample
from endoct.workbench.exporting.formats import VERTEX_MM
from endoct.workbench.exporting.image_layers import ImageLayer, blocks, contrast_of
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Advance, Stages

RELIEF = "relief"
NOT_OBSERVED = (185, 208, 242)
"""Colour of wall that the colouring side did not observe, as in the figures."""
_BYTES_A_VERTEX = 120
_LEAST_AROUND = 8
_STL_HEADER = f"SPACE=LPS {BLANK}".ljust(80).encode("ascii")
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _USHORT, _UINT = 5126, 5123, 5125


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles and what is known of them.

    ``points_mm``: float32 (n, 3), x y z of the bore frame; ``colours``: uint8 (n, 3), sRGB; ``faces``: int32 (m, 3),
    by whose order the normals point toward the axis.
    """

    points_mm: NDArray[np.float32]
    colours: NDArray[np.uint8]
    faces: NDArray[np.int32]
    facts: dict[str, object]


def wall_mesh(source: Exportable, request: ExportRequest, stages: Stages, *, coloured: bool) -> Mesh:
    """Return the wall of a source.

    ``request.side`` gives the relief, else the first side that has one; without any relief the wall is the nominal
    cylinder. ``request.color`` is a side, for its brightness, or "relief". Raises :class:`EndoctError` where a name is
    none of a side that has it, or there would be too many vertices.
    """
    relief, seen = _relief_layer(source, request.side)
    colour = _colour_layer(source, seen.side, request.color) if coloured else None
    vertex_mm = VERTEX_MM if request.vertex_mm is None else request.vertex_mm
    if not 1e-4 <= vertex_mm <= 100:
        raise EndoctError("vertices cannot have that distance", found=f"{vertex_mm:g} mm", expected="0.0001 to 100 mm")
    places = _Vertices(source, vertex_mm)
    layers = list(dict.fromkeys([relief or seen, *([colour] if colour else [])]))
    with stages.stage("wall") as advance:
        images = {id(one): places.sampled(one, advance, k, len(layers)) for k, one in enumerate(layers)}
        known = np.isfinite(images[id(relief or seen)])
        radius_mm = source.grid.radius_mm + (images[id(relief)] if relief else np.zeros(known.shape, np.float32))
        colours = _colours(images[id(colour)], colour) if colour else np.zeros((*known.shape, 3), np.uint8)
        x_mm, y_mm = radius_mm * np.cos(places.theta_rad), radius_mm * np.sin(places.theta_rad)
        points = np.stack([x_mm, y_mm, np.broadcast_to(places.z_mm[:, np.newaxis], known.shape)], axis=-1)
        faces = _faces(known)
        used = np.zeros(known.size, np.bool_)
        used[faces] = True
        new = np.cumsum(used) - 1
    if not used.any():
        raise EndoctError(f"nothing of the wall of {source.path} was observed", remedy="choose another side")
    return Mesh(
        points.reshape(-1, 3)[used].astype(np.float32),
        colours.reshape(-1, 3)[used],
        new[faces].astype(np.int32),
        {
            "vertices": int(used.sum()),
            "faces": len(faces),
            "step_mm": [places.step_z_mm, places.step_theta_mm],
            "relief": relief.name if relief else None,
            "color": colour.name if colour else None,
        },
    )


class _Vertices:
    """Where the vertices lie: means of samples over ``vertex_mm``, or the samples themselves where these lie wider."""

    def __init__(self, source: Exportable, vertex_mm: float) -> None:
        grid = source.grid
        self._n_z = grid.n_z
        self._together = max(1, int(vertex_mm / grid.dz_mm + 1e-6))
        n_theta = min(grid.n_theta, max(_LEAST_AROUND, int(np.ceil(2 * np.pi * grid.radius_mm / vertex_mm))))
        share = grid.n_theta / n_theta
        columns: Coordinates = (np.arange(n_theta, dtype=np.float64) + 0.5) * share - 0.5
        self._columns = column_weights(grid.n_theta, columns, share)
        self._shape = -(-grid.n_z // self._together), n_theta
        check_array_size(
            self._shape, _BYTES_A_VERTEX, "a wall of that many vertices, for which choose another vertex_mm,"
        )
        self.theta_rad = grid.theta0_rad + grid.dtheta_rad * columns
        starts = np.arange(0, grid.n_z, self._together)
        stops = np.minimum(starts + self._together, grid.n_z)
        self.z_mm: Coordinates = (grid.z_mm[starts] + grid.z_mm[stops - 1]) / 2
        self.step_z_mm, self.step_theta_mm = self._together * grid.dz_mm, share * grid.dtheta_mm

    def sampled(self, layer: ImageLayer, advance: Advance, k: int, n: int) -> Image:
        """Return a layer at the vertices, NaN where less than half was observed. It is read in blocks of rows."""
        image = np.empty(self._shape, np.float32)
        for first, last in blocks(0, self._shape[0], max(1, 128 // self._together)):
            fine = layer.read(first * self._together, min(last * self._together, self._n_z))
            image[first:last] = self._mean(fine)
            advance((k + last / self._shape[0]) / n)
        return image

    def _mean(self, fine: Image) -> Image:
        row = np.arange(fine.shape[0]) // self._together
        weights = (1 / np.bincount(row))[row].astype(np.float32)
        rows = sparse.csr_array((weights, (row, np.arange(row.size))))
        values, observed = resample(fine, np.isfinite(fine), rows, self._columns)
        return np.where(observed, values, np.float32(np.nan))


def _relief_layer(source: Exportable, side: str | None) -> tuple[ImageLayer | None, ImageLayer]:
    """Return (the layer whose relief the wall has, None for none; a layer of the same side that says what is there)."""
    if side is not None and side not in source.sides:
        raise EndoctError(f"{source.path} has no such side", found=side, expected=" or ".join(source.sides))
    sides = source.sides if side is None else (side,)
    reliefs = [layer for layer in (source.layer(side, "relief") for side in sides) if layer]
    if reliefs:
        return reliefs[0], reliefs[0]
    return None, next(layer for layer in source.layers if layer.side == sides[0])


def _colour_layer(source: Exportable, shape_side: str, color: str | None) -> ImageLayer:
    """Return the layer that colours the wall: unless chosen the brightness of the side that it has its shape from."""
    if color == RELIEF or (color is None and source.layer(shape_side, "intensity") is None):
        layer = source.layer(shape_side, RELIEF)
        if layer is None:
            raise EndoctError(f"{shape_side} of {source.path} has no relief", remedy="choose another color")
        return layer
    side = shape_side if color is None else color
    layer = source.layer(side, "intensity")
    if layer is None:
        having = [layer.side for layer in source.layers if layer.quantity == "intensity"]
        having += [RELIEF] * any(layer.quantity == RELIEF for layer in source.layers)
        raise EndoctError(
            f"the wall of {source.path} cannot be coloured so", found=side, expected=" or ".join(dict.fromkeys(having))
        )
    if source.kind == "comparison" and source.alignment is None and side != shape_side:
        raise EndoctError(
            f"{shape_side} cannot be coloured by {side}",
            found="a comparison whose sides are not aligned",
            remedy=f"leave color out, or choose side='{side}' too",
        )
    return layer


def _colours(image: Image, layer: ImageLayer) -> NDArray[np.uint8]:
    """Return sRGB, uint8 (…, 3): brightness in grey, relief in a perceptually even map, pale blue where unknown."""
    low, high = contrast_of(layer)
    known = np.isfinite(image)
    share = np.clip((np.where(known, image, low) - low) / (high - low), 0, 1)
    if layer.quantity == RELIEF:
        from matplotlib import colormaps

        colours = (colormaps["viridis"](share)[..., :3] * 255).round().astype(np.uint8)
    else:
        colours = np.repeat((share * 255).round().astype(np.uint8)[..., np.newaxis], 3, axis=-1)
    colours[~known] = NOT_OBSERVED
    return np.asarray(colours)


def _faces(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return triangles between neighbours that are all known, the last column joined to the first, facing the axis."""
    corners = quads(*known.shape)
    faces = np.concatenate([corners[:, (0, 2, 1)], corners[:, (1, 2, 3)]])
    return np.asarray(faces[known.ravel()[faces].all(axis=1)])


def quads(n_z: int, n_theta: int) -> NDArray[np.int64]:
    """Return the corners between neighbours on rows of a cylinder, (n, 4): one, the next around, and both a row on."""
    here = np.arange(n_z * n_theta).reshape(n_z, n_theta)
    beside = np.roll(here, -1, axis=1)
    return np.stack([here[:-1], beside[:-1], here[1:], beside[1:]], axis=-1).reshape(-1, 4)


def write_ply(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the wall as binary PLY with colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, request, stages, coloured=True)
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


def write_stl(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the wall as binary STL, without colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, request, stages, coloured=False)
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


def write_glb(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the wall as binary glTF 2.0 with colours. Returns what was written; raises as :func:`wall_mesh` does."""
    mesh = wall_mesh(source, request, stages, coloured=True)
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
