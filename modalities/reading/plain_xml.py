"""XML from files: without a document type, so that no entity grows or names a file."""

from xml.etree import ElementTree

from endoct.base.errors import EndoctError, refusing

MOST_XML_BYTES = 16_000_000
_FORBIDDEN = (b"<!DOCTYPE", b"<!ENTITY")


def xml_root(data: bytes, what: str) -> ElementTree.Element:
    """Return the root of XML. Raises :class:`EndoctError`, naming ``what``, for what is none or declares entities."""
    if len(data) > MOST_XML_BYTES:
        raise EndoctError(f"{what} is too large", found=f"{len(data) / 1e6:.0f} MB", expected="16 MB at most")
    plain = data.replace(b"\0", b"").upper()  # of UTF-16, too
    if any(word in plain for word in _FORBIDDEN):
        raise EndoctError(f"{what} is not read", found="XML with a document type or entities", remedy="export it again")
    with refusing(f"{what} is no XML, or damaged", remedy="copy or export it again"):
        return ElementTree.fromstring(data)


def local_name(element: ElementTree.Element) -> str:
    """Return the name of an element without its namespace."""
    return element.tag.rpartition("}")[2]
