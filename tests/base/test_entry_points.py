"""Functions of other packages: found by name, or refused in one line."""

from importlib.metadata import EntryPoint
from typing import Any

import pytest

from endoct.base import entry_points as module
from endoct.base.entry_points import answer_by, entry_named, load_function
from endoct.base.errors import EndoctError

GROUP = "endoct.bench.adding"
REGISTERED = [
    EntryPoint(name, value, GROUP)
    for name, value in (
        ("power", "math:pow"),
        ("pi", "math:pi"),
        ("gone", "math:no_such"),
        ("away", "no_such_module:f"),
        ("twice", "math:sin"),
        ("twice", "math:cos"),
    )
]


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "entry_points", lambda group: REGISTERED if group == GROUP else [])


def test_a_function_is_found_by_its_name_and_asked() -> None:
    assert load_function(GROUP, "power", "method")(2, 5) == 32
    assert answer_by("adding", "power", 2, 5, setting="adding_method") == 32
    assert entry_named("pi", REGISTERED, "method").value == "math:pi"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("pi", "the method 'pi' is no function; found float"),
        ("gone", "the method 'gone' cannot be imported; found math:no_such"),
        ("away", "the method 'away' cannot be imported; found no_such_module:f"),
        ("twice", "two packages register 'twice' as a method; found math:cos and math:sin"),
        ("powre", "'powre'"),
    ],
)
def test_what_is_no_function_is_refused(name: str, said: str) -> None:
    with pytest.raises(EndoctError) as raised:
        load_function(GROUP, name, "method")
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_what_a_method_raises_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(EndoctError, match="method 'power' gives no answer; found") as raised:
        answer_by("adding", "power", "two", 5, setting="adding_method")
    assert "leave adding_method out" in str(raised.value)

    def refuses(*_: Any) -> None:
        raise EndoctError("own words")

    monkeypatch.setattr(module, "load_function", lambda *_: refuses)
    with pytest.raises(EndoctError, match=r"^own words"):
        answer_by("adding", "power", 2, 5, setting="adding_method")
