"""What goes with a set: Croissant that validates, a data card, licence and citation."""

import json
from pathlib import Path

import pytest

from endoct.base.files.files import sha256_of
from endoct.workbench.bench.published.deposit import write_deposit
from endoct.workbench.bench.published.specimen_set import SET_FILE, SpecimenSet, check_specimen, read_set

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
DEPOSITED = {"README.md", "LICENSE", "CITATION.cff", "deposit.md", "croissant.json", "specimens.csv"}


@pytest.fixture
def deposited(changed_set: Path) -> tuple[Path, SpecimenSet]:
    listed = read_set(changed_set)
    write_deposit(changed_set, listed)
    return changed_set, listed


def test_nothing_of_a_deposit_is_part_of_a_digest(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, listed = deposited
    assert {path.name for path in folder.iterdir() if path.is_file()} == {SET_FILE, *DEPOSITED}
    for entry in listed.specimens:
        check_specimen(folder, entry)
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


def test_croissant_states_what_is_there(deposited: tuple[Path, SpecimenSet]) -> None:
    folder, _ = deposited
    content = json.loads((folder / "croissant.json").read_text(encoding="utf-8"))
    for file in content["distribution"]:
        assert file["sha256"] == sha256_of(folder / file["contentUrl"])
    assert {f"rai:{name}" for name in RESPONSIBLE} <= set(content)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of rdflib, which mlcroissant uses
def test_mlcroissant_validates_and_reads_it(deposited: tuple[Path, SpecimenSet]) -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    folder, listed = deposited
    dataset = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
    assert not dataset.metadata.issues.errors
    assert not dataset.metadata.issues.warnings
    names = [record["specimens/name"].decode() for record in dataset.records("specimens")]
    assert names == [entry.name for entry in listed.specimens]
