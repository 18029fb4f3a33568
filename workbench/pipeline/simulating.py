"""A specimen from the command line or from Python, without loading what only comparing takes."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import new_output
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.stored import Convention
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.sample.ranges import NO_RANGES, Range
from endoct.synthetic.specimen import simulate as render
from endoct.workbench.running.kinds import SPECIMEN
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread

Point = tuple[float, float, float]
MOST_SAMPLE_BYTES = 16_000_000
"""Of a sample.json; usual ones have under 1 MB, and what is read takes many times its size."""


@one_blas_thread()
def simulate(
    output: Path | str,
    *,
    preset: PresetName = "quick",
    seed: int = 0,
    replay: Path | str | None = None,
    vary: Mapping[str, Range] | None = None,
    bone: Path | str | None = None,
    entry_mm: Point | None = None,
    target_mm: Point | None = None,
    coordinates: Convention | None = None,
    bone_hu: float | None = None,
    bone_label: int | None = None,
    detail_mm: float = 0.0,
    ct: bool = False,
    ct_slice_mm: float | None = None,
    cone_beam: bool = False,
    labels: bool = False,
    spectra: bool = False,
    overwrite: bool = False,
    on_remark: Callable[[str], None] | None = None,
    progress: bool | Stages = True,
) -> None:
    """Simulate a specimen: both recordings of one bore, with truth, in the folder ``output``.

    ``replay`` is the ``truth/sample.json`` of an earlier specimen, made again to the byte. ``vary`` says what
    parameters are drawn from, "part.name" → (low, high) or words, where not by the preset. ``bone`` is a CT or a
    segmentation of one to drill into, from ``entry_mm`` to ``target_mm``, whose ``coordinates`` are what the file says
    unless stated, where ``bone_hu`` or more is bone, or ``bone_label``, with ``detail_mm`` rms added that is finer than
    its voxels (:func:`endoct.synthetic.bone.patient.stated_volume`). ``ct`` adds a CT of that bone before drilling, or
    of the simulated mastoid, with slices of ``ct_slice_mm``; ``cone_beam`` one after it. ``labels`` adds truth/labels,
    for training networks; ``spectra`` the spectrometer's raw data; ``on_remark`` is called with what was mended in
    ``bone`` and what is doubted of it, in sentences; ``progress=False`` displays none. Raises
    :class:`EndoctError` for a parameter that there is not or a range that cannot be, for a bone that cannot be drilled
    so, and where ``output`` exists and ``overwrite`` is not set.

    >>> from endoct.workbench import simulate
    >>> simulate("specimen", preset="learning", seed=7, vary={"oct.wall_db": (12.0, 14.0)})
    >>> import pathlib
    >>> sorted(folder.name for folder in pathlib.Path("specimen").glob("*/"))
    ['endoscope', 'oct', 'truth']
    """
    stages = stages_for(progress)
    sample = _read_json(Path(replay)) if replay is not None else None
    inputs = [Path(path) for path in (replay, bone) if path is not None]
    volume = None
    if bone is not None:
        if entry_mm is None or target_mm is None:
            raise EndoctError("it is not said where to drill", expected="--entry=x,y,z and --target=x,y,z, mm")
        if replay is not None:
            raise EndoctError("a sample that is replayed has its bone already", remedy="leave out --bone or --replay")
        from endoct.synthetic.bone.patient import stated_volume

        volume = stated_volume(
            Path(bone),
            entry_mm,
            target_mm,
            coordinates=coordinates,
            bone_hu=bone_hu,
            bone_label=bone_label,
            detail_mm=detail_mm,
            on_read=None if on_remark is None else lambda ct: _remark(ct, on_remark),
        )
    elif any(option is not None for option in (entry_mm, target_mm, coordinates, bone_hu, bone_label)) or detail_mm:
        raise EndoctError("it is not said what to drill into", expected="--bone with the path of a CT")
    with (
        new_output(Path(output), SPECIMEN, overwrite=overwrite, inputs=inputs) as scratch,
        stages.stage(f"simulate {preset}") as advance,
    ):
        render(
            scratch,
            preset=preset,
            seed=seed,
            ranges=vary or NO_RANGES,
            volume=volume,
            ct=ct or ct_slice_mm is not None,
            ct_slice_mm=ct_slice_mm,
            cone_beam=cone_beam,
            sample=sample,
            labels=labels,
            spectra=spectra,
            on_progress=lambda _, share: advance(share),
        )


def _remark(ct: CtVolume, say: Callable[[str], None]) -> None:
    for doubt in ct.doubts:
        say(f"doubt: {doubt.what}")
    for note in ct.notes:
        say(f"note: {note}")


def _read_json(path: Path) -> Mapping[str, Any]:
    data = read_small(path, MOST_SAMPLE_BYTES)
    with refusing(f"{path} cannot be read", expected="a truth/sample.json"):
        sample = json.loads(data)
    if not isinstance(sample, dict):
        raise EndoctError(f"{path} is no sample", expected="a truth/sample.json")
    return sample
