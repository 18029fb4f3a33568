"""Panoramas of simulated specimens, each recording unrolled once for every benchmark that wants it."""

from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench import unroll

SIDES = "endoscope", "oct"


def unroll_once(specimen: Path, side: str, cache: Path) -> None:
    """Unroll a recording into the cache, or note there why that cannot be done."""
    stored = _stored(specimen, side, cache)
    note = stored.with_suffix(".txt")
    if stored.exists() or note.exists():
        return
    stored.parent.mkdir(parents=True, exist_ok=True)
    try:
        unroll(specimen / side, stored)
    except EndoctError as error:
        note.write_text(f"{error}\n", encoding="utf-8")


def unrolled(specimen: Path, side: str, cache: Path) -> Panorama:
    """Return the panorama from the cache. Raises :class:`EndoctError` with the note where it could not be made."""
    stored = _stored(specimen, side, cache)
    if (note := stored.with_suffix(".txt")).exists():
        raise EndoctError(note.read_text(encoding="utf-8").strip())
    return load_panorama(stored)


def unroll_both(specimen: Path, cache: Path) -> None:
    """Unroll both recordings of a specimen into the cache."""
    for side in SIDES:
        unroll_once(specimen, side, cache)


def _stored(specimen: Path, side: str, cache: Path) -> Path:
    return cache / specimen.parent.name / f"{specimen.name}-{side}.zarr"
