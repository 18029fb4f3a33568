"""What goes with a set: Croissant that validates, a data card, licence and citation."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imagecodecs import imread
from published_sets import TASKS, entry

from endoct.base.files.files import sha256_of
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.workbench.bench.published.card import walls_of_kinds
from endoct.workbench.bench.published.deposit import write_deposit
from endoct.workbench.bench.published.specimen_set import SET_FILE, SpecimenSet, check_specimen, read_set
from endoct.workbench.pipeline.truth import load_truth

RESPONSIBLE = (
    "dataCollection",
    "dataCollectionType",
    "dataPreprocessingProtocol",
    "dataAnnotationProtocol",
    "dataBiases",
    "dataLimitations",
    "dataUseCases",
    "dataSocialImpact",
    "personalSensitiveInformation",
    "dataReleaseMaintenancePlan",
)
DEPOSITED = {"README.md", "LICENSE", "CITATION.cff", "deposit.md", "croissant.json", "specimens.csv", "examples.png"}


@pytest.fixture
def deposited(changed_set: Path) -> tuple[Path, SpecimenSet]:
    listed = read_set(changed_set)
    write_deposit(changed_set, listed)
    return changed_set, listed


def test_nothing_of_a_deposit_is_part_of_a_digest(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, listed = deposited
    assert {path.name for path in folder.iterdir() if path.is_file()} == {SET_FILE, *DEPOSITED}
    for each in listed.specimens:
        check_specimen(folder, each)
    before = {name: (folder / name).read_bytes() for name in DEPOSITED}
    write_deposit(folder, listed)
    assert {name: (folder / name).read_bytes() for name in DEPOSITED} == before
    (folder / "README.md").write_text("a card of my own", encoding="utf-8")
    write_deposit(folder, listed)
    assert (folder / "README.md").read_bytes() == before["README.md"]
    (kept,) = folder.glob("README.md.kept*")
    assert kept.read_text(encoding="utf-8") == "a card of my own"


def test_the_texts_name_set_licence_and_digest(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, listed = deposited
    card = (folder / "README.md").read_text(encoding="utf-8")
    assert card.startswith("---\nlicense: cc-by-4.0\n")
    assert listed.digest in card
    assert "| simulator | easy | segmentation stitching oct alignment depth wall | 1 |" in card
    assert "CC-BY-4.0" in (folder / "LICENSE").read_text(encoding="utf-8")
    assert "creativecommons.org/licenses/by/4.0/legalcode" in (folder / "LICENSE").read_text(encoding="utf-8")
    for name in ("README.md", "LICENSE", "CITATION.cff", "deposit.md"):
        assert "$" not in (folder / name).read_text(encoding="utf-8")


def test_the_card_shows_what_walls_are_like(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, listed = deposited
    name = listed.specimens[0].name
    cell = load_truth(folder / name).wall["cell"]
    assert np.array_equal(imread(folder / "masks" / f"{name}.png") == 255, cell)
    (line,) = [line for line in (folder / "README.md").read_text(encoding="utf-8").splitlines() if "| easy |" in line]
    cells, share, depth_mm = (float(part.split()[0]) for part in line.split("|")[-4:-1])
    assert share == pytest.approx(100 * cell.mean(), abs=0.05)
    assert 1 <= cells < 200
    assert 0.1 < depth_mm < 1.0
    thirds = np.array_split(imread(folder / "examples.png")[20:-5, 30:-5, :3], 3, axis=1)
    assert all(part.std() > 20 for part in thirds)  # nothing is blank


def test_a_table_has_medians_over_the_specimens_of_a_kind(tmp_path: Path) -> None:
    for k, rows in enumerate((1, 3, 2)):
        cell = np.zeros((10, 20), np.bool_)
        cell[:rows, [0, -1]] = True  # one cell, across the seam of θ, and another of one sample
        cell[6, 0] = True
        wall = {"cell": cell, "relief_mm": np.where(cell, 0.1 * (k + 1), 0.0).astype(np.float32)}
        names = {name: Named(("z", "theta"), values) for name, values in wall.items()}
        places = {"z": np.arange(10.0), "theta": np.arange(20.0)}
        names |= {name: Named((name,), values) for name, values in places.items()}
        write_arrays(tmp_path / f"simulator-easy-{k:03d}" / "truth" / "wall.zarr", names, {})
        (tmp_path / f"simulator-easy-{k:03d}" / "truth" / "recording.json").write_text("{}")
    entries = [entry(f"simulator-easy-{k:03d}") for k in range(3)]
    listed = SpecimenSet(set="a set", half="public", size="small", key="", versions={}, specimens=tuple(entries))
    line = walls_of_kinds(tmp_path, listed)
    tasks = " ".join(TASKS)
    assert line == f"| simulator | easy | {tasks} | 3 | 2 (2–2) | 2.5 (1.5–3.5) | 0.20 (0.10–0.30) |"


def test_croissant_states_what_is_there(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, _ = deposited
    content = json.loads((folder / "croissant.json").read_text(encoding="utf-8"))
    tables = [part for part in content["distribution"] if part["@type"] == "cr:FileObject"]
    for file in tables:
        assert file["sha256"] == sha256_of(folder / file["contentUrl"])
    filled = {part["@id"] for part in content["distribution"] if part not in tables and any(_files(folder, part))}
    assert filled == {"endoscope-frames", "pullbacks", "true-masks", "panoramas", "true-walls"}  # and no CT in this one
    assert {f"rai:{name}" for name in RESPONSIBLE} <= set(content)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of rdflib, which mlcroissant uses
def test_mlcroissant_validates_and_reads_it(deposited: tuple[Path, SpecimenSet]) -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    folder, listed = deposited
    dataset = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
    assert not dataset.metadata.issues.errors
    assert not dataset.metadata.issues.warnings
    names = [record["specimens/name"].decode() for record in dataset.records("specimens")]
    assert names == [each.name for each in listed.specimens]
    for records, files in (("frames", "*/endoscope/*.png"), ("masks", "masks/*.png")):
        held = [*dataset.records(records)]
        assert len(held) == len([*folder.glob(files)])
        assert {record[f"{records}/specimen"].decode() for record in held} == {*names}
        sizes = sorted(np.asarray(record[f"{records}/image"]).shape[:2] for record in held)  # this closes the files
        assert sizes == sorted(imread(path).shape[:2] for path in folder.glob(files))


def _files(folder: Path, part: dict[str, Any]) -> Iterator[Path]:
    includes = part["includes"]
    for pattern in [includes] if isinstance(includes, str) else includes:
        yield from folder.glob(pattern)
