"""The one exception: one line, and it survives a process boundary."""

import pickle

from endoct.base.errors import EndoctError, some_of


def test_one_line_in_order() -> None:
    error = EndoctError("the file is\n truncated", found="3 bytes", expected="9", remedy="copy it again")
    assert str(error) == "the file is truncated; found 3 bytes; expected 9; copy it again"
    assert str(EndoctError("no frames")) == "no frames"


def test_pickling_keeps_everything() -> None:
    error = EndoctError("a", found="b", expected="c", remedy="d")
    copy = pickle.loads(pickle.dumps(error))
    assert (copy.what, copy.found, copy.expected, copy.remedy, str(copy)) == ("a", "b", "c", "d", str(error))


def test_of_many_names_some_are_listed_and_the_others_counted() -> None:
    assert some_of(["a", "b", "c"]) == "a, b, c"
    assert some_of(("a", "b", "c", "d", "e")) == "a, b, c and 2 more"
    assert some_of(["a", "b"], most=1) == "a and 1 more"
