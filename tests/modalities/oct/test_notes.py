"""What the survey notes for the user."""

from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


def test_a_wrong_first_sample_is_noted(unrolled: UnrollPhantom) -> None:
    right = unrolled(Phantom(sidecar={"first_sample_mm": 0.0}))[1]
    wrong = unrolled(Phantom(sidecar={"first_sample_mm": 0.5}))[1]
    assert not any("first_sample_mm" in note for note in right.notes)
    assert any("first_sample_mm" in note for note in wrong.notes)
