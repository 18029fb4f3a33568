"""XML in somebody's file: without document types and entities, within bounds of size and depth."""

from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from endoct.base.errors import EndoctError, refusing

MOST_BYTES = 16_000_000
MOST_DEEP, MOST_ELEMENTS = 32, 300_000
_BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_xml(data: bytes, document: str) -> Element:
    """Return the root of the XML document that ``document`` names, in UTF-8, UTF-16 or the encoding that it states.

    Raises :class:`EndoctError` if it is not XML, has a document type, which could define entities, or is beyond bounds.
    """
    if len(data) > MOST_BYTES:
        raise EndoctError(
            f"{document} is too large", found=f"{len(data) / 1e6:.0f} MB", expected="16 MB of XML at most"
        )
    builder, open_elements, n_elements = TreeBuilder(), 0, 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal open_elements, n_elements
        open_elements, n_elements = open_elements + 1, n_elements + 1
        if open_elements > MOST_DEEP or n_elements > MOST_ELEMENTS:
            raise EndoctError(
                f"{document} is no XML that is read",
                found="too many elements, or too many within one another",
                expected=f"{MOST_ELEMENTS} elements and {MOST_DEEP} levels at most",
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal open_elements
        open_elements -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise EndoctError(f"{document} is no XML that is read", found="a document type or entities", expected="none")

    with refusing(f"{document} is no valid XML", remedy="copy or export it again"):
        parser = expat.ParserCreate("utf-16" if data.startswith(_BYTE_ORDER_MARKS) else None)
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler = builder.data
        parser.StartDoctypeDeclHandler = refuse
        parser.Parse(data, True)
        return builder.close()


def local_name(element: Element) -> str:
    """Return the name of an element without the prefix of its namespace."""
    return element.tag.rpartition(":")[2]
