"""KEY=VALUE settings reach the sidecar or the parameters, and nothing else."""

import hashlib
from concurrent.futures import CancelledError
from pathlib import Path

import pytest

from endoct.base.errors import EndoctError
from endoct.base.files.files import LISTED_FILES, digests
from endoct.modalities.acquisition import overridden
from endoct.modalities.registry import manifests
from endoct.workbench.settings import parse, ranges_text, split


def test_values_are_toml_or_else_words() -> None:
    assert parse(("a=1", "b = 0.5", "c=sine", "d=[1, 2]", "e=true", 'f="7"')) == {
        "a": 1,
        "b": 0.5,
        "c": "sine",
        "d": [1, 2],
        "e": True,
        "f": "7",
    }


@pytest.mark.parametrize("setting", ["undistort", "=sine", " =1"])
def test_what_is_no_setting_is_said(setting: str) -> None:
    with pytest.raises(EndoctError, match="KEY=VALUE"):
        parse((setting,))


def test_keys_go_where_they_are_known() -> None:
    overrides, parameters = split({"axial_pixel_mm": 0.004, "undistort": "sine"}, manifests()["oct"])
    assert overrides == {"axial_pixel_mm": 0.004}
    assert parameters.undistort == "sine"


def test_a_key_of_a_table_goes_with_the_sidecars() -> None:
    overrides, _ = split(parse(("spectra.window=flat", "spectra.dispersion_rad=[1, 2]")), manifests()["oct"])
    assert overrides == {"spectra.window": "flat", "spectra.dispersion_rad": [1, 2]}
    assert overridden({"spectra": {"window": "hann", "samples": 96}, "a": 1}, overrides) == {
        "spectra": {"window": "flat", "dispersion_rad": [1, 2], "samples": 96},
        "a": 1,
    }
    assert overridden({}, {"annulus.x": 3}) == {"annulus": {"x": 3}}


def test_a_misspelt_key_is_answered_with_the_nearest_of_both() -> None:
    with pytest.raises(EndoctError, match="'axial_pixel_mm'"):
        split({"axial_pixel": 0.004}, manifests()["oct"])
    with pytest.raises(EndoctError, match="'undistort'"):
        split({"undistrot": "sine"}, manifests()["oct"])


def test_digests_are_those_of_sha256sum(tmp_path: Path) -> None:
    file = tmp_path / "a.bin"
    file.write_bytes(b"abc")
    expected = hashlib.sha256(b"abc").hexdigest()
    assert digests(file) == {str(file): expected}
    assert digests(tmp_path) == {str(file): expected}


def test_digests_are_given_up_once_nobody_needs_them(tmp_path: Path) -> None:
    (tmp_path / "frame.png").write_bytes(b"abc")

    def give_up() -> None:
        raise CancelledError

    with pytest.raises(CancelledError):
        digests(tmp_path, give_up)
    (tmp_path / "more" / "empty").mkdir(parents=True)
    with pytest.raises(CancelledError):  # while a folder is looked through already: it may be somebody's home
        digests(tmp_path / "more", give_up)


def test_many_files_share_one_digest_that_each_of_them_changes(tmp_path: Path) -> None:
    for k in range(LISTED_FILES + 1):
        (tmp_path / f"{k}.bin").write_bytes(bytes([k]))
    before = digests(tmp_path)
    assert list(before) == [str(tmp_path / "*")]
    (tmp_path / "0.bin").write_bytes(b"other")
    assert digests(tmp_path) != before


def test_ranges_are_said_as_a_user_states_them() -> None:
    ranges = {"b.c": (0.5, 2), "a.x": ("step", "helical"), "d.e": (3, 3)}
    assert ranges_text(ranges) == "a.x=step|helical b.c=0.5..2 d.e=3..3"
    assert ranges_text({}) == "nothing"
