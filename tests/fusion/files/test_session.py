"""Session files: what is written is read back, nonsense is refused in one line, and so is another comparison's."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bore_pairs import make_pair
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.fusion.files.session import (
    Identity,
    Note,
    Session,
    check_sides,
    identity_of,
    placed_from,
    read_session,
    session_from,
)
from endoct.fusion.geometry.alignment import LandmarkPair, Place
from endoct.stitching.store import load_panorama, save_panorama

A, B = Identity("endoscope", "a" * 64, "b" * 64), Identity("oct", "c" * 64, "d" * 64)
NOTE = Note("b", Place(6.25, -2.5), "Löcher <b> ≥ 2")
PAIR = LandmarkPair(Place(0.25, 1.5), Place(6.25, 2.5), "check", "rim <b>", 0.02)

places = st.builds(Place, st.floats(0, 2 * math.pi, exclude_max=True), st.floats(-1e4, 1e4))
pairs = st.builds(
    LandmarkPair,
    places,
    places,
    st.sampled_from(["correct", "check"]),
    st.text(max_size=100).filter(lambda text: text.isprintable()),
    st.floats(1e-4, 10),
)


@given(st.lists(pairs, max_size=6), st.integers(0, 2))
def test_what_is_written_is_read_back(placed: list[LandmarkPair], n_notes: int):
    session = Session((A, B), tuple(placed), (NOTE,) * n_notes)
    assert session_from(session.to_bytes(), "here") == session


def test_a_file_is_read(tmp_path: Path):
    path = tmp_path / "session.json"
    path.write_bytes(Session((A, B), (PAIR,)).to_bytes())
    assert read_session(path).pairs == (PAIR,)
    assert read_session(path).sides == (A, B)


def changed(**keys: Any) -> dict[str, Any]:
    """Return a session's object with keys of its first pair changed; a key "top" changes those of the whole."""
    top = keys.pop("top", {})
    stored: dict[str, Any] = Session((A, B), (PAIR,)).to_json()
    return {**stored, "pairs": [{**one, **keys} for one in stored["pairs"]], **top}


@pytest.mark.parametrize(
    ("stored", "said"),
    [
        ([], "is no session file"),
        ("text", "is no session file"),
        ({}, "no 'format'"),
        (changed(top={"format": "endoct-session-2"}), "of another version of endoct"),
        (changed(top={"format": 1}), "is no session file"),
        (changed(top={"sides": []}), "'sides"),
        (changed(top={"sides": [vars(A)]}), "'sides"),
        (changed(top={"pairs": None}), "'pairs'"),
        (changed(top={"pairs": 5}), "'pairs'"),
        (changed(top={"more": 1}), "'more'"),
        (changed(a=None), "'pairs.1.a'"),
        (changed(a={"theta_rad": "1", "z_mm": 0.0}), "'pairs.1.a.theta_rad'"),
        (changed(a={"theta_rad": True, "z_mm": 0.0}), "'pairs.1.a.theta_rad'"),
        (changed(a={"theta_rad": -0.1, "z_mm": 0.0}), "greater than or equal to 0"),
        (changed(a={"theta_rad": 6.2832, "z_mm": 0.0}), "less than 6.28"),
        (changed(b={"theta_rad": float("nan"), "z_mm": 0.0}), "'pairs.1.b.theta_rad'"),
        (changed(b={"theta_rad": 0.0, "z_mm": float("inf")}), "'pairs.1.b.z_mm'"),
        (changed(b={"theta_rad": 0.0, "z_mm": 1e5}), "'pairs.1.b.z_mm'"),
        (changed(b={"theta_rad": 0.0}), "'pairs.1.b.z_mm'"),
        (changed(role="guess"), "'correct' or 'check'"),
        (changed(name=5), "'pairs.1.name'"),
        (changed(name="x" * 101), "'pairs.1.name'"),
        (changed(sigma_mm=0.0), "'pairs.1.sigma_mm'"),
        (changed(weight=1.0), "'pairs.1.weight'"),
        (changed(top={"sides": [{**vars(A), "recording": "short"}, vars(B)]}), "'sides.1.recording'"),
    ],
)
def test_nonsense_is_refused_in_one_line(stored: Any, said: str):
    with pytest.raises(EndoctError) as refused:
        session_from(json.dumps(stored).encode(), "session.json")
    assert said in str(refused.value)
    assert "session.json" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("data", [b"", b"\xff\xfe", b"{", b"[" * 100_000, b'{"format": "endoct-session-1"}'])
def test_what_is_no_json_is_refused(data: bytes):
    with pytest.raises(EndoctError, match="here"):
        session_from(data, "here")


def test_pairs_and_notes_by_themselves_are_checked_alike():
    stored = Session((A, B), (PAIR,), (NOTE,)).to_json()
    assert placed_from({"pairs": stored["pairs"]}, "here") == ((PAIR,), ())
    assert placed_from({"pairs": [], "notes": stored["notes"]}, "here") == ((), (NOTE,))
    for wrong in ({}, {"pairs": [5]}, stored):
        with pytest.raises(EndoctError, match="here"):
            placed_from(wrong, "here")


def test_a_session_without_notes_is_one_for_older_versions():
    assert "notes" not in Session((A, B), (PAIR,)).to_json()


@pytest.mark.parametrize(
    "wrong",
    [
        {"text": ""}, {"text": "  "}, {"text": "a\nb"}, {"text": "a\u202eb"}, {"text": "x" * 201}, {"text": 5},
        {"text": "\ud800"}, {"side": "c"}, {"place": {"theta_rad": 6.2832, "z_mm": 0.0}}, {"name": "more"},
    ],
)  # fmt: skip
def test_a_note_that_is_none_is_refused_in_one_line(wrong: dict[str, Any]):
    good = {"side": "a", "place": {"theta_rad": 0.0, "z_mm": 0.0}, "text": "x" * 200}
    assert placed_from({"pairs": [], "notes": [good]}, "here")[1][0].text == "x" * 200
    with pytest.raises(EndoctError, match=r"notes\.1\.") as refused:
        placed_from({"pairs": [], "notes": [{**good, **wrong}]}, "here")
    assert "\n" not in str(refused.value)


def test_too_many_pairs_and_too_large_a_file_are_refused(tmp_path: Path):
    with pytest.raises(EndoctError, match="at most 1000"):
        session_from(Session((A, B), (PAIR,) * 1001).to_bytes(), "here")
    path = tmp_path / "session.json"
    path.write_bytes(b" " * 1_000_001)
    with pytest.raises(EndoctError, match="too large"):
        read_session(path)


def test_a_session_of_another_comparison_is_refused_with_the_reason():
    session = Session((A, B))
    check_sides(session, (A, B), "here")
    for sides, said in (
        ((B, A), "name endoscope first"),
        ((replace(A, name="oct-1"), replace(B, name="oct-2")), "sides oct-1 and oct-2"),
        ((A, replace(B, recording="e" * 64)), "another recording of oct"),
        ((replace(A, read_as="e" * 64), B), "endoscope read by another sidecar"),
    ):
        with pytest.raises(EndoctError, match=said):
            check_sides(session, sides, "here")


def test_a_side_is_known_by_its_recording_and_how_it_was_read():
    panorama = make_pair().b
    by_samples = identity_of("oct", panorama)
    turned = replace(panorama, intensity=panorama.intensity[::-1])
    assert identity_of("oct", turned) != by_samples
    recorded = {"inputs": {"x/pullback.tif": "1" * 64, "x/acquisition.toml": "2" * 64}, "acquisition": {"travel": "in"}}
    one = identity_of("oct", replace(panorama, provenance=recorded))
    # the recording elsewhere, with a comment in its sidecar
    moved = {**recorded, "inputs": {"y/pullback.tif": "1" * 64, "y/acquisition.toml": "3" * 64}}
    assert identity_of("oct", replace(panorama, provenance=moved)) == one
    other = identity_of("oct", replace(panorama, provenance={**recorded, "acquisition": {"travel": "out"}}))
    assert (other.recording, other.read_as == one.read_as) == (one.recording, False)


def test_a_stored_panorama_is_the_same_side(tmp_path: Path):
    panorama = make_pair().b
    save_panorama(panorama, tmp_path / "oct.zarr")
    assert identity_of("oct", load_panorama(tmp_path / "oct.zarr")) == identity_of("oct", panorama)
