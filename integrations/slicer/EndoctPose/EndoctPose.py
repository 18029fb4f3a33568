"""A module of 3D Slicer: `endoct pose` for a CT and a line of the scene, and what it writes, loaded.

It saves both, calls the command line in a process of its own, and loads the results; all else is endoct's.
"""

import shutil
from itertools import count
from pathlib import Path

import ctk
import qt
import slicer
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleTest,
    ScriptedLoadableModuleWidget,
)

PROGRAM = "EndoctPose/program"
DONE, UNTOLD = 0, 3
KILLED_AFTER_MS = 5000
RESULTS = (
    ("loadModel", "bore.ply"),
    ("loadMarkups", "trajectory.mrk.json"),
    ("loadTransform", "world_to_bore.tfm"),
)
"""What loads each file. Slicer reads transforms as images are resampled: this one takes the bore into the CT."""


class EndoctPose(ScriptedLoadableModule):
    """What Slicer lists."""

    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Endoct Pose"
        parent.categories = ["IGT"]
        parent.dependencies = []
        parent.contributors = ["The endoct developers"]
        parent.helpText = (
            "Where a drill hole lies in the patient's CT, by the air cells on its recorded wall. Needs endoct, in an "
            "environment of its own. Research software, not for clinical decisions."
        )
        parent.acknowledgementText = "endoct, under BSD-3-Clause. The method: Laves et al. 2019, arXiv:1901.06490."


class EndoctPoseWidget(ScriptedLoadableModuleWidget):
    """The form, and the process that it starts."""

    def setup(self):
        """Build the form."""
        ScriptedLoadableModuleWidget.setup(self)
        self.logic, self.process, self.saved = EndoctPoseLogic(), None, None
        form = qt.QFormLayout()
        self.ct = self._nodes("vtkMRMLScalarVolumeNode")
        self.plan = self._nodes("vtkMRMLMarkupsLineNode")
        folders = ctk.ctkPathLineEdit.Dirs  # with files among them, its button would offer no folder
        self.sides = [self._path(folders), self._path(folders)]
        self.output = self._path(folders)
        self.program = self._path(ctk.ctkPathLineEdit.Files | ctk.ctkPathLineEdit.Executable)
        self.program.currentPath = slicer.app.userSettings().value(PROGRAM, "endoct")
        self.sides[0].toolTip = "A recording, a panorama, or one side of a comparison as FOLDER:SIDE."
        self.plan.setToolTip("The planned bore, from its entry to its target.")
        self.output.toolTip = "A new folder, or one in which a new one is made."
        for label, widget in (
            ("CT from before drilling:", self.ct), ("Plan:", self.plan), ("Side:", self.sides[0]),
            ("Other side, if any:", self.sides[1]), ("Results into:", self.output), ("Program endoct:", self.program),
        ):  # fmt: skip
            form.addRow(label, widget)
        self.runButton, self.cancelButton = qt.QPushButton("Find the pose"), qt.QPushButton("Cancel")
        self.cancelButton.enabled = False
        self.status = qt.QLabel("")
        self.status.wordWrap = True
        for widget in (self.runButton, self.cancelButton, self.status):
            form.addRow(widget)
        self.layout.addLayout(form)
        self.layout.addStretch(1)
        self.runButton.clicked.connect(self.onRun)
        self.cancelButton.clicked.connect(self.onCancel)

    def _nodes(self, kind):
        selector = slicer.qMRMLNodeComboBox()
        selector.nodeTypes = [kind]
        selector.addEnabled = selector.removeEnabled = selector.noneEnabled = False
        selector.setMRMLScene(slicer.mrmlScene)
        return selector

    def _path(self, filters):
        path = ctk.ctkPathLineEdit()
        path.filters = filters
        return path

    def onRun(self):
        """Save CT and plan, and start endoct on them; Slicer stays alive."""
        slicer.app.userSettings().setValue(PROGRAM, self.program.currentPath)
        try:
            self.output_folder = self.logic.place(self.output.currentPath)
            self.saved = slicer.util.tempDirectory()
            ct, plan = self.logic.save(self.ct.currentNode(), self.plan.currentNode(), self.saved)
            sides = [side.currentPath for side in self.sides if side.currentPath]
            program, *arguments = self.logic.command(self.program.currentPath, sides, ct, plan, self.output_folder)
        except ValueError as error:
            self._set_busy(False, str(error))
            return
        self.process = qt.QProcess()
        environment = qt.QProcessEnvironment()  # that of Slicer names its own Python
        for name, value in slicer.util.startupEnvironment().items():
            environment.insert(name, value)
        self.process.setProcessEnvironment(environment)
        self.process.finished.connect(self.onFinished)
        self.process.errorOccurred.connect(self.onError)
        self._set_busy(True, "endoct is looking for the bore, which takes one to five minutes.")
        self.process.start(program, arguments)

    def onCancel(self):
        """Stop endoct, which leaves nothing half-written."""
        process = self.process
        process.terminate()
        qt.QTimer.singleShot(KILLED_AFTER_MS, process.kill)

    def onFinished(self, status, how=None):
        """Load what was written, or say in one line why there is nothing."""
        crashed = how == qt.QProcess.CrashExit
        said = self._text(self.process.readAllStandardOutput())
        failed = self._text(self.process.readAllStandardError()).splitlines()
        if not crashed and status in (DONE, UNTOLD):
            self._set_busy(False, said)
            if status == DONE:
                self.logic.load(self.output_folder)
        else:
            self._set_busy(False, failed[-1] if failed and not crashed else "endoct was stopped")

    def onError(self, error):
        """Say that endoct cannot be started; what ends otherwise is finished, too."""
        if error == qt.QProcess.FailedToStart:
            self._set_busy(False, f"{self.program.currentPath} cannot be started: choose where endoct is installed")

    def cleanup(self):
        """Leave no process behind."""
        if self.process is not None:
            self.process.finished.disconnect(self.onFinished)
            self.process.terminate()
            self._set_busy(False, "")

    def _set_busy(self, busy, said):
        self.runButton.enabled, self.cancelButton.enabled, self.status.text = not busy, busy, said
        if not busy and self.saved:  # nobody needs a second copy of a patient's CT
            shutil.rmtree(self.saved, ignore_errors=True)

    @staticmethod
    def _text(data):
        return data.data().decode("utf-8", "replace").strip()


class EndoctPoseLogic(ScriptedLoadableModuleLogic):
    """What can be done without the form. Raises ``ValueError`` with a line for the user."""

    def save(self, ct, plan, folder):
        """Write the two nodes, as they lie in the world, into ``folder`` and return where.

        They are exported: saved, they would be taken for saved by Slicer, and be gone with the folder.
        """
        paths = []
        for node, name, kind in ((ct, "ct.nrrd", "CT"), (plan, "plan.mrk.json", "plan")):
            if node is None:
                raise ValueError(f"choose a {kind}")
            path = str(Path(folder) / name)
            # left to its default, `properties` keeps the format of the file before
            if not slicer.util.exportNode(node, path, {}, world=True):
                raise ValueError(f"the {kind} cannot be saved as {path}")
            paths.append(path)
        return tuple(paths)

    def place(self, output):
        """Return a folder that does not exist yet: ``output``, or else a new one in it."""
        if not output:
            raise ValueError("choose a folder for the results")
        if not Path(output).exists():
            return output
        return next(str(path) for path in (Path(output) / f"pose-{k}" for k in count(1)) if not path.exists())

    def command(self, program, sides, ct, plan, output):
        """Return the command line."""
        if not sides:
            raise ValueError("choose a recording, a panorama, or one side of a comparison as FOLDER:SIDE")
        return [program or "endoct", "pose", *sides, "--ct", ct, "--plan", plan, "-o", output]

    def load(self, folder):
        """Load mesh, axis and transform of a pose, and return their nodes."""
        return [getattr(slicer.util, load)(str(Path(folder) / name)) for load, name in RESULTS]


class EndoctPoseTest(ScriptedLoadableModuleTest):
    """A test that Slicer runs."""

    def setUp(self):
        """Begin with an empty scene."""
        slicer.mrmlScene.Clear()

    def runTest(self):
        """Run all."""
        self.setUp()
        self.test_command()

    def test_command(self):
        """A form that lacks something says so, and one that does not is a command line."""
        logic = EndoctPoseLogic()
        self.assertRaises(ValueError, logic.command, "endoct", [], "ct.nrrd", "plan.mrk.json", "pose")
        self.assertRaises(ValueError, logic.place, "")
        self.assertRaises(ValueError, logic.save, None, None, "")
        line = logic.command("", ["oct"], "ct.nrrd", "plan.mrk.json", "pose")
        self.assertEqual(line[:3], ["endoct", "pose", "oct"])
