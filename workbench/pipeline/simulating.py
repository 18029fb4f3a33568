"""Simulate a specimen, for the command line and for Python alike; or simulate one and make a result of it.

Nothing is loaded here that only a comparison needs.
"""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from endoct.base.compute.own_process import undone_in_the_end
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import OVERWRITE, check_output, check_place, new_output, remove_output
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.synthetic.sample.parameters import Volume
from endoct.synthetic.specimen import simulate as render
from endoct.workbench.requests import SimulateRequest, by_request
from endoct.workbench.running.outputs import SPECIMEN
from endoct.workbench.running.progress import stages_for
from endoct.workbench.running.scheduler import one_blas_thread
from endoct.workbench.settings import parse_place, parse_vary

MOST_SAMPLE_BYTES = 16_000_000
"""A sample.json may have as many bytes. Usual ones have under 1 MB, and reading takes many times the size."""
Made = TypeVar("Made")


@by_request(SimulateRequest)
@one_blas_thread()
def simulate(request: SimulateRequest) -> None:
    """Simulate a specimen: both recordings of one bore, with truth, in the folder ``output``.

    Arguments are those of :class:`~endoct.workbench.requests.SimulateRequest`; ``vary`` is a mapping, "part.name" →
    (low, high) or words. Raises :class:`EndoctError` for an unknown parameter, an impossible range, or a bone that
    cannot be drilled so. So it does where ``output`` exists and ``overwrite`` is not set.

    >>> from endoct.workbench import simulate
    >>> simulate("specimen", preset="learning", seed=7, vary={"oct.wall_db": (12.0, 14.0)})
    >>> import pathlib
    >>> sorted(folder.name for folder in pathlib.Path("specimen").glob("*/"))
    ['endoscope', 'oct', 'truth']
    """
    stages = stages_for(request.progress)
    ranges = parse_vary(request.vary)
    sample = _read_json(Path(request.replay)) if request.replay is not None else None
    volume = _volume(request)
    inputs = [Path(path) for path in (request.replay, request.bone) if path is not None]
    has_ct = request.ct or request.ct_slice_mm is not None
    wanted = {"ct": has_ct or request.cone_beam, "spectra": request.spectra, "labels": request.labels}
    extra = [step for step, is_wanted in wanted.items() if is_wanted]
    # an option of the simulator has one name here and there
    options = {name: value for name, value in vars(request).items() if name in inspect.signature(render).parameters}
    with (
        new_output(Path(request.output), SPECIMEN, overwrite=request.overwrite, inputs=inputs) as scratch,
        stages.stage(f"simulate {request.preset}") as advance,
    ):
        render(
            scratch,
            **options | {"ct": has_ct},
            ranges=ranges,
            volume=volume,
            sample=sample,
            on_progress=_as_a_whole(advance, ("wall", "oct", "endoscope", *extra)),
        )


def _as_a_whole(advance: Callable[[float], None], steps: Sequence[str]) -> Callable[[str, float], None]:
    """Return a function that takes how much of each step is done, and reports how much of all ``steps`` is."""
    shares = dict.fromkeys(steps, 0.0)

    def step_done(step: str, share: float) -> None:
        shares[step] = share
        advance(sum(shares.values()) / len(shares))

    return step_done


def _volume(request: SimulateRequest) -> Volume | None:
    """Return the bone to drill into, where one is given."""
    entry_mm, target_mm = parse_place("entry", request.entry_mm), parse_place("target", request.target_mm)
    stated = entry_mm, target_mm, request.coordinates, request.bone_hu, request.bone_label
    if request.bone is None:
        if any(option is not None for option in stated) or request.detail_mm:
            raise EndoctError("it is not said what to drill into", expected="--bone with the path of a CT")
        return None
    if entry_mm is None or target_mm is None:
        raise EndoctError("it is not said where to drill", expected="--entry=x,y,z and --target=x,y,z, mm")
    if request.replay is not None:
        raise EndoctError("a sample that is replayed has its bone already", remedy="leave out --bone or --replay")
    from endoct.synthetic.bone.patient import stated_volume  # most specimens have no volume

    say = request.on_remark

    def remark(ct: CtVolume) -> None:
        for kind, texts in (("doubt", [doubt.what for doubt in ct.doubts]), ("note", ct.notes)):
            for text in texts:
                if say is not None:
                    say(f"{kind}: {text}")

    return stated_volume(
        Path(request.bone),
        (entry_mm, target_mm),
        coordinates=request.coordinates,
        bone_hu=request.bone_hu,
        bone_label=request.bone_label,
        detail_mm=request.detail_mm,
        on_read=None if say is None else remark,
    )


def _read_json(path: Path) -> Mapping[str, Any]:
    data = read_small(path, MOST_SAMPLE_BYTES)
    with refusing(f"{path} cannot be read", expected="a truth/sample.json"):
        sample = json.loads(data)
    if not isinstance(sample, dict):
        raise EndoctError(f"{path} is no sample", expected="a truth/sample.json")
    return sample


def demonstrate(
    output: Path,
    result: tuple[str, str],
    simulate: Callable[[Path], object],
    make: Callable[[Path, Path], Made],
    *,
    overwrite: bool,
) -> Made:
    """Simulate a specimen in ``output``/specimen, make a result of it next to it, and return that result.

    ``result``: its name in ``output``, and its kind. ``simulate`` is called with the specimen's folder, ``make`` with
    this one and the result's. Neither folder is left where one of the two fails. Raises :class:`EndoctError` where
    ``output`` exists and ``overwrite`` is not set, or cannot be written.
    """
    existed = output.exists()
    if existed and not overwrite:
        raise EndoctError(f"{output} exists already", remedy=OVERWRITE)
    check_place(output)
    specimen, place = output / "specimen", output / result[0]
    for part, kind in ((specimen, SPECIMEN), (place, result[1])):
        check_output(part, kind, overwrite=overwrite)

    def leave_nothing() -> None:
        if not existed and not place.exists():
            remove_output(specimen, SPECIMEN)
            with suppress(OSError):  # somebody else has put something there
                output.rmdir()

    with undone_in_the_end(leave_nothing):
        try:
            simulate(specimen)
            return make(specimen, place)
        except BaseException:
            leave_nothing()
            raise
