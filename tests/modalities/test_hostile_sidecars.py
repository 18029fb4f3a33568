"""Damaged and hostile sidecars, settings and plug-ins end in one line, and every number has bounds on both sides."""

import os
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from endoct.base.errors import EndoctError
from endoct.fusion.parameters import CompareParameters
from endoct.modalities import registry
from endoct.modalities.acquisition import read_keys, validate
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters

OCT = {
    "modality": "oct",
    "axial_pixel_mm": 0.005,
    "pullback_pitch_mm": 0.2,
    "bore_diameter_mm": 2.5,
    "capillary_outer_diameter_mm": 1.7,
}
ENDOSCOPE = {"modality": "endoscope", "bore_diameter_mm": 2.5}


def said_of(model: type[BaseModel], keys: dict[str, Any]) -> str:
    with pytest.raises(EndoctError) as caught:
        validate(model, keys, "acquisition.toml")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000
    return str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("axial_pixel_mm", 1e-9, "0.0001 to 0.2 mm"),
        ("axial_pixel_mm", 0.5, "0.0001 to 0.2 mm"),
        ("pullback_pitch_mm", 1e6, "0.0001 to 10 mm"),
        ("bore_diameter_mm", 1e300, "0.1 to 100 mm"),
        ("capillary_outer_diameter_mm", 1e-3, "0.05 to 100 mm"),
        ("db_per_count", 1e9, "1e-06 to 100 a count"),
        ("first_sample_mm", -1e9, "-1000 to 1000 mm"),
        ("theta_origin_rad", 1e300, "-1000 to 1000 rad"),
        ("positions_mm", [0.0, 1e9], "-10000 to 10000 mm"),
        ("positions_mm", [0.0] * 1_000_001, "1000000"),
        ("bore_diameter_mm", True, "a valid number"),
        ("bore_diameter_mm", "2.5", "a valid number"),
        ("bore_diameter_mm", 10**4000, "a valid number"),
        ("bore_diameter_mm", {"a": {"b": 1}}, "a valid number"),
        ("bore_diameter_mm", [2.5], "a valid number"),
        ("positions_mm", [True, False], "a valid number"),
        ("travel", 10**4000, "'in'"),
        ("x" * 100_000, 1, "one of"),
    ],
)
def test_oct_keys_are_bounded(key: str, value: object, expected: str) -> None:
    assert expected in said_of(OctAcquisition, {**OCT, key: value})


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"feed_pitch_mm": 1e6}, "0.0001 to 10 mm"),
        ({"frame_rate_hz": 1e9}, "0.01 to 100000 Hz"),
        ({"feed_speed_mm_s": 1e9}, "0.0001 to 1000 mm/s"),
        ({"feed_speed_mm_s": 1000, "frame_rate_hz": 0.01}, "must lie within 0.0001 to 10 mm"),
        ({"visible_length_mm": 1e-9}, "0.01 to 100 mm"),
        ({"focal_px": 1e9}, "1 to 1e+06 px"),
        ({"mirror_distance_mm": 1e9}, "0.01 to 1000 mm"),
        ({"distortion": [1e9]}, "-100 to 100"),
        ({"distortion": [False]}, "a valid number"),
        ({"cone_half_angle_deg": 1e-9}, "1 to 89 degrees"),
        ({"annulus": {"x": 1e9, "y": 0, "inner_px": 1, "outer_px": 2}}, "-100000 to 100000"),
        ({"annulus": {"x": True, "y": 0, "inner_px": 1, "outer_px": 2}}, "'annulus.x'"),
        ({"annulus": 3}, "AnnulusKeys"),
    ],
)
def test_endoscope_keys_are_bounded(keys: dict[str, object], expected: str) -> None:
    assert expected in said_of(EndoscopeAcquisition, {**ENDOSCOPE, **keys})


@pytest.mark.parametrize(
    "model",
    [OctAcquisition, EndoscopeAcquisition, OctParameters, EndoscopeParameters, CompareParameters],
    ids=lambda model: model.__name__,
)
def test_every_number_has_bounds_on_both_sides(model: type[BaseModel]) -> None:
    schema = model.model_json_schema()
    fields = dict(schema["properties"])
    for part in schema.get("$defs", {}).values():
        fields |= part.get("properties", {})
    for name, field in fields.items():
        for kind in [field, *field.get("anyOf", [])]:
            kind = kind.get("items", kind)
            if kind.get("type") in ("number", "integer"):
                assert {"minimum", "exclusiveMinimum"} & kind.keys(), name
                assert {"maximum", "exclusiveMaximum"} & kind.keys(), name


@pytest.mark.parametrize("name", ["acquisition.toml", "probe.toml"])
def test_a_sidecar_that_is_a_pipe_is_refused_at_once(name: str, tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text('calibration = "probe.toml"\n')
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    with pytest.raises(EndoctError, match="a pipe"):
        read_keys(tmp_path)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/stdin", "/proc/self/mem", ".", "x\\u0000y"])
def test_a_calibration_that_is_no_file_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text(f'calibration = "{name}"\n')
    with pytest.raises(EndoctError) as caught:
        read_keys(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["../probe.toml", "/{}/probe.toml", "a/../../probe.toml"])
def test_a_sidecar_opens_nothing_outside_its_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "probe.toml").write_text("axial_pixel_mm = 0.005\n")
    (tmp_path / "oct").mkdir()
    (tmp_path / "oct" / "acquisition.toml").write_text(f'calibration = "{name.format(tmp_path)}"\n')
    with pytest.raises(EndoctError, match=r"'calibration' in .* names a place outside"):
        read_keys(tmp_path / "oct")


@pytest.mark.parametrize(
    "content",
    [
        "a = " + "[" * 50_000,
        "a = " + "{b = " * 50_000,
        "a = " + "9" * 5000,
        "a." * 20_000 + "b = 1",
        "a = 2026-01-01T99:00:00",
        "#" * 2_000_000,
    ],
    ids=["lists", "tables", "digits", "dots", "date", "size"],
)
def test_toml_that_breaks_its_reader_is_one_line(content: str, tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text(content)
    try:
        keys = read_keys(tmp_path)
    except EndoctError as error:
        said = str(error)
    else:
        said = said_of(OctAcquisition, {**OCT, **keys})
    assert "\n" not in said


@pytest.mark.parametrize(
    "value", ["2026-01-01", "12:00:00", "nan", "inf", "-inf", "{a = 1}", "[[1]]", '""', "0x7fffffffffffffff"]
)
def test_other_kinds_of_values_are_refused(value: str, tmp_path: Path) -> None:
    for key in ("axial_pixel_mm", "positions_mm", "travel"):
        (tmp_path / "acquisition.toml").write_text(f"{key} = {value}\n")
        said_of(OctAcquisition, {**OCT, **read_keys(tmp_path)})


class Broken(EntryPoint):
    def load(self) -> Any:
        raise {"exit": SystemExit(3), "value": ValueError("two\nlines"), "zero": ZeroDivisionError()}[self.value]


@pytest.mark.parametrize("raised", ["exit", "value", "zero"])
def test_a_plug_in_that_raises_on_import_is_named(raised: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda group: [Broken("probe", raised, group)])
    with pytest.raises(EndoctError, match="the modality 'probe' cannot be imported") as caught:
        registry.manifests.__wrapped__()
    assert "\n" not in str(caught.value)
