"""A modality in a package of its own: installed beside endoct, found, conforming, and compared."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from made_once import MadeOnce
from tolerances import ALIGNMENT_THETA_RAD, ALIGNMENT_Z_MM

from endoct.modalities import registry
from endoct.modalities.conformance import CHECKS, Check, Subject
from endoct.modalities.recognition import recognise

PACKAGE = Path(__file__).parent / "endoct-profilometer"
RADIUS_MM, PITCH_MM, N_THETA = 1.25, 0.1, 720


@pytest.fixture(scope="module")
def installed(made_once: MadeOnce, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package into a folder of its own, with nothing fetched."""
    source = tmp_path_factory.mktemp("source") / "package"
    shutil.copytree(PACKAGE, source)  # pip builds inside the source folder

    def install(target: Path) -> None:
        options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target", str(target)]
        subprocess.run([sys.executable, "-m", "pip", "install", *options, str(source)], check=True)

    return made_once("site", install)


@pytest.fixture(scope="module")
def walls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two recordings of one bore with pits; the second is turned by 90° and starts 1 mm farther in."""
    rng = np.random.default_rng(7)
    z_mm, theta_rad = PITCH_MM * np.arange(120), 2 * np.pi / N_THETA * np.arange(N_THETA)
    radius_mm = np.full((z_mm.size, N_THETA), RADIUS_MM)
    for z, theta, size in zip(
        rng.uniform(0, z_mm[-1], 40), rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.15, 0.6, 40), strict=True
    ):
        across = RADIUS_MM * (np.mod(theta_rad - theta + np.pi, 2 * np.pi) - np.pi)
        radius_mm += np.where(np.hypot((z_mm - z)[:, np.newaxis], across) < size, 0.5, 0.0)
    folder = tmp_path_factory.mktemp("walls")
    whole, turned = folder / "whole", folder / "turned"
    _record(whole, radius_mm[:100] + rng.normal(0, 0.005, (100, N_THETA)))
    _record(turned, np.roll(radius_mm, N_THETA // 4, axis=1)[10:110] + rng.normal(0, 0.005, (100, N_THETA)))
    return whole, turned


def _record(folder: Path, radius_mm: np.ndarray, diameter_mm: float = 2 * RADIUS_MM) -> None:
    folder.mkdir()
    sidecar = f'modality = "profilometer"\nbore_diameter_mm = {diameter_mm}\npitch_mm = {PITCH_MM}\n'
    (folder / "acquisition.toml").write_text(sidecar + 'handedness = "same"\ntravel = "in"\n', encoding="utf-8")
    for index, turn in enumerate(radius_mm):
        lines = ["" if lost else f"{r:.5f}" for lost, r in zip(np.arange(turn.size) % 97 == 5, turn, strict=True)]
        text = "radius_mm,brightness\n" + "".join(f"{r},{1.2 - 0.3 * float(r or 4):.4f}\n" for r in lines)
        (folder / f"turn_{index:04d}.csv").write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def registered(installed: Path) -> Iterator[None]:
    """Make this process find the installed package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(installed))
        registry.manifests.cache_clear()
        yield
    registry.manifests.cache_clear()
    for name in [name for name in sys.modules if name.startswith("endoct_profilometer")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def subject(registered: None, walls: tuple[Path, Path]) -> Subject:
    return Subject(importlib.import_module("endoct_profilometer.manifest").MANIFEST, walls[0])


def _endoct(installed: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from endoct.workbench.cli import main; main()", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_conforms(check: Check, subject: Subject) -> None:
    check(subject)


@pytest.mark.usefixtures("registered")
def test_it_claims_its_recording_without_being_named(walls: tuple[Path, Path], tmp_path: Path) -> None:
    for turn in sorted(walls[0].glob("*.csv"))[:3]:
        (tmp_path / turn.name).write_bytes(turn.read_bytes())
    assert recognise(tmp_path).manifest.name == "profilometer"


def test_it_is_listed(installed: Path) -> None:
    run = _endoct(installed, "modalities", "--json")
    assert run.returncode == 0, run.stderr
    assert {"oct", "endoscope", "profilometer"} <= {row["name"] for row in json.loads(run.stdout)}


def test_two_of_its_recordings_are_compared(installed: Path, walls: tuple[Path, Path], tmp_path: Path) -> None:
    words = ("-o", str(tmp_path / "out"), "--set", "n_theta=512", "--json")
    run = _endoct(installed, "compare", *map(str, walls), *words)
    assert run.returncode == 0, run.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert result["sides"] == ["profilometer-1", "profilometer-2"]
    assert result["aligned"] is True
    alignment = result["alignment"]
    turn_rad = np.mod(alignment["theta_shift_rad"] + np.pi / 2 + np.pi, 2 * np.pi) - np.pi
    assert abs(turn_rad) < ALIGNMENT_THETA_RAD
    assert abs(alignment["z_shift_mm"] - 1.0) < ALIGNMENT_Z_MM
    assert not alignment["mirrored"]
    assert not alignment["z_reversed"]
    assert result["jaccard"] > 0.9
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_it_is_compared_with_an_oct_recording(installed: Path, quick_specimen: Path, tmp_path: Path) -> None:
    with xr.open_zarr(quick_specimen / "truth" / "wall.zarr") as truth:
        diameter_mm = 2 * truth.attrs["bore_radius_mm"]
        every = round(PITCH_MM / float(truth["z"][1] - truth["z"][0]))
        _record(tmp_path / "wall", diameter_mm / 2 + truth["relief_mm"].values[::every, ::2], diameter_mm)
    sides = tmp_path / "wall", quick_specimen / "oct"
    run = _endoct(installed, "compare", *map(str, sides), "-o", str(tmp_path / "out"), "--set", "n_theta=512")
    assert run.returncode == 0, run.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert result["sides"] == ["profilometer", "oct"]
    assert result["aligned"] is True
    assert result["alignment"]["correlation"] > 0.8
