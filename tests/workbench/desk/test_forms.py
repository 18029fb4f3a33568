"""Forms hold what the command line takes, and stand for nothing else."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import tyro
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.workbench.commands.opening import ON_THE_PAGE
from endoct.workbench.desk.forms import arguments_of, form_of, path_within
from endoct.workbench.desk.runs import command_line

FORMS = {name: form_of(name, command) for name, command in ON_THE_PAGE.items()}
FOLDER = Path("/nowhere/study")


@pytest.mark.parametrize("name", FORMS)
def test_a_form_has_what_the_help_has(name: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        tyro.cli(ON_THE_PAGE[name], args=["--help"], config=(tyro.conf.FlagCreatePairsOff,))
    said = capsys.readouterr().out
    flags = {field.flag for field in FORMS[name].fields if field.flag}
    in_help = set(re.findall(r"^[|│ ] (?:-\w[^,]*, )?(--[a-z][a-z-]*)", said, re.MULTILINE))
    assert flags == in_help - {"--help", "--json", "--strict"}
    assert all(field.about for field in FORMS[name].fields)


def test_values_become_the_words_that_a_person_would_type():
    values: dict[str, Any] = {
        "a": "bore 1/endoscope", "b": "-odd/oct", "output": "results/one", "settings": ["n_theta=512", " force=true "],
        "truth": ["masks/anna.png", "masks/ben.png"], "recipe": "", "overwrite": True, "session": "", "force": False,
    }  # fmt: skip
    words = arguments_of(FORMS["compare"], values, FOLDER)
    assert words == (
        *("compare", "bore 1/endoscope", "./-odd/oct", "--output=results/one", "--truth", "masks/anna.png"),
        *("masks/ben.png", "--set=n_theta=512", "--set=force=true", "--overwrite"),
    )
    assert command_line(words).startswith("endoct compare 'bore 1/endoscope' ./-odd/oct --output=results/one")


def test_the_command_line_reads_the_words_as_they_were_meant():
    values = {"a": "x/endoscope", "b": "-y", "output": "out", "settings": ["a=-1"], "truth": ["m.png", "n.png"]}
    words = arguments_of(FORMS["compare"], values, FOLDER)
    request = tyro.cli(ON_THE_PAGE["compare"], args=list(words[1:]), config=(tyro.conf.FlagCreatePairsOff,))
    assert (request.a, request.b, request.output) == (Path("x/endoscope"), Path("-y"), Path("out"))
    assert (request.settings, request.truth) == (("a=-1",), (Path("m.png"), Path("n.png")))
    words = arguments_of(
        FORMS["simulate"], {"output": "new", "preset": "hard", "seed": "7", "detail_mm": "0.02"}, FOLDER
    )
    made = tyro.cli(ON_THE_PAGE["simulate"], args=list(words[1:]), config=(tyro.conf.FlagCreatePairsOff,))
    assert (made.preset, made.seed, made.detail_mm, made.overwrite) == ("hard", 7, 0.02, False)


@pytest.mark.parametrize("value", ["/etc/passwd", "../eye.safetensors", "x/../../y", "linked", "half/\0"])
def test_a_setting_names_no_file_out_of_the_folder(value: str, tmp_path: Path) -> None:
    (tmp_path / "linked").symlink_to("/etc/passwd")
    given = {"a": "x", "b": "y", "output": "z"}
    with pytest.raises(EndoctError):
        arguments_of(FORMS["compare"], {**given, "settings": [f"eye={value}"]}, tmp_path)
    for inside in ("", "eyes/mine.safetensors", "mine.safetensors", "endoct", "0.5"):
        assert arguments_of(FORMS["compare"], {**given, "settings": [f"eye={inside}"]}, tmp_path)


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("compare", {"a": "x", "b": "y"}, "needs 'output'"),
        ("compare", {"a": "x", "b": "y", "output": "z", "strict": True}, "has no 'strict'"),
        ("compare", {"a": "/etc/passwd", "b": "y", "output": "z"}, "no path in the folder"),
        ("compare", {"a": "x", "b": "../other", "output": "z"}, "no path in the folder"),
        ("compare", {"a": "x", "b": "y", "output": "a/../../z"}, "no path in the folder"),
        ("compare", {"a": "x", "b": "y", "output": "z", "truth": ["m.png", "/m.png"]}, "no path in the folder"),
        ("compare", {"a": "x", "b": "y", "output": "z", "settings": "a=1"}, "'settings' cannot be used"),
        ("compare", {"a": "x", "b": "y", "output": "z", "settings": [1]}, "'settings' cannot be used"),
        ("compare", {"a": "x\n--force", "b": "y", "output": "z"}, "'a' cannot be used"),
        ("pose", {"sides": ["x"], "ct": "c", "output": "z", "device": "mps"}, "expected one of cpu, cuda"),
        ("compare", {"a": "x", "b": "y", "output": "z", "force": "yes"}, "expected true or false"),
        ("simulate", {"output": "z", "seed": "1e3"}, "expected a number"),
        ("simulate", {"output": "z", "detail_mm": "nan"}, "expected a number"),
        (
            "calibrate",
            {"modality": "--help", "recording": "x", "target": "t", "output": "z"},
            "'modality' cannot be used",
        ),
        ("pose", {"sides": ["x"], "ct": "c", "output": "z", "label_names": "/etc/passwd"}, "no path in the folder"),
    ],
)
def test_what_is_no_command_is_refused_by_name(name: str, values: dict[str, Any], said: str):
    with pytest.raises(EndoctError, match=said):
        arguments_of(FORMS[name], values, FOLDER)


def test_a_word_in_place_of_a_file_is_one():
    values = {"sides": ["x"], "ct": "c", "output": "z", "label_names": "endoct"}
    assert "--label-names=endoct" in arguments_of(FORMS["pose"], values, FOLDER)


def test_a_link_leads_nowhere_else(tmp_path: Path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "away").symlink_to(tmp_path)
    with pytest.raises(EndoctError, match="no path in the folder"):
        path_within(tmp_path / "study", "away/secret")
    assert path_within(tmp_path / "study", "results/new") == "results/new"


@given(
    st.dictionaries(
        st.sampled_from(["a", "b", "output", "settings", "truth", "x"]),
        st.one_of(st.text(), st.lists(st.text()), st.none(), st.integers()),
    )
)
def test_no_values_are_more_than_one_command(values: dict[str, Any]):
    try:
        words = arguments_of(FORMS["compare"], values, FOLDER)
    except EndoctError:
        return
    assert shlex.split(command_line(words)) == ["endoct", *words]
    assert words[0] == "compare"
    assert all(word.isprintable() for word in words)
    placed = words[1:3]
    assert not any(word.startswith(("-", "/")) or ".." in Path(word).parts for word in placed)
