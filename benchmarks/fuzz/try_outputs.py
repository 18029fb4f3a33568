"""Readers of what endoct wrote: panoramas, comparisons, data sets, results of the bench, weights, sessions."""

import json
import tempfile
from contextlib import suppress
from pathlib import Path

from benchmarks.fuzz.try_inputs import check_line


def try_panorama(path: Path) -> None:
    from endoct.stitching.store import is_panorama, load_panorama

    is_panorama(path)
    load_panorama(path)


def try_comparison(path: Path) -> None:
    from endoct.fusion.files.store import load_comparison

    load_comparison(path)


def try_pictures(path: Path) -> None:
    from endoct.workbench.report.pictures import load_pictures

    load_pictures(path)


def try_report(path: Path) -> None:
    from endoct.workbench.page.opening import open_shown
    from endoct.workbench.page.report import frozen_data, frozen_page
    from endoct.workbench.report.findings import read_findings
    from endoct.workbench.report.sections import report_sections

    shown = open_shown(path)
    frozen_page(shown, report_sections(read_findings(path), []), frozen_data(shown))


def try_figures(path: Path) -> None:
    from endoct.workbench.report.figures.rendered import begin_both, drawn_of
    from endoct.workbench.report.findings import read_findings
    from endoct.workbench.report.sections import report_sections
    from endoct.workbench.running.scheduler import ALONE

    findings = read_findings(path)
    report_sections(findings, drawn_of(findings, begin_both(findings, ALONE, with_sides=True)))


def try_exports(path: Path) -> None:
    from endoct.base.errors import EndoctError
    from endoct.workbench.exporting.export import export

    names = "a.ome.zarr", "a.ome.tif", "a.ply", "a.glb", "a.nrrd", "a.tfm", "a.csv"
    refused = []
    for name in names:  # not every kind has all of them
        with tempfile.TemporaryDirectory() as scratch:
            try:
                export(path, Path(scratch) / name, progress=False)
            except EndoctError as error:
                check_line(str(error))
                refused.append(error)
                if any(Path(scratch).iterdir()):
                    raise RuntimeError(f"{name} was refused and left something: {error}") from error
    if len(refused) == len(names):
        raise refused[0]


def try_eye(path: Path) -> None:
    from endoct.fusion.segmentation.learned.looking import eye_of, weights_for

    if (weights := weights_for("endoscope", str(path))) is not None:
        eye_of(weights)


def try_submissions(path: Path) -> None:
    from endoct.workbench.bench.published import submission
    from endoct.workbench.bench.published.standings import read_boards

    for file in path.glob("*.json"):  # whoever forges one seals it
        with suppress(ValueError, TypeError, AttributeError, OSError, RecursionError):
            content = json.loads(file.read_bytes())
            content.pop("digest", None)
            file.write_text(json.dumps(content | {"digest": submission._digest(content)}))
    for board in read_boards(path):
        board.losses()
        for generator in board.generators:
            board.standings(generator)


def try_describe(path: Path) -> None:
    from endoct.workbench.pipeline.information import describe

    describe(path)


def try_summary(path: Path) -> None:
    from endoct.base.errors import EndoctError
    from endoct.workbench.pipeline.summarising import summarise, write_summary

    first, second = (sorted((path / of).glob("*/*")) for of in "ab")
    refused = None
    for against, repeats in (([], False), (second, False), ([], True)):
        try:
            tables = summarise(first, against, repeats=repeats)
            with tempfile.TemporaryDirectory() as scratch:
                write_summary(tables, Path(scratch) / "out")
        except EndoctError as error:
            refused = error
    if refused is not None:
        raise refused


def try_truth(path: Path) -> None:
    from endoct.stitching.store import load_panorama
    from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

    truth, panorama = load_truth(path), load_panorama(path / "panorama.zarr")
    true_cells(truth, true_pose(panorama, truth), panorama)


def try_specimens(path: Path) -> None:
    from endoct.workbench.dataset.loader import Specimens

    specimens = Specimens(path)
    for index in range(len(specimens)):
        specimens[index]


def try_records(path: Path) -> None:
    from benchmarks.fuzz.seed_sets import plan_of
    from endoct.workbench.dataset.identity import check_identity, check_worker
    from endoct.workbench.dataset.plan import units
    from endoct.workbench.dataset.set_files import finished, read_record, sound_record

    plan = plan_of(path)
    for unit in units(plan):
        read_record(path, unit)
        sound_record(path, unit)
        finished(path, plan, unit)
    check_worker(path)
    check_identity(path, plan)


def try_output(path: Path) -> None:
    """Verify an output, and have it replaced: it may only go where it is as it was written, or lacks something."""
    from benchmarks.fuzz.seed_outputs import KIND
    from endoct.base.errors import EndoctError
    from endoct.base.files.output import new_output
    from endoct.workbench.verifying import verify

    refused, verdicts = None, []
    try:
        verdicts = verify(path)
    except EndoctError as error:
        refused = error
    own = next((verdict for verdict in verdicts if verdict.path == path), None)
    try:
        with new_output(path, KIND, overwrite=True) as made:
            made.mkdir()
    except EndoctError as error:
        check_line(str(error))
        if own is not None and own.intact and own.kind == KIND:
            raise
    else:
        if own is not None and (own.kind != KIND or own.differences.altered or own.differences.added):
            raise AssertionError(f"replaced, though not as it was written: {own}")
    if refused is not None:
        raise refused


def try_unfinished(path: Path) -> None:
    from benchmarks.fuzz.seed_outputs import PLAN
    from endoct.workbench.bench.checkpoint import open_checkpoint

    open_checkpoint(path / "results", PLAN, overwrite=False).read()


def try_session(path: Path) -> None:
    """Read a session file, and make its bytes again."""
    from endoct.fusion.files.session import check_sides, read_session

    session = read_session(path)
    check_sides(session, session.sides, str(path))
    session.to_bytes()


def try_drawn(path: Path) -> None:
    """Read the masks that `endoct compare` keeps."""
    from endoct.base.zarr.window import ChunkCache, stored_image
    from endoct.fusion.files.masks import DRAWN_STORE, read_drawn

    if (drawn := read_drawn(path)) is None:
        return
    for k in range(len(drawn.drawn_by)):
        for part in ("mask", "valid"):
            image = stored_image(path / DRAWN_STORE / part, ChunkCache(), (k,))
            image.read(slice(0, image.shape[0]), slice(0, image.shape[1]))
