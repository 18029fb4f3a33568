"""Compare two sides step by step, and write the folder of the comparison.

The folder holds each side's panorama with pictures of its frames, the result, and a report with its figures. What one
step has made is stored and drawn while the next ones are done.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.compute.memory import give_back
from endoct.base.doubt import Doubt
from endoct.base.files.files import check_unchanged, digests, path_text, state_of
from endoct.fusion.comparison import place_sides, score_placed
from endoct.fusion.evidence.side import Side
from endoct.fusion.files.session import NAME as SESSION_NAME
from endoct.fusion.files.session import check_sides, identity_of, read_session
from endoct.fusion.files.store import COMPARISON_STORE, WALL_STORE, save_comparison, write_cells
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import Result
from endoct.fusion.sides import Comparison, Placed
from endoct.fusion.wall.bounds import bounds_of, doubts_of_bounds
from endoct.fusion.wall.cells import WallCell, join, write_wall_cells
from endoct.modalities.acquisition import validate
from endoct.stitching.panorama import TRAVEL_BY_DEFAULT, Panorama
from endoct.stitching.store import save_notes, save_panorama
from endoct.workbench.pipeline.drawn_before import calibration_by
from endoct.workbench.pipeline.hand_masks import (
    Against,
    check_truth,
    doubts_of_drawings,
    score_drawings,
    truth_on,
    write_drawings,
    write_mask,
)
from endoct.workbench.pipeline.unrolling import copy_sample_frames, save_sample_frames
from endoct.workbench.report.figures.rendered import FIGURES, Figures, begin_both, begin_sides
from endoct.workbench.report.findings import both_sides, findings_of
from endoct.workbench.running.outputs import json_text, versions
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import PendingCall, Scheduler
from endoct.workbench.settings import parse
from endoct.workbench.sides.recipes import with_recipe
from endoct.workbench.sides.recordings import Unrolled
from endoct.workbench.sides.sources import Ready, Source, inputs_of, open_sides, read_sides, source_of, unroll_sources

if TYPE_CHECKING:  # else the process that stores sides would load what reads command lines
    from endoct.workbench.requests import CompareRequest

REPORT = "endoct.workbench.page.report", FIGURES
"""A report needs these modules. They bring matplotlib, so they are loaded while there is nothing else to do."""

Pictured = Unrolled | Path | None
"""What pictures of a side's frames come from: the recording as it was unrolled, or the store of a panorama."""


@dataclass(frozen=True, eq=False)
class Given:
    """What a request states, read: both sources, parameters of the comparison, files of truth, and a session.

    ``known``: folders of comparisons of other specimens, of which masks were given as truth.
    """

    sources: tuple[Source, Source]
    parameters: CompareParameters
    truth: tuple[Path, ...]
    session: Path | None
    known: tuple[Path, ...] = ()

    @property
    def also(self) -> tuple[Path, ...]:
        """The files that are read in addition to the sources."""
        drawn = (*self.truth, *(folder / "result.json" for folder in self.known))
        return drawn if self.session is None else (*drawn, self.session)

    @property
    def paths(self) -> tuple[Path, ...]:
        """All that is read; panoramas at hand lie nowhere."""
        return *(source.path for source in self.sources if source.path is not None), *self.also


def compare_sources(request: "CompareRequest", output: Path | None, stages: Stages, scheduler: Scheduler) -> Comparison:
    """Compare two sides, and write everything `endoct compare` promises into ``output`` where one is given.

    Raises :class:`EndoctError` where a side or a setting cannot be used, an input changes while it is read, or the
    session is of other sides.
    """
    start = time.perf_counter()
    given = _given(request)
    files = {path: state_of(path) for path in given.paths}
    # whatever cannot be used is refused before the work of unrolling is done
    opened = open_sides(given.sources)
    for path in given.truth:
        check_truth(path)
    landmarks = None if given.session is None else read_session(given.session)
    by = calibration_by(given.known) if given.known else None
    ready = unroll_sources(opened, stages, scheduler, meanwhile=() if output is None else REPORT)
    a, b = read_sides(ready)
    sides = a, b
    if landmarks is not None:
        check_sides(landmarks, [identity_of(side.name, side.panorama) for side in sides], str(given.session))
    folder = None if output is None else ComparisonFolder(output, sides, scheduler)
    if folder is not None:
        folder.begin([_pictured(*of) for of in zip(given.sources, ready, strict=True)])
    with stages.stage("align, segment, score"):
        placed = place_sides(*sides, given.parameters, () if landmarks is None else landmarks.pairs)
        if folder is not None:
            folder.draw(placed)
        comparison = score_placed(placed, given.parameters)
        joined = join(placed)
        wall = None if joined is None else joined.wall.as_panorama(placed)
        drawn = {path_text(path): truth_on(path, sides[0].panorama) for path in given.truth}
        against = score_drawings(comparison, drawn, given.parameters.tolerance_mm)
    give_back()
    unpictured: Mapping[str, tuple[str, ...]] = {}
    if folder is not None:
        with stages.stage("write"):
            unpictured = folder.write(comparison, against)
            if landmarks is not None and landmarks.notes:
                (folder.path / SESSION_NAME).write_bytes(landmarks.to_bytes())  # the page goes on with its notes
            if joined is not None and wall is not None:
                folder.write_wall(wall, joined.cells)
    notes = {
        side.name: (
            *side.panorama.notes,
            *(notes_on_travel(side, sides) if comparison.alignment else ()),
            *unpictured.get(side.name, ()),
        )
        for side in sides
    }
    bounds = None if joined is None else bounds_of(placed, joined, comparison.result, by)
    of_wall = () if joined is None else joined.doubts
    found = in_order((*comparison.result.doubts, *of_wall), a.name)
    joint = {
        "wall": None if joined is None else joined.summary,
        "bounds": bounds,
        "asked": request.asked(),
        "doubts": (*doubts_of_bounds(bounds, asked=by is not None), *found),
    }
    comparison = replace(comparison, result=comparison.result.model_copy(update=joint), wall=wall)
    del joined, placed  # a report needs much memory itself
    comparison = replace(comparison, result=_completed(comparison, against, sides, given, notes, stages, start))
    if folder is not None:
        folder.write_result(comparison)
        with stages.stage("report"):
            folder.write_report(comparison)
    for path, state in files.items():
        check_unchanged(path, state)
    return comparison


def _given(request: "CompareRequest") -> Given:
    """Return what a request states. Raises :class:`EndoctError` for a setting that cannot be used."""
    settings = with_recipe(request.recipe, "compare", parse(request.settings))
    parameters = validate(CompareParameters, settings, "the settings of the comparison")
    sources = (
        source_of(request.a, request.modality_a, request.settings_a, request.recipe),
        source_of(request.b, request.modality_b, request.settings_b, request.recipe),
    )
    session = None if request.session is None else Path(request.session)
    truth, known = (tuple(map(Path, paths)) for paths in (request.truth, request.known))
    return Given(sources, parameters, truth, session, known)


def _completed(
    comparison: Comparison,
    against: Against,
    sides: tuple[Side, Side],
    given: Given,
    notes: Mapping[str, tuple[str, ...]],
    stages: Stages,
    start: float,
) -> Result:
    """Return the result with ``notes`` by side, what it states of its inputs, and of the seconds since ``start``."""
    of_a, of_b = (inputs_of(source, side) for source, side in zip(given.sources, sides, strict=True))
    result = comparison.result
    doubts = (*result.doubts, *doubts_of_drawings(sides, against))
    if comparison.alignment is not None and (doubt := _doubt_of_inputs(of_a, of_b)):
        doubts = (doubt, *doubts)
    result = result.model_copy(update={"doubts": doubts})
    return result.completed(
        truth=against.truth,
        raters=against.raters,
        notes=notes,
        versions=versions(),
        inputs={name: digest for each in (of_a, of_b, *map(digests, given.also)) for name, digest in each.items()},
        parameters={
            "compare": given.parameters.model_dump(mode="json"),
            **{side.name: side.panorama.provenance.get("parameters", {}) for side in sides},
        },
        seconds={
            **{title: round(seconds, 3) for title, seconds in stages.seconds.items()},
            "in all, before the report": round(time.perf_counter() - start, 3),
        },
    )


def in_order(doubts: Sequence[Doubt], a: str) -> tuple[Doubt, ...]:
    """Return ``doubts`` of the comparison before those of the side ``a``, and these before those of the other side."""
    return tuple(sorted(doubts, key=lambda doubt: {None: 0, a: 1}.get(doubt.side, 2)))


def notes_on_travel(side: Side, sides: tuple[Side, Side]) -> Iterator[str]:
    """Yield that the direction of z rests on a default of ``side``: no recording of both ``sides`` states its own."""
    recorded = [each.panorama for each in sides if each.drawing is None]
    stated = any(each.travel_known and TRAVEL_BY_DEFAULT not in each.provenance for each in recorded)
    if not stated and (taken := side.panorama.provenance.get(TRAVEL_BY_DEFAULT)):
        yield (
            f"Which way z runs along the bore rests on a default: nothing states its travel, and '{taken}' was assumed."
            " If it moved the other way, the bore is reversed. State travel in its sidecar."
        )


def _doubt_of_inputs(a: Mapping[str, str], b: Mapping[str, str]) -> Doubt | None:
    """Return a doubt where two sides were made from the same files, sidecars left out.

    ``a`` and ``b`` are as :func:`~endoct.base.files.files.digests` has them.
    """
    of_a, of_b = ({digest for name, digest in each.items() if not name.endswith(".toml")} for each in (a, b))
    if not of_a or of_a != of_b:
        return None
    what = (
        "Both sides were made from the same files, so this is a recording compared with itself: how well they agree "
        "says nothing of two recordings."
    )
    return Doubt("compared-with-itself", what)


def _pictured(source: Source, ready: Ready) -> Pictured:
    if isinstance(ready, Unrolled):
        return ready
    return source.path if isinstance(ready, Panorama) else None


@dataclass(frozen=True, eq=False)
class ComparisonFolder:
    """The folder of a comparison while it is written; ``stored`` and ``figures`` are the tasks begun so far."""

    path: Path
    sides: tuple[Side, Side]
    scheduler: Scheduler
    stored: list[PendingCall[tuple[str, ...]]] = field(default_factory=list)
    figures: list[Figures] = field(default_factory=list)

    def begin(self, pictured: Sequence[Pictured]) -> None:
        """Make the folder, and begin to store and draw each side, which does not depend on the alignment."""
        self.path.mkdir()
        for side, of in zip(self.sides, pictured, strict=True):
            self.stored.append(self.scheduler.begin(store_side, self.path, side.name, side.panorama, of))
        self.figures.append(begin_sides(self.path, [side.name for side in self.sides], self.scheduler))

    def draw(self, placed: Placed) -> None:
        """Begin the figures of both sides as they were ``placed``, while scores are computed."""
        panoramas = [side.panorama for side in self.sides]
        both = both_sides(placed.grid, placed.sides, panoramas, {}, aligned=placed.outcome.alignment is not None)
        self.figures.extend(begin_both(both, self.scheduler, with_sides=False))

    def write(self, comparison: Comparison, against: Against) -> Mapping[str, tuple[str, ...]]:
        """Write the comparison, its cells, and the masks it was held ``against``.

        Return by side notes on frames of which there is no picture.
        """
        save_comparison(comparison, self.path / COMPARISON_STORE)
        write_cells(comparison.cells, self.path / "cells.csv")
        if against.consensus is not None:
            write_mask(against.consensus, comparison.grid, self.path / "consensus.png")
        write_drawings(against, comparison.grid, self.path)
        return {side.name: task.result() for side, task in zip(self.sides, self.stored, strict=True)}

    def write_wall(self, wall: Panorama, cells: Sequence[WallCell]) -> None:
        """Write the one wall of both sides, and its cells."""
        save_panorama(wall, self.path / WALL_STORE)
        write_wall_cells(cells, self.path / "wall-cells.csv")

    def write_result(self, comparison: Comparison) -> None:
        """Write ``result.json``."""
        text = json_text(comparison.result.to_json())
        (self.path / "result.json").write_text(text + "\n", encoding="utf-8")

    def write_report(self, comparison: Comparison) -> None:
        """Write the page and its figures, once everything else is in the folder."""
        from endoct.workbench.page.report import write_comparison_report  # was loaded while sides were unrolled

        findings = findings_of(comparison, [side.panorama for side in self.sides], {})
        write_comparison_report(self.path, findings, self.figures)


def store_side(folder: Path, name: str, panorama: Panorama, pictured: Pictured) -> tuple[str, ...]:
    """Write the panorama of a side and pictures of its frames into the ``folder`` of a comparison.

    Return notes on frames of which there is no picture.
    """
    store = folder / "panoramas" / f"{name}.zarr"
    save_panorama(panorama, store)
    unpictured: tuple[str, ...] = ()
    if isinstance(pictured, Unrolled):
        unpictured = save_sample_frames(pictured, folder, name)
    elif pictured is not None:
        copy_sample_frames(pictured, folder, name)
    if unpictured:
        save_notes(replace(panorama, notes=(*panorama.notes, *unpictured)), store)
    return unpictured
