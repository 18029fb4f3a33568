"""`--device`: refused in one line where there is none, with the same wall where there is one, and nothing for `cpu`."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import torch
from made_once import MadeOnce
from tolerances import ON_DEVICE_LIGHT_REL, ON_DEVICE_WALL_SHARE, SAME_WALL_MM

from endoct.modalities.endoscope.plugin import EndoscopeModality
from endoct.modalities.oct.manifest import MANIFEST
from endoct.modalities.oct.plugin import OCT, OctModality
from endoct.stitching.store import load_panorama
from endoct.synthetic.specimen import simulate
from endoct.workbench import api, cli, compare, unroll
from endoct.workbench.running.scheduler import ALONE

Run = Callable[..., tuple[int, list[str]]]


@pytest.fixture(scope="module")
def specimen(made_once: MadeOnce) -> Path:
    return made_once("with_spectra", lambda folder: simulate(folder, preset="learning", seed=22, spectra=True))


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run one command line; return its status and the lines that it printed to stderr."""

    def run_once(*arguments: object) -> tuple[int, list[str]]:
        monkeypatch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
        with pytest.raises(SystemExit) as leave:
            cli.main()
        return int(leave.value.code or 0), capsys.readouterr().err.splitlines()

    return run_once


@pytest.fixture
def on_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let torch's CPU device stand for a GPU."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for modality in (OctModality, EndoscopeModality):
        monkeypatch.setattr(modality, "on_device", lambda self, _: type(self)("cpu"))


COMMANDS = {
    "unroll": ("unroll", "{oct}"),
    "compare": ("compare", "{endoscope}", "{oct}"),
    "pose": ("pose", "{oct}", "--ct", "{oct}", "--entry=0,0,0", "--target=0,0,9"),
    "plan only": ("pose", "--plan-only", "--ct", "{oct}", "--entry=0,0,0", "--target=0,0,9"),
}


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS.keys())
def test_without_a_device_it_is_one_line_and_nothing_is_written(
    run: Run, specimen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    paths = {"oct": specimen / "oct-spectra", "endoscope": specimen / "endoscope"}
    status, lines = run(*(word.format(**paths) for word in words), "-o", tmp_path / "out", "--device", "cuda")
    assert (status, len(lines)) == (1, 1)
    assert "there is no CUDA device; found cuda; expected cpu; leave out --device cuda" in lines[0]
    assert not list(tmp_path.iterdir())


def test_on_the_cpu_nothing_loads_torch(specimen: Path) -> None:
    code = (
        "import sys; from endoct.workbench import unroll; "
        f"unroll({str(specimen / 'oct-spectra')!r}, progress=False); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_on_a_device_the_wall_of_raw_spectra_is_the_same(
    run: Run, on_torch: None, specimen: Path, tmp_path: Path
) -> None:
    reference = unroll(specimen / "oct-spectra", progress=False)
    status, _ = run("unroll", specimen / "oct-spectra", "-o", tmp_path / "out.zarr", "--device", "cuda")
    assert status == 0
    found = load_panorama(tmp_path / "out.zarr")
    assert reference.depth_mm is not None
    assert found.depth_mm is not None
    np.testing.assert_array_equal(found.valid, reference.valid)
    apart_mm = np.abs(found.depth_mm - reference.depth_mm)[found.valid]
    assert np.mean(apart_mm > SAME_WALL_MM) < ON_DEVICE_WALL_SHARE
    # it was another computation, and says so
    assert apart_mm.max() > 0
    assert found.provenance["device"] == "cuda"
    assert found.provenance["versions"]["torch"] == torch.__version__
    assert "device" not in reference.provenance
    assert "<h3>Device</h3>\n<p>cuda, " in (tmp_path / "out.zarr" / "report.html").read_text(encoding="utf-8")


def test_of_finished_bscans_nothing_changes(on_torch: None, specimen: Path) -> None:
    on_cpu, on_cuda = (unroll(specimen / "oct", device=one, progress=False) for one in ("cpu", "cuda"))
    np.testing.assert_array_equal(on_cuda.intensity, on_cpu.intensity)
    np.testing.assert_array_equal(on_cuda.valid, on_cpu.valid)


def test_a_plug_in_that_computes_nowhere_else_is_used_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(OctModality, "on_device")
    assert MANIFEST.load("cuda") is OCT


def test_two_recordings_are_compared_on_a_device(
    on_torch: None, specimen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api, "scheduler", lambda **_: nullcontext(ALONE))  # where nothing stands for a GPU
    compare(specimen / "oct-spectra", specimen / "endoscope", tmp_path / "out", device="cuda", progress=False)
    oct_, endoscope = (load_panorama(tmp_path / "out" / "panoramas" / f"{n}.zarr") for n in ("oct", "endoscope"))
    assert (oct_.provenance["device"], endoscope.provenance["device"]) == ("cuda", "cuda")
    reference = unroll(specimen / "endoscope", progress=False)
    np.testing.assert_array_equal(endoscope.valid, reference.valid)
    np.testing.assert_allclose(endoscope.intensity, reference.intensity, rtol=ON_DEVICE_LIGHT_REL)
    assert not np.array_equal(endoscope.intensity, reference.intensity)  # it was another computation
