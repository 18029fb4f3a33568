"""XML of strangers: read as it is, within bounds, without anything that it could define."""

import pytest

from endoct.base.errors import EndoctError
from endoct.base.files import xml_tree
from endoct.base.files.xml_tree import local_name, read_xml


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-8-sig"])
def test_elements_attributes_and_texts_come_back(encoding: str) -> None:
    root = read_xml('<a x="1"><b>größer</b><c:d xmlns:c="urn:c"/></a>'.encode(encoding), "a file")
    assert (root.tag, root.attrib, root[0].text) == ("a", {"x": "1"}, "größer")
    assert [local_name(element) for element in root] == ["b", "d"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"<a><b></a>", "no valid XML"),
        (b"", "no valid XML"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a/>', "a document type or entities"),
        (b"<!DOCTYPE a><a/>", "a document type or entities"),
    ],
)
def test_what_is_none_or_defines_something_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(EndoctError, match=said) as raised:
        read_xml(data, "a file")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "limit", "within", "beyond"),
    [
        ("MOST_DEEP", 3, b"<a><a><a/><a/></a></a>", b"<a><a><a><a/></a></a></a>"),
        ("MOST_ELEMENTS", 4, b"<a><b/><b/><b/></a>", b"<a><b/><b/><b/><b/></a>"),
        ("MOST_BYTES", 7, b"<a></a>", b"<a>b</a>"),
    ],
)
def test_what_is_beyond_bounds_is_refused(
    name: str, limit: int, within: bytes, beyond: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xml_tree, name, limit)
    assert read_xml(within, "a file").tag == "a"
    with pytest.raises(EndoctError, match=r"too (many|large)|is too large"):
        read_xml(beyond, "a file")
