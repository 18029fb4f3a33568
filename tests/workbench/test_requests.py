"""One request a command: what Python is called with is what the command line reads."""

import inspect
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest
import tyro

from endoct.workbench import (
    calibrate,
    compare,
    export,
    pose,
    pose_outlook,
    run_bench,
    simulate,
    summarise,
    train,
    unroll,
    verify,
)
from endoct.workbench.calibrating.printed_tube import write_tube
from endoct.workbench.commands.comparisons import Compare, Summarise
from endoct.workbench.commands.outputs import Export, Verify
from endoct.workbench.commands.poses import Pose
from endoct.workbench.commands.recordings import Calibrate, Info, Tube, Unroll
from endoct.workbench.commands.research import Bench, Train
from endoct.workbench.commands.simulations import Simulate
from endoct.workbench.requests import (
    BenchRequest,
    CalibrateRequest,
    CompareRequest,
    ExportRequest,
    InfoRequest,
    OutlookRequest,
    PoseRequest,
    SimulateRequest,
    SummariseRequest,
    TargetRequest,
    TrainRequest,
    UnrollRequest,
    VerifyRequest,
    by_request,
)
from endoct.workbench.settings import parse, parse_place, parse_vary

COMMANDS = {
    Unroll: UnrollRequest,
    Compare: CompareRequest,
    Simulate: SimulateRequest,
    Pose: PoseRequest,
    Export: ExportRequest,
    Calibrate: CalibrateRequest,
    Tube: TargetRequest,
    Info: InfoRequest,
    Summarise: SummariseRequest,
    Verify: VerifyRequest,
    Train: TrainRequest,
    Bench: BenchRequest,
}
PYTHON = (
    (unroll, UnrollRequest),
    (compare, CompareRequest),
    (simulate, SimulateRequest),
    (pose, PoseRequest),
    (pose_outlook, OutlookRequest),
    (export, ExportRequest),
    (calibrate, CalibrateRequest),
    (write_tube, TargetRequest),
    (summarise, SummariseRequest),
    (verify, VerifyRequest),
    (train, TrainRequest),
    (run_bench, BenchRequest),
)
NOT_TYPED = {"progress", "on_remark"}
"""What only Python can give."""


@pytest.mark.parametrize(("function", "request_type"), PYTHON)
def test_python_takes_the_parts_of_a_request(function, request_type) -> None:
    assert list(inspect.signature(function).parameters) == list(inspect.signature(request_type).parameters)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_has_its_meaning_on_the_command_line(command: type, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        tyro.cli(command, args=["--help"])
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for one in fields(COMMANDS[command]):
        meaning = next(
            (text for base in command.__mro__ if (text := _meaning(base, one.name)) is not None), None
        )  # fmt: skip
        assert meaning, one.name
        assert (meaning in printed) is (one.name not in NOT_TYPED), one.name


def _meaning(kind: type, name: str) -> str | None:
    """Return the first words that a class's docstring says of an argument."""
    lines = (kind.__doc__ or "").splitlines()
    said = [line.split(": ", 1)[1] for line in lines if line.strip().startswith(f"{name}: ")]
    return " ".join(said[0].split()[:3]) if said else None


def test_a_command_makes_the_request_that_python_makes() -> None:
    words = ["a.zarr", "b.zarr", "-o", "out", "--set", "n_theta=512", "--set-b", "undistort=sine", "--truth", "x", "y"]
    words += ["--recipe", "paper"]
    typed = tyro.cli(Compare, args=words)
    called = CompareRequest(
        Path("a.zarr"),
        Path("b.zarr"),
        Path("out"),
        recipe="paper",
        settings={"n_theta": 512},
        settings_b={"undistort": "sine"},
        truth=(Path("x"), Path("y")),
    )
    for one in fields(CompareRequest):
        from_words, from_python = getattr(typed, one.name), getattr(called, one.name)
        if one.name.startswith("settings"):
            from_words, from_python = parse(from_words), parse(from_python)
        assert from_words == from_python, one.name
    with pytest.raises(FrozenInstanceError):
        typed.overwrite = True  # type: ignore[misc]


def test_what_python_states_is_taken_as_it_is() -> None:
    assert parse({"a": 1}) == {"a": 1}
    assert parse(None) == parse(()) == {}
    assert parse_vary({"oct.scan": ("step",)}) == parse_vary(("oct.scan=step",))
    assert parse_vary(None) == {}
    assert parse_place("entry", (1.0, 2.0, 3.0)) == parse_place("entry", "1,2,3")


def test_a_function_takes_a_request_or_its_parts() -> None:
    @by_request(UnrollRequest)
    def asked(request: UnrollRequest) -> tuple[object, bool]:
        """Say what was asked."""
        return request.path, request.volume

    assert asked("p", volume=True) == asked(UnrollRequest("p", volume=True)) == ("p", True)
    assert asked.__doc__ == "Say what was asked."
    with pytest.raises(TypeError, match="colour"):
        asked("p", colour=1)  # type: ignore[call-overload]


def test_what_was_asked_for_is_in_words_and_without_defaults() -> None:
    asked = CompareRequest(Path("a"), "b", "out", settings_b={"travel": "in", "seed": 3, "flat": True}, overwrite=True)
    assert asked.asked() == {"a": "a", "b": "b", "settings_b": ("travel=in", "seed=3", "flat=true")}
    assert CompareRequest("a", "b", settings=("n_theta=512",), truth=(Path("m.png"),)).asked() == {
        "a": "a", "b": "b", "settings": ("n_theta=512",), "truth": ("m.png",),
    }  # fmt: skip
