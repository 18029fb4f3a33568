"""Everything of endoct that reads what somebody gives it, each as a function of a path, with its sound files."""

import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.fuzz.hand_files import try_drawn, try_session
from benchmarks.fuzz.trees import Seed


@dataclass(frozen=True)
class Reader:
    """``read`` is called with the path of a case; of many files ``share`` are its, relative to the others'.

    ``seconds``: what it may take at most; ``needs``: a module without which endoct is too old to have it.
    """

    name: str
    read: Callable[[Path], object]
    seeds: Callable[[], Iterable[Seed]]
    share: float
    seconds: float = 5.0
    needs: str = ""


def _frames(path: Path) -> None:
    from endoct.modalities.reading.recording import open_stack

    stack = open_stack(path)
    for index in range(len(stack)):
        stack[index]


def _stated(path: Path) -> None:
    from endoct.modalities.reading.recording import stated_by

    stated_by(path)
    _frames(path)


def _recording(path: Path) -> None:
    from endoct.modalities.registry import manifests
    from endoct.workbench.pipeline.information import describe

    for manifest in manifests().values():
        manifest.load().sniff(path)
    describe(path)
    _opened(path)


def _opened(path: Path) -> None:
    from endoct.modalities.recognition import open_recording

    _, stream = open_recording(path)
    for index in range(len(stream)):
        stream[index]


def _sidecar(path: Path) -> None:
    from endoct.base.errors import EndoctError
    from endoct.modalities.acquisition import read_keys, validate
    from endoct.modalities.recognition import recognise
    from endoct.modalities.registry import manifests
    from endoct.workbench.pipeline.sidecar_template import write_sidecar_template

    keys = read_keys(path)
    try:
        write_sidecar_template(recognise(path), overwrite=True)
    except EndoctError as error:  # what it says of its output is not what is asked here
        check_line(str(error))
    found = manifests()
    name = keys.get("modality")
    for manifest in [found[name]] if isinstance(name, str) and name in found else found.values():
        validate(manifest.acquisition, keys, "the sidecar")


def _settings(path: Path) -> None:
    from endoct.base.errors import EndoctError
    from endoct.fusion.comparison import CompareParameters
    from endoct.modalities.acquisition import validate
    from endoct.modalities.registry import manifests
    from endoct.workbench.settings import parse, parse_vary, split

    if not path.is_file():  # no damage to settings, which come from a command line
        return
    lines = tuple(path.read_bytes().decode("utf-8", "surrogateescape").split("\n"))
    if path.stem == "vary":
        parse_vary([line for line in lines if line])
        return
    for one in (*((line,) for line in lines), tuple(line for line in lines if line)):
        try:
            found = parse(one)
            for manifest in manifests().values():
                split(found, manifest)
            validate(CompareParameters, found, "the settings of the comparison")
        except EndoctError as error:
            check_line(str(error))


def check_line(text: str) -> None:
    """Raise where a message is not one line."""
    if "\n" in text or not text:
        raise AssertionError("a message of several lines")


def _drawing(path: Path) -> None:
    from benchmarks.fuzz.seed_drawings import SHAPE
    from endoct.fusion.files.drawings import is_label_store, read_drawing

    if path.is_dir():
        is_label_store(path)
    read_drawing(path, SHAPE)


def _mask(path: Path) -> None:
    from endoct.fusion.files.masks import read_mask
    from endoct.workbench.kinds import is_mask

    is_mask(path)
    read_mask(path, _drawn_on())


@cache
def _drawn_on() -> Any:
    from benchmarks.fuzz.seed_drawings import SHAPE
    from benchmarks.fuzz.seed_results import panorama
    from endoct.stitching.panorama import Panorama

    like, (n_z, n_theta) = panorama(), SHAPE
    grid = type(like.grid).full_circle(n_z, n_theta, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    rows, columns = slice(0, 2 * n_z, 2), slice(0, 2 * n_theta, 2)
    images = (like.intensity[rows, columns], None, like.valid[rows, columns], like.weight[rows, columns])
    return Panorama(grid, *images, "oct", True, True)


def _panorama(path: Path) -> None:
    from endoct.stitching.store import is_panorama, load_panorama

    is_panorama(path)
    load_panorama(path)


def _comparison(path: Path) -> None:
    from endoct.fusion.files.store import load_comparison

    load_comparison(path)


def _pictures(path: Path) -> None:
    from endoct.workbench.report.pictures import load_pictures

    load_pictures(path)


def _report(path: Path) -> None:
    from endoct.workbench.page.opening import open_shown
    from endoct.workbench.page.report import frozen_data, frozen_page
    from endoct.workbench.report.findings import read_findings
    from endoct.workbench.report.sections import report_sections

    shown = open_shown(path)
    frozen_page(shown, report_sections(read_findings(path), []), frozen_data(shown))


def _figures(path: Path) -> None:
    from endoct.workbench.report.figures.rendered import begin_both, drawn_of
    from endoct.workbench.report.findings import read_findings
    from endoct.workbench.report.sections import report_sections
    from endoct.workbench.running.scheduler import ALONE

    findings = read_findings(path)
    report_sections(findings, drawn_of(findings, begin_both(findings, ALONE, with_sides=True)))


def _exports(path: Path) -> None:
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


def _eye(path: Path) -> None:
    from endoct.fusion.segmentation.learned.looking import weights_for

    weights_for("endoscope", str(path))


def _submissions(path: Path) -> None:
    from endoct.workbench.bench.published import submission
    from endoct.workbench.bench.published.standings import read_boards

    for file in path.glob("*.json"):  # whoever forges one seals it
        with suppress(ValueError, TypeError, OSError, RecursionError):
            content = json.loads(file.read_bytes())
            content.pop("digest", None)
            file.write_text(json.dumps(content | {"digest": submission._digest(content)}))
    for board in read_boards(path):
        board.losses()
        for generator in board.generators:
            board.standings(generator)


def _describe(path: Path) -> None:
    from endoct.workbench.pipeline.information import describe

    describe(path)


def _summary(path: Path) -> None:
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


def _truth(path: Path) -> None:
    from endoct.stitching.store import load_panorama
    from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

    truth, panorama = load_truth(path), load_panorama(path / "panorama.zarr")
    true_cells(truth, true_pose(panorama, truth), panorama)


def _specimens(path: Path) -> None:
    from endoct.workbench.dataset.loader import Specimens

    specimens = Specimens(path)
    for index in range(len(specimens)):
        specimens[index]


def _records(path: Path) -> None:
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


def _sample(path: Path) -> None:
    from endoct.synthetic.specimen import _checked
    from endoct.workbench.pipeline.simulating import _read_json

    _checked(_read_json(path))


def _volume(path: Path) -> None:
    from endoct.fusion.pose.structures import segments_in
    from endoct.modalities.ct.ct_volume import holds_labels, is_volume, read_ct, upright
    from endoct.workbench.pipeline.information import texts_of
    from endoct.workbench.pipeline.volumes import describe_volume

    is_volume(path)
    ct = upright(read_ct(path, "lps"))
    texts_of(describe_volume(path))
    if ct.voxels.min() < 0:
        holds_labels(ct, str(path), "")
    else:
        segments_in(ct)


def _plan(path: Path) -> None:
    from endoct.modalities.ct.trajectory import is_plan, read_line

    is_plan(path)
    read_line(path)


def _label_names(path: Path) -> None:
    from endoct.modalities.ct.label_names import read_label_names

    read_label_names(path)


def _output(path: Path) -> None:
    from benchmarks.fuzz.seed_outputs import KIND
    from endoct.base.errors import EndoctError
    from endoct.base.files.output import new_output
    from endoct.workbench.verifying import verify

    refused = None
    try:
        verify(path)
    except EndoctError as error:
        refused = error
    with new_output(path, KIND, overwrite=True) as made:  # may only go where it is as it was written
        made.mkdir()
    if refused is not None:
        raise refused


def _unfinished(path: Path) -> None:
    from benchmarks.fuzz.seed_outputs import PLAN
    from endoct.workbench.bench.checkpoint import open_checkpoint

    open_checkpoint(path / "results", PLAN, overwrite=False).read()


def _seeds(module: str, *names: str) -> Callable[[], Iterator[Seed]]:
    """Return what yields the seeds of functions by name; modules that make seeds are loaded when they are asked."""

    def seeds() -> Iterator[Seed]:
        from importlib import import_module

        for name in names:
            yield from getattr(import_module(f"benchmarks.fuzz.{module}"), name)()

    return seeds


_ALL = (
    Reader("tiff", _frames, _seeds("seed_recordings", "tiff_seeds"), 18),
    Reader("npy", _frames, _seeds("seed_recordings", "npy_seeds"), 9),
    Reader("images", _frames, _seeds("seed_recordings", "image_seeds"), 9),
    Reader("video", _frames, _seeds("seed_recordings", "video_seeds"), 8),
    Reader("dicom", _stated, _seeds("seed_formats", "dicom_seeds"), 8, needs="endoct.modalities.dicom"),
    Reader("microscopes", _stated, _seeds("seed_formats", "microscope_seeds"), 8, needs="endoct.modalities.dicom"),
    Reader("sidecar", _sidecar, _seeds("seed_recordings", "sidecar_seeds"), 7),
    Reader("recording", _recording, _seeds("seed_recordings", "recording_seeds"), 5),
    Reader(
        "thorlabs",
        _opened,
        _seeds("seed_recordings", "thorlabs_seeds"),
        8,
        needs="endoct.modalities.reading.thorlabs",
    ),
    Reader("settings", _settings, _seeds("seed_recordings", "setting_seeds"), 3),
    Reader("drawings", _drawing, _seeds("seed_drawings", "drawing_seeds"), 12),
    Reader("masks", _mask, _seeds("seed_drawings", "mask_seeds"), 4),
    Reader("labels", _drawing, _seeds("seed_drawings", "label_seeds"), 6),
    Reader("pictures", _pictures, _seeds("seed_drawings", "picture_seeds"), 3),
    Reader("panorama", _panorama, _seeds("seed_results", "panorama_seeds"), 3),
    Reader("comparison", _comparison, _seeds("seed_results", "comparison_store_seeds"), 3),
    Reader("report", _report, _seeds("seed_results", "comparison_seeds"), 3),
    Reader("figures", _figures, _seeds("seed_results", "comparison_seeds"), 0.1, 120.0),
    Reader(
        "exports",
        _exports,
        _seeds("seed_results", "comparison_store_seeds", "comparison_seeds", "panorama_seeds"),
        0.5,
        30.0,
        needs="endoct.workbench.exporting",
    ),
    Reader("eye", _eye, _seeds("seed_models", "eye_seeds"), 2),
    Reader("submissions", _submissions, _seeds("seed_models", "submission_seeds"), 2),
    Reader("describe", _describe, _seeds("seed_results", "result_seeds", "panorama_seeds"), 2),
    Reader("summary", _summary, _seeds("seed_results", "summary_seeds"), 2),
    Reader("session", try_session, _seeds("seed_results", "session_seeds"), 2, needs="endoct.fusion.files.session"),
    Reader("drawn", try_drawn, _seeds("seed_results", "drawn_seeds"), 1, needs="endoct.fusion.files.masks"),
    Reader("truth", _truth, _seeds("seed_results", "truth_seeds"), 1.5),
    Reader("specimens", _specimens, _seeds("seed_sets", "set_seeds"), 2),
    Reader("records", _records, _seeds("seed_sets", "record_seeds"), 2),
    Reader("sample", _sample, _seeds("seed_sets", "sample_seeds"), 3),
    Reader("volumes", _volume, _seeds("seed_volumes", "volume_seeds"), 12, needs="endoct.modalities.ct"),
    Reader("plans", _plan, _seeds("seed_volumes", "plan_seeds"), 2, needs="endoct.modalities.ct"),
    Reader("label-names", _label_names, _seeds("seed_volumes", "label_table_seeds"), 1, needs="endoct.modalities.ct"),
    Reader("outputs", _output, _seeds("seed_outputs", "output_seeds"), 2, needs="endoct.base.files.contents"),
    Reader(
        "unfinished", _unfinished, _seeds("seed_outputs", "unfinished_seeds"), 0.5, needs="endoct.base.files.contents"
    ),
)
READERS = {reader.name: reader for reader in _ALL if not reader.needs or find_spec(reader.needs)}


@cache
def seeds_of(name: str) -> tuple[Seed, ...]:
    """Return the sound cases of a reader."""
    return tuple(READERS[name].seeds())
