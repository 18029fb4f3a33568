"""Panoramas of simulated specimens, each recording unrolled once for every benchmark that wants it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench import unroll

SIDES = "endoscope", "oct"


def unroll_once(specimen: Path, cache: Path, *, side: str, variant: str = "", **settings: Any) -> None:
    """Unroll a recording into the cache, or note there why that cannot be done.

    ``variant`` names what ``settings`` make of it.
    """
    stored = _stored(specimen, side, cache, variant)
    note = stored.with_suffix(".txt")
    if stored.exists() or note.exists():
        return
    stored.parent.mkdir(parents=True, exist_ok=True)
    try:
        unroll(specimen / side, stored, settings=settings)
    except EndoctError as error:
        note.write_text(f"{error}\n", encoding="utf-8")


def unrolled(specimen: Path, side: str, cache: Path, variant: str = "") -> Panorama:
    """Return the panorama from the cache. Raises :class:`EndoctError` with the note where it could not be made."""
    stored = _stored(specimen, side, cache, variant)
    if (note := stored.with_suffix(".txt")).exists():
        raise EndoctError(note.read_text(encoding="utf-8").strip())
    return load_panorama(stored)


def both_unrolled(specimen: Path, cache: Path, variant: str = "", settings: Mapping[str, Any] | None = None) -> None:
    """Unroll both recordings of a specimen into the cache; the OCT in a ``variant`` with ``settings``."""
    unroll_once(specimen, cache, side="endoscope")
    unroll_once(specimen, cache, side="oct", variant=variant, **(settings or {}))


def _stored(specimen: Path, side: str, cache: Path, variant: str) -> Path:
    return cache / specimen.parent.name / f"{specimen.name}-{side}{variant and '-'}{variant}.zarr"
