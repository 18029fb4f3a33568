"""Panoramas on disk: Zarr stores that ``xarray.open_zarr`` reads."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.doubt import Doubt, as_doubt
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.contents import check_intact
from endoct.base.files.files import plain_name
from endoct.base.files.json_values import a_list, an_object, number, texts
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import (
    Named,
    entries,
    read_array_attributes,
    read_arrays,
    read_attributes,
    write_arrays,
    write_attributes,
)
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import FORMAT, SURFACE, AxialScale, Panorama
from endoct.stitching.per_frame import PerFrame, per_frame, stored_range


def save_panorama(panorama: Panorama, path: Path) -> None:
    """Write ``panorama`` to ``path``, which must not exist (see :func:`endoct.base.files.output.new_output`).

    Dims are (z, theta), with coordinates in mm and rad. Arrays are ``intensity``, ``valid``, ``weight``, and
    ``depth_mm`` where there is depth. Where parallax was looked for there are ``parallax_depth_mm`` and
    ``parallax_error_mm`` too. The per-frame quality lies on the dim named ``frame_dim``, with what it means as
    ``units``, ``long_name`` and ``trusted_when``.
    """
    arrays = {name: Named(*variable) for name, variable in panorama.variables().items()}
    frame_z = f"{panorama.frame_dim}_z_mm"
    write_arrays(path, arrays, panorama.attributes(), coordinates=[frame_z] if frame_z in arrays else ())


def save_notes(panorama: Panorama, path: Path) -> None:
    """Write what is said of ``panorama`` anew into the store that :func:`save_panorama` wrote of it."""
    write_attributes(path, panorama.attributes())


def stored_grid(attributes: Mapping[str, Any], shape: tuple[int, ...], subject: str) -> SurfaceGrid:
    """Return the full circle that a store describes, whose images of ``shape`` end in the dims (z, theta).

    Raises :class:`EndoctError`, naming ``subject``, where it describes none, or one that no bore has.
    """
    if len(shape) < 2:
        raise EndoctError(f"{subject} has no surface", found=f"shape {shape}", expected="(z, θ)")
    n_z, n_theta = shape[-2:]
    return SurfaceGrid.full_circle(
        n_z,
        n_theta,
        z0_mm=number(attributes, "z0_mm", -1e4, 1e4, subject),
        dz_mm=number(attributes, "dz_mm", 1e-5, 1e3, subject),
        theta0_rad=number(attributes, "theta0_rad", -100, 100, subject),
        radius_mm=number(attributes, "radius_mm", 0.01, 1e3, subject),
    )


def is_panorama(path: Path) -> bool:
    """Say whether ``path`` is a store that :func:`save_panorama` wrote."""
    try:
        return bool(read_attributes(path).get("format") == FORMAT)
    except EndoctError:
        return False


def load_panorama(path: Path) -> Panorama:
    """Read what :func:`save_panorama` wrote. Raises :class:`EndoctError` where it is something else, or damaged."""
    if not is_panorama(path):
        raise EndoctError(
            f"{path} is no panorama", expected="a store written by `endoct unroll`", remedy="unroll the recording first"
        )
    check_intact(path, lambda name: not name.startswith(("volume/", "pictures/")))  # which are not read here
    with refusing(f"{path} cannot be read", remedy="unroll the recording again"):
        return _panorama(path, read_arrays(path), read_attributes(path))


def read_doubts(path: Path) -> tuple[Doubt, ...]:
    """Return what is doubted of the panorama that :func:`save_panorama` wrote, and read nothing else.

    Raises :class:`EndoctError` where it does not say.
    """
    with refusing(f"{path} cannot be read", remedy="unroll the recording again"):
        return _provenance(read_attributes(path), f"the panorama {path}")[2]


def read_provenance(path: Path) -> Mapping[str, Any]:
    """Return how the panorama at ``path`` was made, and read nothing else. Raises as :func:`read_doubts` does."""
    with refusing(f"{path} cannot be read", remedy="unroll the recording again"):
        return _provenance(read_attributes(path), f"the panorama {path}")[0]


@dataclass(frozen=True, eq=False)
class PanoramaOutline:
    """A panorama on disk without its images, as in :class:`~endoct.stitching.panorama.Panorama`."""

    grid: SurfaceGrid
    modality: str
    frame_dim: str
    has_depth: bool
    has_parallax: bool
    per_frame: Mapping[str, PerFrame]
    provenance: Mapping[str, Any]
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    handedness_known: bool = False
    travel_known: bool = False


def read_outline(path: Path) -> PanoramaOutline:
    """Read all but the images of the store that :func:`save_panorama` wrote, for readers of parts of these.

    Raises :class:`EndoctError` where it is something else, or damaged.
    """
    if not is_panorama(path):
        raise EndoctError(
            f"{path} is no panorama", expected="a store written by `endoct unroll`", remedy="unroll the recording first"
        )
    what = f"the panorama {path}"
    with refusing(f"{path} cannot be read", remedy="unroll the recording again"):
        attributes, shape = read_attributes(path), declared(path / "intensity", OWN).shape
        names = [entry.name for entry in entries(path) if entry.is_dir(follow_symlinks=False)]
        arrays = read_arrays(path, [name for name in names if name not in (*SURFACE, "volume")] + ["z"])
        if "z" not in arrays or any(values.dtype.kind == "O" for values in arrays.values()):
            raise EndoctError(f"{what} is not whole", found="no z", remedy="unroll the recording again")
        provenance, notes, doubts = _provenance(attributes, what)
        return PanoramaOutline(
            grid=stored_grid(attributes, shape, what).with_rows(arrays.pop("z")),
            modality=plain_name(attributes.get("modality"), what),
            frame_dim=plain_name(attributes.get("frame_dim"), what),
            has_depth="depth_mm" in names,
            has_parallax="parallax_depth_mm" in names,
            per_frame={
                name: _described(name, values, read_array_attributes(path, name)) for name, values in arrays.items()
            },
            provenance=provenance,
            notes=notes,
            doubts=doubts,
            handedness_known=bool(attributes.get("handedness_known")),
            travel_known=bool(attributes.get("travel_known")),
        )


def _panorama(path: Path, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> Panorama:
    what = f"the panorama {path}"
    if missing := [name for name in ("z", "intensity", "valid", "weight") if name not in arrays]:
        raise EndoctError(f"{what} is not whole", found=f"no {missing[0]}", remedy="unroll the recording again")
    if any(values.dtype.kind == "O" for values in arrays.values()):
        raise EndoctError(f"{what} cannot be used", found="texts", expected="numbers")
    provenance, notes, doubts = _provenance(attributes, what)
    panorama = Panorama(
        grid=stored_grid(attributes, arrays["intensity"].shape, what).with_rows(arrays["z"]),
        intensity=arrays["intensity"],
        depth_mm=arrays.get("depth_mm"),
        valid=arrays["valid"].astype(np.bool_),
        weight=arrays["weight"],
        modality=attributes.get("modality", ""),
        handedness_known=bool(attributes.get("handedness_known")),
        travel_known=bool(attributes.get("travel_known")),
        frame_dim=attributes.get("frame_dim", ""),
        per_frame={
            name: _described(name, values, read_array_attributes(path, name))
            for name, values in arrays.items()
            if name not in SURFACE
        },
        provenance=provenance,
        notes=notes,
        doubts=doubts,
        axial_scale=_axial_scale(attributes, what),
        parallax_depth_mm=arrays.get("parallax_depth_mm"),
        parallax_error_mm=arrays.get("parallax_error_mm"),
    )
    for name in ("intensity", "weight"):
        if not np.isfinite(getattr(panorama, name)[panorama.valid]).all():
            raise EndoctError(f"{name} of {what} cannot be used", found="NaN or infinity where it is valid")
    return panorama


def _described(name: str, values: NDArray[Any], attributes: Mapping[str, Any]) -> PerFrame:
    """Return ``values`` with what their attributes say; older stores say nothing, and the name has to do."""
    if "long_name" not in attributes:
        return per_frame({name: values}, {})[name]
    trusted_when = {"true": True, "false": False}.get(str(attributes.get("trusted_when")))
    usual = stored_range(attributes.get("usual_range"))
    return PerFrame(values, attributes.get("units", ""), attributes["long_name"], trusted_when, usual)


def _axial_scale(attributes: Mapping[str, Any], subject: str) -> AxialScale:
    """Return what the scale of z rests on; older stores do not say."""
    stored = attributes.get("axial_scale")
    if stored is None:
        return AxialScale()
    found = an_object(json.loads(stored), f"the axial scale of {subject}")
    stated = an_object(found.get("stated"), f"what the axial scale of {subject} rests on")
    return AxialScale(stated, checked=found.get("checked") is True)


def _provenance(
    attributes: Mapping[str, Any], subject: str
) -> tuple[dict[str, Any], tuple[str, ...], tuple[Doubt, ...]]:
    """Return the provenance of a store without its notes and doubts, and these."""
    stored = attributes.get("provenance")
    if not isinstance(stored, str):
        raise EndoctError(f"{subject} does not say where it comes from", expected="'provenance' in its attributes")
    found = an_object(json.loads(stored), f"the provenance of {subject}")
    notes = texts(found, "notes", f"the provenance of {subject}")
    doubts = tuple(as_doubt(one) for one in a_list(found, "doubts", f"the provenance of {subject}"))
    for key in ("parameters", "inputs", "acquisition", "versions"):
        if found.get(key) is not None:
            an_object(found[key], f"'{key}' in the provenance of {subject}")
    return {key: value for key, value in found.items() if key not in ("notes", "doubts")}, notes, doubts
