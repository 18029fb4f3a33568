"""Each check of the conformance suite catches a plug-in that breaks what it checks."""

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.conformance import CHECKS, NotConforming, Subject, check_modality
from endoct.modalities.conformance.subject import Replaced
from endoct.modalities.contract import Sniff

BY_NAME = {check.__name__: check for check in CHECKS}
N_TURNS, N_THETA = 6, 64


@pytest.fixture(scope="module")
def package() -> Iterator[SimpleNamespace]:
    """The profilometer package, imported from its sources."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent / "endoct-profilometer"))
        yield SimpleNamespace(
            manifest=importlib.import_module("endoct_profilometer.manifest").MANIFEST,
            modality=importlib.import_module("endoct_profilometer.modality"),
        )
    for name in [name for name in sys.modules if name.startswith("endoct_profilometer")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    (folder / "acquisition.toml").write_text('modality = "profilometer"\nbore_diameter_mm = 2.5\npitch_mm = 0.1\n')
    rng = np.random.default_rng(2)
    for index in range(N_TURNS):
        radii = 1.25 + 0.2 * (rng.random(N_THETA) > 0.8)
        lines = "".join(f"{'' if k == 9 else radius},{rng.random():.3f}\n" for k, radius in enumerate(radii))
        (folder / f"turn_{index:04d}.csv").write_text("radius_mm,brightness\n" + lines)
    return folder


class Plain(Acquisition):
    """A sidecar whose key says nothing."""

    pitch_mm: float = 0.1


def sloppy(**changes: Any) -> Callable[[SimpleNamespace], Any]:
    """A manifest with fields changed."""
    return lambda package: replace(package.manifest, **changes)


def broken(**methods: Any) -> Callable[[SimpleNamespace], Any]:
    """A manifest whose implementation has methods replaced; each gets the right implementation first."""

    def build(package: SimpleNamespace) -> Any:
        right = package.modality.PROFILOMETER
        bound = {name: _bind(method, right) for name, method in methods.items()}
        wrong = type("Wrong", (type(right),), bound)()
        package.modality.WRONG = wrong
        return replace(package.manifest, implementation="endoct_profilometer.modality:WRONG")

    return build


def _bind(method: Any, right: Any) -> Any:
    return lambda self, *arguments: method(right, *arguments)


def _raise(error: Exception) -> Any:
    raise error


def _opened(right: Any, path: Path, acquisition: Any, change: Callable[[Any], Any]) -> Any:
    """The right stream with every frame changed."""
    stream = right.open(path, acquisition)

    class Changed(type(stream)):
        def __getitem__(self, index: int) -> Any:
            return change(super().__getitem__(index))

    return Changed(stream.files, stream.acquisition, stream.z_mm)


def _writable(frame: Any) -> Any:
    return replace(frame, samples=frame.samples.copy())


def _scribbling(right: Any, frame: Any, calibration: Any) -> Any:
    strip = right.unroll(frame, calibration)
    frame.samples.flags.writeable = True
    np.add(frame.samples, 1, out=frame.samples)
    return strip


def _kept_brighter(right: Any, stream: Any, parameters: Any) -> Any:
    return nullcontext(Replaced(stream, tuple(range(len(stream))), lambda samples: samples * 1.01))


CALLS = count()


def _counting(right: Any, frame: Any, calibration: Any) -> Any:
    strip = right.unroll(frame, calibration)
    return replace(strip, intensity=strip.intensity + next(CALLS))


def _by_processors(right: Any, stream: Any, parameters: Any) -> Any:
    calibration = right.survey(stream, parameters)
    return replace(calibration, per_frame={**calibration.per_frame, "workers": np.full(len(stream), os.cpu_count())})


def _changed_calibration(**changes: Any) -> Callable[..., Any]:
    def survey(right: Any, stream: Any, parameters: Any) -> Any:
        calibration = right.survey(stream, parameters)
        return replace(calibration, **{key: change(calibration) for key, change in changes.items()})

    return survey


def _changed_strip(change: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda right, frame, calibration: change(right.unroll(frame, calibration), calibration)


def _deaf_to_origin(right: Any, stream: Any, parameters: Any) -> Any:
    calibration = right.survey(stream, parameters)
    grid = replace(calibration.grid, theta0_rad=0.0)
    return replace(calibration, grid=grid)


def _only_many(right: Any, stream: Any, parameters: Any) -> Any:
    if len(stream) < 2:
        raise EndoctError("too few turns")
    return right.survey(stream, parameters)


def _surprised_by_black(right: Any, stream: Any, parameters: Any) -> Any:
    1 / int(np.nansum(stream[0].samples) > 0)
    return right.survey(stream, parameters)


def _reads_all(right: Any, path: Path, acquisition: Any) -> Any:
    np.ones(40 * 2**20, np.uint8)
    return right.open(path, acquisition)


def _lists_first(right: Any, path: Path, acquisition: Any) -> Any:
    sorted(path.iterdir())
    return right.open(path, acquisition)


BREACHES: dict[str, tuple[str, Callable[[SimpleNamespace], Any]]] = {
    "a name with a blank": ("manifest_is_complete", sloppy(name="Line laser")),
    "a suffix without a dot": ("manifest_is_complete", sloppy(suffixes=("csv",))),
    "an unknown channel": ("manifest_is_complete", sloppy(provides=frozenset({"colour"}))),
    "a key without a description": ("manifest_is_complete", sloppy(acquisition=Plain)),
    "a sniff that declines": ("sniff_claims_its_own", broken(sniff=lambda right, path: Sniff(False, "no"))),
    "a sniff that claims all": ("sniff_declines_with_a_reason", broken(sniff=lambda right, path: Sniff(True, "yes"))),
    "a sniff without a reason": ("sniff_declines_with_a_reason", broken(sniff=lambda right, path: Sniff(False, " "))),
    "a sniff that raises": (
        "sniff_declines_with_a_reason",
        broken(sniff=lambda right, path: _raise(OSError(13, "denied"))),
    ),
    "opening that reads all": ("opening_reads_no_samples", broken(open=_reads_all)),
    "a stream that never ends": (
        "stream_is_a_sequence",
        broken(open=lambda right, *a: SimpleEndless(right.open(*a))),
    ),
    "travel that is ignored": (
        "travel_turns_z_around",
        broken(open=lambda right, path, a: right.open(path, a.model_copy(update={"travel": "in"}))),
    ),
    "a stream with a lambda": (
        "stream_is_picklable",
        broken(open=lambda right, *a: _opened(right, *a, change=lambda frame: frame)),
    ),
    "frames that can be written": (
        "frames_are_read_only",
        broken(open=lambda right, *a: _opened(right, *a, change=_writable)),
    ),
    "a survey of the machine": ("survey_does_not_depend_on_workers", broken(survey=_by_processors)),
    "rows in the wrong order": (
        "calibration_is_complete",
        broken(survey=_changed_calibration(row_z_mm=lambda c: c.row_z_mm[::-1])),
    ),
    "a value for too few frames": (
        "calibration_is_complete",
        broken(survey=_changed_calibration(per_frame=lambda c: {**c.per_frame, "x": np.zeros(2)})),
    ),
    "no z for the frames": ("calibration_is_complete", broken(survey=_changed_calibration(per_frame=lambda c: {}))),
    "a note that is no sentence": (
        "calibration_is_complete",
        broken(survey=_changed_calibration(notes=lambda c: ("bad",))),
    ),
    "a calibration with a lambda": (
        "calibration_is_complete",
        broken(survey=_changed_calibration(deepest_mm=lambda c: lambda: 3.0)),
    ),
    "unrolling that counts": ("unrolling_is_pure", broken(unroll=_counting)),
    "unrolling that scribbles": ("unrolling_is_pure", broken(unroll=_scribbling)),
    "kept frames that were changed": ("reading_once_changes_nothing", broken(reading_once=_kept_brighter)),
    "a strip between the rows": (
        "strips_lie_on_the_grid",
        broken(unroll=_changed_strip(lambda s, c: replace(s, z_mm=s.z_mm + 0.05))),
    ),
    "depth left out": ("strips_are_sound", broken(unroll=_changed_strip(lambda s, c: replace(s, depth_mm=None)))),
    "NaN where valid": (
        "strips_are_sound",
        broken(unroll=_changed_strip(lambda s, c: replace(s, intensity=np.full(s.valid.shape, np.nan)))),
    ),
    "negative weights": ("strips_are_sound", broken(unroll=_changed_strip(lambda s, c: replace(s, weight=-s.weight)))),
    "nothing seen": (
        "strips_are_sound",
        broken(unroll=_changed_strip(lambda s, c: replace(s, valid=np.zeros(s.valid.shape, bool)))),
    ),
    "a θ origin that is ignored": ("theta_is_a_circle", broken(survey=_deaf_to_origin)),
    "settling that moves the grid": (
        "settling_keeps_the_grid",
        broken(settle=lambda right, p, c: replace(p, grid=replace(p.grid, z0_mm=9.0))),
    ),
    "settling that leaves NaN": (
        "settling_keeps_the_grid",
        broken(settle=lambda right, p, c: replace(p, valid=np.ones(p.grid.shape, bool))),
    ),
    "a volume promised and not written": (
        "volumes_are_written",
        sloppy(provides=frozenset({"intensity", "depth", "volume"})),
    ),
    "pictures of one name": (
        "illustrations_can_be_drawn",
        broken(illustrate=lambda right, f, c: right.illustrate(f, c) * 2),
    ),
    "places in a picture that there is not": (
        "places_are_located",
        broken(locate=lambda right, i, p, c: {"else": right.locate(i, p, c)["turn"]}),
    ),
    "places far away seen": (
        "places_are_located",
        broken(locate=lambda right, i, p, c: {"turn": np.stack([p.theta_rad % (2 * np.pi), p.z_mm], axis=1)}),
    ),
    "places on no circle": (
        "places_are_located",
        broken(locate=lambda right, i, p, c: {"turn": right.locate(i, p, c)["turn"] + p.theta_rad[:, np.newaxis]}),
    ),
    "a single frame refused": ("one_frame_is_a_recording", broken(survey=_only_many)),
    "a black frame that surprises": ("bad_frames_raise_endoct_errors", broken(survey=_surprised_by_black)),
    "a missing file that surprises": (
        "bad_files_raise_endoct_errors",
        broken(open=_lists_first),
    ),
}


class SimpleEndless:
    """A stream that starts again behind its end."""

    def __init__(self, stream: Any) -> None:
        self.stream, self.acquisition = stream, stream.acquisition

    def __len__(self) -> int:
        return len(self.stream)

    def __getitem__(self, index: int) -> Any:
        return self.stream[index % len(self.stream)]


def test_the_plug_in_itself_conforms(package: SimpleNamespace, recording: Path) -> None:
    assert check_modality(package.manifest, recording) == []


@pytest.mark.parametrize("breach", BREACHES)
def test_a_breach_is_caught(breach: str, package: SimpleNamespace, recording: Path) -> None:
    name, build = BREACHES[breach]
    subject = Subject(build(package), recording)
    with pytest.raises((NotConforming, EndoctError)):
        BY_NAME[name](subject)


def test_a_heavy_manifest_is_caught(package: SimpleNamespace, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "heavy_sidecar.py").write_text(
        "import cv2\nfrom endoct.modalities.acquisition import Acquisition\nclass Heavy(Acquisition):\n    pass\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        heavy = replace(package.manifest, acquisition=importlib.import_module("heavy_sidecar").Heavy)
        with pytest.raises(NotConforming, match="loads cv2"):
            BY_NAME["manifest_is_light"](Subject(heavy, recording))
        patch.setattr("endoct.modalities.conformance.recording_checks.LONGEST_S", 1e-3)
        with pytest.raises(NotConforming, match="heavy_sidecar has no end within"):
            BY_NAME["manifest_is_light"](Subject(heavy, recording))


def test_every_check_is_broken_once() -> None:
    assert {name for name, _ in BREACHES.values()} | {"manifest_is_light"} == set(BY_NAME)
