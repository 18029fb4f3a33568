"""What the two sides of a comparison come from: recordings, panoramas, and masks drawn by hand.

A side's course: a :class:`Source` is opened, which refuses what cannot be used, and a recording is unrolled. Then it is
a :class:`~endoct.fusion.evidence.side.Side`, with the evidence for its cells. At last it is a
:class:`~endoct.fusion.sides.PlacedSide`, on the grid that both share.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.files import digests
from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.fusion.files.masks import read_mask, stored_mask
from endoct.fusion.geometry.placement import check_same_bore
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.kinds import MASK, is_comparison, kind_at
from endoct.workbench.running.outputs import PANORAMA
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import Scheduler, one_blas_thread
from endoct.workbench.settings import parse
from endoct.workbench.sides.recipes import check_made_by
from endoct.workbench.sides.recordings import Recording, Unrolled, open_recording, unroll_recording

if TYPE_CHECKING:
    from endoct.workbench.requests import RecipeName, Recorded, Settings

MOST_SIDES = 2
Opened = Recording | Panorama | DrawnMask | Path
"""A source that is known to be usable; a path is that of a mask, which may need the panorama that it was drawn on."""
Ready = Unrolled | Panorama | DrawnMask | Path
"""The same with recordings unrolled."""


@dataclass(frozen=True)
class Source:
    """Where one side of a comparison comes from: a path, or a panorama at hand.

    ``settings`` win over those of the ``recipe``.
    """

    given: Path | Panorama
    modality: str | None
    settings: Mapping[str, object]
    recipe: "RecipeName | None" = None

    @property
    def path(self) -> Path | None:
        """Where it lies; None for a panorama at hand."""
        return self.given if isinstance(self.given, Path) else None


def source_of(
    given: "Recorded", modality: str | None, settings: "Settings", recipe: "RecipeName | None" = None
) -> Source:
    """Return the source that a request states. Raises :class:`EndoctError` for settings that cannot be read."""
    return Source(given if isinstance(given, Panorama) else Path(given), modality, parse(settings), recipe)


def open_sides(sources: Sequence[Source]) -> tuple[Opened, ...]:
    """Open one source, or two of one bore.

    Raises :class:`EndoctError` where one cannot be used, both are one recording, or their bores differ in diameter.
    """
    if len(sources) == 1:
        return (open_source(sources[0]),)
    _check_two(*sources)
    with _arguments_of("a"):
        a = open_source(sources[0])
    with _arguments_of("b"):
        b = open_source(sources[1])
    radii_mm = [radius for radius in map(_radius_mm, (a, b)) if radius is not None]
    if len(radii_mm) == 2:
        check_same_bore(*radii_mm)
    return a, b


def open_recorded(sources: Sequence[Source]) -> tuple[Opened, ...]:
    """Open one source or two, as :func:`open_sides`. Raises :class:`EndoctError` also for others, and for a mask."""
    if not 1 <= len(sources) <= MOST_SIDES:
        raise EndoctError(
            "a pose is found by one side or two",
            found=f"{len(sources)} sides",
            remedy="" if sources else "name a recording, or ask before there is one with --plan-only",
        )
    opened = open_sides(sources)
    for source, one in zip(sources, opened, strict=True):
        if isinstance(one, DrawnMask | Path):
            expected = "a recording, a panorama, or one side of a comparison as DIR:SIDE"
            raise EndoctError(f"{source.path} is a mask drawn by hand", expected=expected)
    return opened


def side_of_comparison(source: Source) -> Source:
    """Return the panorama that ``DIR:SIDE`` names in the comparison ``DIR``; any other source as it is.

    Raises :class:`EndoctError` where the comparison has no such side, or only ``DIR`` is named.
    """
    if source.path is None:
        return source
    if is_comparison(source.path):
        names = ", ".join(f"{source.path}:{name}" for name in _names(source.path))
        raise EndoctError(f"{source.path} is a comparison of two sides", expected=names, remedy="name one of them")
    folder, _, name = str(source.path).rpartition(":")
    if source.path.exists() or not folder or not is_comparison(Path(folder)):
        return source
    if name not in (names_there := _names(Path(folder))):
        expected = ", ".join(names_there) or "panoramas in it"
        raise EndoctError(f"the comparison {folder} has no such side", found=name, expected=expected)
    return replace(source, given=Path(folder) / "panoramas" / f"{name}.zarr")


def _names(folder: Path) -> list[str]:
    return sorted(path.stem for path in (folder / "panoramas").glob("*.zarr"))


def _check_two(a: Source, b: Source) -> None:
    """Raise :class:`EndoctError` where both sides are the same files, read in the same way."""
    if a.path is None or b.path is None or (a.modality, a.settings) != (b.modality, b.settings):
        return
    with suppress(OSError):
        if a.path.samefile(b.path):
            raise EndoctError(
                f"{a.path} would be compared with itself",
                expected="two recordings of one bore",
                remedy="name the other recording, or settings in which the two sides differ",
            )


def unroll_sources(
    opened: Sequence[Opened], stages: Stages, scheduler: Scheduler, meanwhile: Sequence[str] = ()
) -> tuple[Ready, ...]:
    """Return one source or both with recordings unrolled; two at the same time, where there is a second process.

    Modules named in ``meanwhile`` are loaded where this process would wait for the other. Raises what
    :func:`unroll_recording` raises, of A where both fail.
    """
    if len(opened) == 2 and isinstance(opened[0], Recording) and isinstance(opened[1], Recording):
        with scheduler.begun_in_stages(stages, _unroll_b, opened[1]) as unrolled_b:
            return unroll_recording(opened[0], stages, "A"), unrolled_b.result(meanwhile)
    labels = "AB" if len(opened) == 2 else ("",)
    pairs = zip(opened, labels, strict=True)
    return tuple(unroll_recording(one, stages, label) if isinstance(one, Recording) else one for one, label in pairs)


def _unroll_b(recording: Recording, stages: Stages) -> Unrolled:
    recording.manifest.load()  # first, so that the libraries it brings keep to one thread as well
    with one_blas_thread():
        return unroll_recording(recording, stages, "B")


def read_sides(made: Sequence[Ready]) -> tuple[Side, ...]:
    """Return one side or both. Raises :class:`EndoctError` where a mask cannot be read, or nothing says its place."""
    if len(made) == 2:
        a, b = made
        return two_sides(_read(a, b), _read(b, a))
    if (panorama := _panorama(made[0])) is None:
        raise EndoctError("nothing says where a mask by itself lies")
    return (Side(panorama.modality, panorama),)


@contextmanager
def _arguments_of(side: str) -> Iterator[None]:
    """Have remedies that name arguments for one recording name those of a side: ``settings_a`` for ``settings``."""
    try:
        yield
    except EndoctError as error:
        remedy = error.remedy.replace("settings={", f"settings_{side}={{").replace("modality='", f"modality_{side}='")
        raise type(error)(error.what, found=error.found, expected=error.expected, remedy=remedy) from error


def open_source(source: Source) -> Opened:
    """Open one source. Raises :class:`EndoctError` where it cannot be used."""
    kind = PANORAMA if isinstance(source.given, Panorama) else kind_at(source.given)
    given = [f"modality {source.modality}"] * (source.modality is not None) + list(source.settings)
    if kind in (PANORAMA, MASK) and given:
        raise EndoctError(
            f"{source.path or 'a side'} is a {kind}, which is compared as it is",
            found=f"set for that side: {', '.join(given)}",
            expected="settings for recordings only",
            remedy="leave them out, or compare the recording itself",
        )
    if isinstance(source.given, Panorama) or kind == PANORAMA:
        panorama = source.given if isinstance(source.given, Panorama) else load_panorama(source.given)
        drawn = stored_mask(panorama)
        if drawn is None:
            check_made_by(source.recipe, panorama)
        return drawn or panorama
    if kind == MASK:
        return source.given
    return open_recording(source.given, modality=source.modality, recipe=source.recipe, settings=source.settings)


def _radius_mm(opened: Opened) -> float | None:
    """Return the radius of the bore that a source states; None for a mask that is not read yet."""
    if isinstance(opened, Path):
        return None
    return opened.stream.acquisition.bore_diameter_mm / 2 if isinstance(opened, Recording) else opened.grid.radius_mm


def _read(made: Ready, other: Ready) -> Panorama | DrawnMask:
    """Return a side once it is read; a mask may be drawn on the ``other``."""
    if isinstance(made, Path):
        return read_mask(made, like=_panorama(other))
    return made.panorama if isinstance(made, Unrolled) else made


def _panorama(made: Ready) -> Panorama | None:
    if isinstance(made, Path):
        return None
    return made if isinstance(made, Panorama) else made.panorama


def inputs_of(source: Source, side: Side) -> Mapping[str, str]:
    """Return the digests of the files that a side was made from, by path."""
    made_from: Mapping[str, str] | None = side.panorama.provenance.get("inputs")
    return made_from or (digests(source.path) if source.path else {})
