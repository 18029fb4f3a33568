"""The sidecar: what is wrong in it is said in one line."""

from pathlib import Path

import pytest
from pydantic import Field

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition, read_keys, sidecar_path, validate


class Probe(Acquisition):
    """A sidecar with one key of its own."""

    pitch_mm: float = Field(gt=0, description="distance between two turns; sets mm along z")


GOOD = {"modality": "probe", "bore_diameter_mm": 2.5, "pitch_mm": 0.2}


def refused(keys: dict[str, object]) -> str:
    with pytest.raises(EndoctError) as caught:
        validate(Probe, keys, "acquisition.toml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_not_known_is_left_out() -> None:
    probe = validate(Probe, GOOD, "acquisition.toml")
    assert (probe.travel, probe.positions_mm, probe.theta_origin_rad) == ("unknown", None, 0.0)


def test_a_misspelt_key_suggests_the_nearest() -> None:
    said = refused({**GOOD, "bore_diametr_mm": 2.5})
    assert "unknown key 'bore_diametr_mm'" in said
    assert "expected 'bore_diameter_mm'" in said


def test_a_key_like_no_other_lists_all() -> None:
    assert "one of modality, bore_diameter_mm" in refused({**GOOD, "qqqq": 1})


def test_a_missing_key_says_why_it_matters() -> None:
    said = refused({"modality": "probe", "bore_diameter_mm": 2.5})
    assert "lacks 'pitch_mm' (distance between two turns; sets mm along z)" in said
    assert "settings={'pitch_mm': VALUE}" in said


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("bore_diameter_mm", 0, "0.1 to 100 mm"),
        ("bore_diameter_mm", -2.5, "0.1 to 100 mm"),
        ("bore_diameter_mm", float("nan"), "finite"),
        ("bore_diameter_mm", float("inf"), "finite"),
        ("bore_diameter_mm", "wide", "number"),
        ("travel", "backwards", "'in', 'out' or 'unknown'"),
        ("positions_mm", ["a"], "number"),
    ],
)
def test_an_impossible_value_is_named(key: str, value: object, expected: str) -> None:
    said = refused({**GOOD, key: value})
    assert key in said
    assert f"found {value!r}" in said or key == "positions_mm"
    assert expected in said


def test_the_sidecar_of_a_file_lies_beside_it(tmp_path: Path) -> None:
    assert sidecar_path(tmp_path) == tmp_path / "acquisition.toml"
    assert sidecar_path(tmp_path / "pullback.tif") == tmp_path / "acquisition.toml"
    assert read_keys(tmp_path) == {}


def test_a_calibration_file_adds_keys_but_contradicts_none(tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text('calibration = "probe.toml"\nmodality = "probe"\n')
    with pytest.raises(EndoctError, match="cannot be read"):
        read_keys(tmp_path)
    (tmp_path / "probe.toml").write_text("pitch_mm = 0.2\n")
    assert read_keys(tmp_path)["pitch_mm"] == 0.2
    (tmp_path / "probe.toml").write_text('modality = "other"\n')
    with pytest.raises(EndoctError, match="modality stands in both"):
        read_keys(tmp_path)


@pytest.mark.parametrize("content", [b"pitch_mm = \n", b"\xff\xfe\x00", b"pitch_mm = 1\npitch_mm = 2\n"])
def test_broken_toml_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "acquisition.toml").write_bytes(content)
    with pytest.raises(EndoctError, match="is not valid TOML") as caught:
        read_keys(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "bore_diameter_mm = 2,5",
            "found bore_diameter_mm = 2,5 in line 2; write numbers with a point: bore_diameter_mm",
        ),
        ("theta_origin_rad=-0,25 # from the trigger", "write numbers with a point: theta_origin_rad = -0.25"),
    ],
)
def test_a_comma_in_a_number_is_said(line: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text(f'modality = "oct"\n{line}\n')
    with pytest.raises(EndoctError) as caught:
        read_keys(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_faults_keep_their_own_words(tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text("positions_mm = [0,1,2]\ntravel = in\n")
    with pytest.raises(EndoctError, match="not valid TOML") as caught:
        read_keys(tmp_path)
    assert "point" not in str(caught.value)
    assert "write it with a point: 2.5" in refused({**GOOD, "bore_diameter_mm": "2,5"})
