"""Readers of what people give: recordings, sidecars, settings, drawings, CTs, plans, samples to simulate again."""

from functools import cache
from pathlib import Path
from typing import Any


def try_frames(path: Path) -> None:
    from endoct.modalities.reading.recording import open_stack

    stack = open_stack(path)
    for index in range(len(stack)):
        stack[index]


def try_stated(path: Path) -> None:
    from endoct.modalities.reading.recording import stated_by

    stated_by(path)
    try_frames(path)


def try_recording(path: Path) -> None:
    from endoct.modalities.registry import manifests
    from endoct.workbench.pipeline.information import describe

    for manifest in manifests().values():
        manifest.load().sniff(path)
    describe(path)
    try_opened(path)


def try_opened(path: Path) -> None:
    from endoct.modalities.recognition import open_recording

    _, stream = open_recording(path)
    for index in range(len(stream)):
        stream[index]


def try_sidecar(path: Path) -> None:
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


def try_settings(path: Path) -> None:
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


def try_drawing(path: Path) -> None:
    from benchmarks.fuzz.seed_drawings import SHAPE
    from endoct.fusion.files.drawings import is_label_store, read_drawing

    if path.is_dir():
        is_label_store(path)
    read_drawing(path, SHAPE)


def try_mask(path: Path) -> None:
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


def try_sample(path: Path) -> None:
    from endoct.synthetic.specimen import _checked
    from endoct.workbench.pipeline.simulating import _read_json

    _checked(_read_json(path))


def try_volume(path: Path) -> None:
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


def try_plan(path: Path) -> None:
    from endoct.modalities.ct.trajectory import is_plan, read_line

    is_plan(path)
    read_line(path)


def try_label_names(path: Path) -> None:
    from endoct.modalities.ct.label_names import read_label_names

    read_label_names(path)
