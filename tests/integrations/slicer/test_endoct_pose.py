"""The module of 3D Slicer, without Slicer: what its conventions ask for, and what it asks of the command line."""

import importlib.util
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import TestCase
from unittest.mock import MagicMock

import pytest

from endoct.workbench.commands import run
from endoct.workbench.commands.poses import Pose
from endoct.workbench.posing.handover import write_handover

EXTENSION = Path(__file__).parents[3] / "integrations" / "slicer"
NAME = "EndoctPose"
CRASH, FAILED_TO_START = object(), object()


class Signal:
    def __init__(self) -> None:
        self.slots: list[Any] = []
        self.connect, self.disconnect = self.slots.append, self.slots.remove

    def __call__(self, *values: Any) -> None:
        for slot in self.slots:
            slot(*values)


class Process:
    CrashExit, FailedToStart = CRASH, FAILED_TO_START

    def __init__(self) -> None:
        self.finished, self.errorOccurred, self.calls = Signal(), Signal(), []
        self.output = self.errors = b""

    def setProcessEnvironment(self, environment: dict[str, str]) -> None:
        self.environment = environment

    def start(self, program: str, arguments: list[str]) -> None:
        self.command = [program, *arguments]

    def terminate(self) -> None:
        self.calls.append("terminate")

    def kill(self) -> None:
        self.calls.append("kill")

    def readAllStandardOutput(self) -> Any:
        return SimpleNamespace(data=lambda: self.output)

    def readAllStandardError(self) -> Any:
        return SimpleNamespace(data=lambda: self.errors)


class Environment(dict):
    insert = dict.__setitem__


class Path_:
    """A ctkPathLineEdit."""

    Dirs, Files, Executable = 1, 2, 4
    currentPath = ""


class Base:
    """Of all that a module inherits from."""

    def __init__(self, parent: Any = None) -> None:
        self.parent, self.layout = parent, MagicMock()

    def setup(self) -> None:
        """Of a widget."""


@pytest.fixture
def slicer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Slicer as far as the module asks for it; ``loaded`` is what it loads, ``left`` its folder of copies."""
    application = MagicMock()
    application.qMRMLNodeComboBox = MagicMock
    application.kept = {}
    application.app.userSettings().value = application.kept.get
    application.app.userSettings().setValue = application.kept.__setitem__
    application.loaded = []
    util = application.util
    application.left = tmp_path / "temporary"

    def temporary() -> str:
        application.left.mkdir()
        return str(application.left)

    def export(node: Any, path: str, properties: dict[str, str], *, world: bool) -> bool:
        assert not properties, "Slicer would take the format of the file before"
        properties["fileFormat"] = Path(path).suffix
        return bool(Path(path).write_text(f"{node} in the world" if world else f"{node}"))

    util.tempDirectory, util.exportNode = temporary, export
    util.startupEnvironment = lambda: {"PATH": "/usr/bin"}
    for load in ("loadModel", "loadMarkups", "loadTransform"):
        setattr(util, load, lambda path, load=load: application.loaded.append((load, Path(path).name)))
    bases = ModuleType("slicer.ScriptedLoadableModule")
    for kind, base in (("", Base), ("Widget", Base), ("Logic", Base), ("Test", TestCase)):
        setattr(bases, f"ScriptedLoadableModule{kind}", type(f"ScriptedLoadableModule{kind}", (base,), {}))
    toolkit = SimpleNamespace(
        QProcess=Process, QProcessEnvironment=Environment, QTimer=MagicMock(), QFormLayout=MagicMock,
        QPushButton=lambda text: SimpleNamespace(clicked=Signal()), QLabel=lambda text: SimpleNamespace(text=text),
    )  # fmt: skip
    application.qt = toolkit
    for name, fake in {
        "slicer": application, "slicer.ScriptedLoadableModule": bases, "qt": toolkit,
        "ctk": SimpleNamespace(ctkPathLineEdit=Path_), "vtk": ModuleType("vtk"),
    }.items():  # fmt: skip
        monkeypatch.setitem(sys.modules, name, fake)
    return application


@pytest.fixture
def module(slicer: Any) -> Any:
    specification = importlib.util.spec_from_file_location(NAME, EXTENSION / NAME / f"{NAME}.py")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def widget(module: Any, slicer: Any) -> Any:
    """The form, filled in for a comparison's side and a recording."""
    form = module.EndoctPoseWidget()
    form.setup()
    form.ct.currentNode, form.plan.currentNode = lambda: "CT", lambda: "plan"
    form.sides[0].currentPath, form.sides[1].currentPath = "/data/my bores/7:oct", "/data/endoscope"
    form.output.currentPath = "/data/pose"
    return form


def test_the_module_has_what_slicer_looks_for(module: Any) -> None:
    for kind in ("", "Widget", "Logic", "Test"):
        assert getattr(module, NAME + kind).__mro__[1].__name__ == f"ScriptedLoadableModule{kind}"
    parent = SimpleNamespace()
    getattr(module, NAME)(parent)
    assert parent.title
    for several in (parent.categories, parent.contributors):
        assert several
        assert all(isinstance(text, str) for text in several)
    assert parent.dependencies == []
    assert "not for clinical decisions" in parent.helpText
    assert "BSD-3-Clause" in parent.acknowledgementText


def test_the_extension_has_what_its_template_has() -> None:
    whole = (EXTENSION / "CMakeLists.txt").read_text()
    values = dict(re.findall(r'^set\((EXTENSION_\w+) "([^"\n]*)"\)', whole, re.MULTILINE))
    assert set(values) == {
        f"EXTENSION_{name}"
        for name in (*("HOMEPAGE", "CATEGORY", "CONTRIBUTORS", "DESCRIPTION", "ICONURL", "SCREENSHOTURLS", "DEPENDS"),)
    }
    assert values["EXTENSION_DEPENDS"] == "NA"
    for line in (
        "find_package(Slicer REQUIRED)", "include(${Slicer_USE_FILE})", f"add_subdirectory({NAME})",
        "include(${Slicer_EXTENSION_GENERATE_CONFIG})", "include(${Slicer_EXTENSION_CPACK})",
    ):  # fmt: skip
        assert line in whole.splitlines()
    own = (EXTENSION / NAME / "CMakeLists.txt").read_text()
    assert f"set(MODULE_NAME {NAME})" in own
    assert re.search(r"slicerMacroBuildScriptedModule\(\s+NAME \$\{MODULE_NAME\}\s+SCRIPTS", own)
    assert "slicer_add_python_unittest(SCRIPT ${MODULE_NAME}.py)" in own


def test_slicers_own_test_passes(module: Any) -> None:
    module.EndoctPoseTest().runTest()


def test_the_command_line_is_one_of_endoct(
    widget: Any, slicer: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Pose] = []
    monkeypatch.setattr(Pose, "__call__", lambda self: asked.append(self) or 0)
    widget.onRun()
    process = widget.process
    assert process.command[0] == "endoct"
    assert run(process.command[1:]) == 0
    (request,) = asked
    assert [str(side) for side in request.sides] == ["/data/my bores/7:oct", "/data/endoscope"]
    assert (request.ct, request.plan) == (slicer.left / "ct.nrrd", slicer.left / "plan.mrk.json")
    assert (request.ct.read_text(), request.plan.read_text()) == ("CT in the world", "plan in the world")
    assert str(request.output) == "/data/pose"
    assert process.environment == {"PATH": "/usr/bin"}
    assert (widget.runButton.enabled, widget.cancelButton.enabled) == (False, True)


def test_what_endoct_wrote_is_loaded(module: Any, widget: Any, slicer: Any) -> None:
    widget.onRun()
    widget.output.currentPath = "/elsewhere"  # the form may be changed meanwhile
    widget.process.output = "offset from the plan (mm): 0.36°\nreport: x\n".encode()
    loads: list[str] = []
    widget.logic.load = loads.append
    widget.process.finished(0, object())
    assert loads == ["/data/pose"]
    assert not slicer.left.exists()
    assert widget.status.text == "offset from the plan (mm): 0.36°\nreport: x"
    assert (widget.runButton.enabled, widget.cancelButton.enabled) == (True, False)
    module.EndoctPoseLogic().load("/data/pose")
    assert slicer.loaded == [
        ("loadModel", "bore.ply"), ("loadMarkups", "trajectory.mrk.json"), ("loadTransform", "world_to_bore.tfm"),
    ]  # fmt: skip
    assert all(f'"{name}"' in inspect.getsource(write_handover) for _, name in slicer.loaded)


@pytest.mark.parametrize(
    ("finished", "output", "errors", "said"),
    [
        ((3, object()), b"cannot be told: the two contradict each other", b"", "cannot be told: the two contradict"),
        ((1, object()), b"", b"reading \xe2\x80\xa6\nendoct: the CT is empty; found 0 voxels\n", "endoct: the CT is"),
        ((130, object()), b"", b"endoct: interrupted; nothing was left half-written", "endoct: interrupted"),
        ((0, CRASH), b"", b"half a line", "endoct was stopped"),
        ((2,), b"", b"", "endoct was stopped"),
    ],
)
def test_where_there_is_no_pose_one_line_says_why(
    widget: Any, slicer: Any, finished: tuple[Any, ...], output: bytes, errors: bytes, said: str
) -> None:
    widget.onRun()
    widget.process.output, widget.process.errors = output, errors
    widget.process.finished(*finished)
    assert widget.status.text.startswith(said)
    assert "\n" not in widget.status.text
    assert not slicer.loaded
    assert widget.runButton.enabled


def test_a_run_is_cancelled_and_left_behind_by_nobody(widget: Any, slicer: Any) -> None:
    widget.cleanup()
    widget.onRun()
    widget.onCancel()
    assert widget.process.calls == ["terminate"]
    after_ms, kill = slicer.qt.QTimer.singleShot.call_args.args
    kill()
    assert (after_ms, widget.process.calls) == (5000, ["terminate", "kill"])
    widget.cleanup()
    assert widget.process.calls[-1] == "terminate"
    assert not widget.process.finished.slots
    assert not slicer.left.exists()


def test_results_go_into_a_folder_that_is_new(module: Any, widget: Any, tmp_path: Path) -> None:
    """The button of a path offers a folder that exists, and that only where no file may be chosen."""
    assert [path.filters for path in (*widget.sides, widget.output)] == [Path_.Dirs] * 3
    place = module.EndoctPoseLogic().place
    assert place(str(tmp_path / "new")) == str(tmp_path / "new")
    (tmp_path / "pose-1").mkdir()
    assert place(str(tmp_path)) == str(tmp_path / "pose-2")


def test_the_program_is_chosen_once(module: Any, widget: Any) -> None:
    widget.program.currentPath = "/opt/endoct/bin/endoct"
    widget.onRun()
    assert widget.process.command[0] == "/opt/endoct/bin/endoct"
    another = module.EndoctPoseWidget()
    another.setup()
    assert another.program.currentPath == "/opt/endoct/bin/endoct"


def test_a_program_that_is_not_there_is_named(widget: Any) -> None:
    widget.onRun()
    widget.process.errorOccurred(object())
    assert "looking" in widget.status.text
    widget.process.errorOccurred(FAILED_TO_START)
    assert widget.status.text == "endoct cannot be started: choose where endoct is installed"
    assert widget.runButton.enabled


@pytest.mark.parametrize(
    ("lacking", "said"),
    [
        ("ct", "choose a CT"),
        ("plan", "choose a plan"),
        ("side", "choose a recording"),
        ("output", "choose a folder"),
        ("disk", "the CT cannot be saved"),
    ],
)
def test_what_is_lacking_is_said_and_nothing_starts(widget: Any, slicer: Any, lacking: str, said: str) -> None:
    if lacking in ("ct", "plan"):
        getattr(widget, lacking).currentNode = lambda: None
    elif lacking == "side":
        widget.sides[0].currentPath = widget.sides[1].currentPath = ""
    elif lacking == "output":
        widget.output.currentPath = ""
    else:
        slicer.util.exportNode = lambda node, path, properties, world: False
    widget.onRun()
    assert widget.status.text.startswith(said)
    assert widget.process is None
    assert not slicer.left.exists()
