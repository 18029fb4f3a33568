"""A published set on disk: a folder for each specimen, and ``set.json`` that lists them with their digests.

A specimen's folder is laid out as ``endoct simulate`` writes it, with the panorama of each recording next to it as
``oct.zarr`` and ``endoscope.zarr``: methods that begin with a panorama all get the same one, whatever version of
endoct runs them. Two digests are kept apart. ``recorded`` is over the bytes of recordings and truth, which depend on
the seed alone. ``unrolled`` is over the samples of the panoramas, whose last bits also depend on the processor.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import plain_name, read_small, sha256_of
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.published.definition import Difficulty, Generator, Half, Size, Split
from endoct.workbench.dataset.set_files import digest_of

SET_FILE, SPECIMEN_FILE = "set.json", "specimen.json"
FORMAT = "endoct bench set 1"
SIDES = ("oct", "endoscope")
MOST_SET_BYTES = 16_000_000


class Entry(BaseModel):
    """What a set says of one specimen. ``unrolled``: by side, the digest of its panorama."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    generator: Generator
    difficulty: Difficulty
    tasks: tuple[str, ...]
    split: Split
    recorded: str
    unrolled: dict[str, str]


class SpecimenSet(BaseModel):
    """The content of ``set.json``: which set it is, what it was made with, and its specimens in order."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: str = FORMAT
    set: str
    half: Half
    size: Size
    versions: dict[str, str]
    specimens: tuple[Entry, ...]

    @property
    def digest(self) -> str:
        """Return the sha256 of the names and both digests of all specimens."""
        return digest_of_entries(self.specimens)


def digest_of_entries(entries: Sequence[Entry]) -> str:
    """Return the sha256 of the names and both digests of specimens, in order."""
    lines = "".join(f"{one.name} {one.recorded} {' '.join(one.unrolled.values())}\n" for one in entries)
    return hashlib.sha256(lines.encode()).hexdigest()


def read_set(folder: Path) -> SpecimenSet:
    """Return what a set's ``set.json`` says. Raises :class:`EndoctError` where the folder is no finished set."""
    path = folder / SET_FILE
    if not path.is_file():
        raise EndoctError(
            f"{folder} is no set of a published benchmark",
            expected=f"a folder with {SET_FILE}",
            remedy="make one with `endoct bench make`, or download it",
        )
    with refusing(f"{path} is damaged", remedy="make or download the set again"):
        read = SpecimenSet.model_validate_json(read_small(path, MOST_SET_BYTES))
        if read.format != FORMAT:
            raise ValueError(f"its format is {read.format[:40]!r}")
        for entry in read.specimens:
            plain_name(entry.name, f"a specimen of {path}")
    return read


def check_specimen(folder: Path, entry: Entry) -> None:
    """Compare a specimen with its digests. Raises :class:`EndoctError` where anything of it changed."""
    again = entry_of(folder / entry.name, entry)
    if again == entry:
        return
    part = "recordings or truth" if again.recorded != entry.recorded else "panoramas"
    raise EndoctError(
        f"the {part} of {entry.name} in {folder} are not those of the set", remedy="make or download the set again"
    )


def entry_of(folder: Path, stated: Entry) -> Entry:
    """Return ``stated`` with the digests of the specimen in ``folder``."""
    return stated.model_copy(update={"recorded": recorded_digest(folder), "unrolled": unrolled_digests(folder)})


def recorded_digest(folder: Path) -> str:
    """Return the sha256 of the lines of ``sha256sum`` over a specimen's recordings, CT, plan and truth."""
    left_out = {SPECIMEN_FILE, *(f"{side}.zarr" for side in SIDES)}
    files = {}
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if path.is_file() and relative.parts[0] not in left_out:
            files[relative.as_posix()] = (path.stat().st_size, sha256_of(path))
    return digest_of(files)


def unrolled_digests(folder: Path) -> dict[str, str]:
    """Return the digest of each panorama of a specimen, by side."""
    stores = {side: folder / f"{side}.zarr" for side in SIDES}
    return {side: panorama_digest(load_panorama(store)) for side, store in stores.items() if store.is_dir()}


def panorama_digest(panorama: Panorama) -> str:
    """Return the sha256 of a panorama's samples and of its grid; what was said in making it is left out."""
    digest = hashlib.sha256(repr(panorama.grid).encode())
    frames = [each.values for _, each in sorted(panorama.per_frame.items())]
    for array in (panorama.intensity, panorama.depth_mm, panorama.valid, panorama.weight, *frames):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
