"""What can be done about a comparison, by its causes."""

from typing import Any

import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.result import Result
from endoct.stitching.panorama import TRAVEL_BY_DEFAULT
from endoct.workbench.report.next_steps import NextStep, next_steps

IN_PLACE: dict[str, Any] = {
    "theta_shift_rad": 0.0, "z_shift_mm": 0.0, "z_scale": 1.0, "confidence": 0.5,
    "mirrored": False, "z_reversed": False,
}  # fmt: skip
STATED = {
    "endoscope": {"acquisition": {"travel": "in", "bore_diameter_mm": 2.5, "feed_pitch_mm": 0.2}},
    "oct": {"acquisition": {"travel": "out", "bore_diameter_mm": 2.5, "handedness": "same"}},
}
ASKED = {"a": "bore/endoscope", "b": "bore/oct"}


def result(*doubts: Doubt, aligned: bool = True, **said: Any) -> Result:
    scores = {"jaccard": 0.7, "dice": 0.8} if aligned else {"jaccard": None, "dice": None, "reason": "Nothing."}
    return Result.model_validate(
        {"sides": ["endoscope", "oct"], "aligned": aligned, "alignment": IN_PLACE if aligned else None, **scores}
        | {"valid_fraction": 1.0, "doubts": [doubt.to_json() for doubt in doubts], "asked": ASKED}
        | said
    )


def settings(step: NextStep) -> tuple[tuple[str, ...], ...]:
    return step.settings, step.settings_a, step.settings_b


def turned(*, mirrored: bool, z_reversed: bool, stated: Any = None) -> list[tuple[tuple[str, ...], ...]]:
    found = result(aligned=False, best_ruled_out=IN_PLACE | {"mirrored": mirrored, "z_reversed": z_reversed})
    return [settings(step) for step in next_steps(found, stated or STATED) if step.does == "compare"]


def test_a_trusted_result_needs_no_step():
    assert next_steps(result(), STATED) == ()


def test_a_side_that_would_fit_mirrored_is_tried_with_the_other_handedness():
    assert turned(mirrored=True, z_reversed=False) == [((), (), ("handedness=mirrored",))]


def test_a_side_that_would_fit_reversed_is_tried_with_the_other_travel_of_either():
    assert turned(mirrored=False, z_reversed=True) == [((), ("travel=out",), ()), ((), (), ("travel=in",))]


def test_a_travel_by_default_is_the_first_to_suspect():
    stated = STATED | {"oct": STATED["oct"] | {TRAVEL_BY_DEFAULT: "out"}}
    assert turned(mirrored=False, z_reversed=True, stated=stated)[0] == ((), (), ("travel=in",))


def test_an_unusual_travel_is_suspected_before_a_usual_one():
    stated = {side: {"acquisition": {"modality": side, "travel": "in"}} for side in STATED}
    assert turned(mirrored=False, z_reversed=True, stated=stated)[0] == (
        (),
        (),
        ("travel=out",),
    )  # catheters are pulled


def test_a_recording_from_the_other_end_needs_both():
    assert turned(mirrored=True, z_reversed=True)[1] == ((), (), ("travel=in", "handedness=mirrored"))


def test_what_nobody_states_is_not_turned():
    assert turned(mirrored=True, z_reversed=True, stated={"endoscope": STATED["endoscope"], "oct": {}}) == []


def test_a_length_that_would_agree_is_tried():
    remedies = [{"side": "oct", "key": "pullback_pitch_mm", "agreeing": 0.40009}]
    first, *others = next_steps(result(aligned=False, remedies=remedies), STATED)
    assert settings(first) == ((), (), ("pullback_pitch_mm=0.4001",))
    assert [step.does for step in others] == ["read", "read", "landmarks"]


def test_where_nothing_is_suspected_it_may_be_another_bore():
    found = result(aligned=False)
    other, *steps = next_steps(found, STATED)
    assert other.request(found) == {"a": "bore/endoscope", "b": ""}
    assert other.to_json(found)["recording"] == "bore/oct"
    assert [(step.does, step.side) for step in steps] == [("read", "endoscope"), ("read", "oct"), ("landmarks", "")]


def test_a_key_that_the_recording_contradicts_is_set():
    doubt = Doubt("feed-against-nominal", "Far.", "endoscope", 0.40891, "mm", 0.2, key="feed_pitch_mm")
    (step,) = next_steps(result(doubt), STATED)
    assert settings(step) == ((), ("feed_pitch_mm=0.4089",), ())


def test_the_diameter_of_the_bore_is_set_on_both_sides():
    doubt = Doubt("wall-far-from-nominal", "Far.", "oct", 2.6, "mm", 2.5, key="bore_diameter_mm")
    first, look = next_steps(result(doubt), STATED)
    assert settings(first) == ((), ("bore_diameter_mm=2.6",), ("bore_diameter_mm=2.6",))
    assert (look.does, look.side) == ("describe", "oct")


def test_what_lies_out_of_place_is_shown_where_it_lies():
    doubt = Doubt("parts-out-of-place", "Off.", "oct", 0.3, "mm", (0.0, 0.1), z_mm=(2.0, 5.0))
    show, read, landmarks = next_steps(result(doubt), STATED)
    assert (show.does, show.z_mm) == ("show", 3.5)
    assert (read.does, read.side, landmarks.does) == ("read", "oct", "landmarks")


@pytest.mark.parametrize(
    ("code", "does"),
    [
        ("cells-unsure", ["draw", "draw"]), ("aligned-by-rims", ["landmarks"]), ("few-cells-decide", ["nothing"]),
        ("compared-with-itself", ["other"]), ("rims-eccentric", ["nothing"]), ("ascans-against-rate", ["nothing"]),
    ],
)  # fmt: skip
def test_a_doubt_leads_to_what_helps_against_it(code: str, does: list[str]):
    assert [step.does for step in next_steps(result(Doubt(code, "Odd.")), STATED)] == does


def test_a_side_is_looked_at_where_its_description_is_doubted():
    (step,) = next_steps(result(Doubt("rims-eccentric", "Odd.", "endoscope")), STATED)
    assert (step.does, step.side) == ("describe", "endoscope")


def test_a_step_is_offered_once():
    doubts = Doubt("little-observed", "Little.", "oct"), Doubt("nearest-wall-lost", "Lost.", "oct")
    assert [step.side for step in next_steps(result(*doubts), STATED)] == ["oct"]


def test_a_setting_that_is_doubted_is_taken_back_and_the_others_stay():
    found = result(Doubt("forced", "Forced."), asked=ASKED | {"settings": ["force=true", "n_theta=512"]})
    (step,) = next_steps(found, STATED)
    assert step.request(found) == ASKED | {"settings": ("n_theta=512", "force=false")}
    assert (
        step.command(found, "x")
        == "endoct compare bore/endoscope bore/oct --output=x --set=n_theta=512 --set=force=false"
    )


def test_pairs_that_only_check_are_asked_for_until_there_are_some():
    doubt = Doubt("corrected-by-hand", "By hand.")
    assert [step.does for step in next_steps(result(doubt), STATED)] == ["landmarks"]


def test_a_side_that_contradicts_its_handedness_is_compared_with_the_other():
    (step,) = next_steps(result(Doubt("handedness-contradicted", "Mirrored.")), STATED)
    assert settings(step) == ((), (), ("handedness=mirrored",))


def test_a_direction_that_rests_on_a_default_can_be_turned():
    stated = {
        "endoscope": {"acquisition": {"travel": "unknown"}},
        "oct": {"acquisition": {"travel": "out"}, TRAVEL_BY_DEFAULT: "out"},
    }
    (step,) = next_steps(result(), stated)
    assert settings(step) == ((), (), ("travel=in",))
    assert next_steps(result(), stated | {"endoscope": STATED["endoscope"]}) == ()  # which states its own


def test_a_command_keeps_what_was_asked_for_and_is_one_for_a_shell():
    asked = {
        "a": "my bore/e",
        "b": "o",
        "truth": ["m 1.png", "m2.png"],
        "settings_b": ["handedness=same", "seed=3"],
        "modality_a": "x",
    }
    found = result(aligned=False, best_ruled_out=IN_PLACE | {"mirrored": True}, asked=asked)
    assert next_steps(found, STATED)[0].command(found, "again") == (
        "endoct compare 'my bore/e' o --output=again --truth 'm 1.png' m2.png "
        "--set-b=seed=3 --set-b=handedness=mirrored --modality-a=x"
    )


def test_there_is_no_command_for_what_was_unrolled_already_or_was_not_written_down():
    said = {"aligned": False, "best_ruled_out": IN_PLACE | {"mirrored": True}}
    for asked in (ASKED | {"b": "bore/oct.zarr"}, {}):
        found = result(**said, asked=asked)
        assert next_steps(found, STATED)[0].command(found, "again") == ""
