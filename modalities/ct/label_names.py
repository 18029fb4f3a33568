"""What labels of a segmentation stand for: a table next to it or named, of 3D Slicer or ITK-SNAP, or endoct's own."""

import csv
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small

OUR_NAMES: Mapping[int, str] = MappingProxyType(
    {1: "bone", 2: "facial nerve", 3: "chorda tympani", 4: "cochlea", 5: "sigmoid sinus", 6: "antrum"}
)
"""The simulator writes labels with these names."""
OUR_TABLE = "endoct"
"""It is stated in place of a table: labels are those of :data:`OUR_NAMES`."""
VOLUME_SUFFIXES = (".nii.gz", ".seg.nrrd", ".nii", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm")
TABLE_NAMES = ("{stem}_ColorTable.ctbl", "{stem}.ctbl", "{stem}.csv", "{stem}.label", "{stem}.txt")
"""A table next to a segmentation has one of these names."""
TABLE_SUFFIXES = (".ctbl", ".csv", ".label", ".txt")
MOST_LABELS = 10_000
LARGEST_LABEL = 65_535
EXPECTED = "a color table of 3D Slicer (.ctbl, .csv), or label descriptions of ITK-SNAP (.label, .txt)"
NO_NAMES = re.compile(r"(clear label|background|label ?\d+|segment_?\d+|\(none\)|none|)", re.IGNORECASE)
"""Programs give these names where nobody gave one."""
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)")


def table_next_to(volume: Path) -> Path | None:
    """Return the table of labels next to a segmentation, called as it; None where there is none.

    Raises :class:`EndoctError` where there are several.
    """
    lower = volume.name.lower()
    suffix = next((end for end in VOLUME_SUFFIXES if lower.endswith(end)), "")
    stem = volume.name[: len(volume.name) - len(suffix)]
    there = [path for name in TABLE_NAMES if (path := volume.with_name(name.format(stem=stem))).is_file()]
    # a text file may be about anything
    tables = [path for path in there if path.suffix not in (".txt", ".csv") or _looks_like_a_table(path)]
    if len(tables) > 1:
        raise EndoctError(
            f"{volume} has several tables of its labels",
            found=", ".join(path.name for path in tables),
            remedy="name one by --label-names",
        )
    return tables[0] if tables else None


def read_label_names(path: Path) -> dict[int, str]:
    """Return the names in a table by label. Raises :class:`EndoctError` for what is no such table.

    Names that a program gave where nobody did ("Label 3", "Segment_3") are none.
    """
    with refusing(f"{path} cannot be read", expected=EXPECTED):
        lines = _text(path).splitlines()
        rows = list(_rows(lines))
    names: dict[int, str] = {}
    for label, name in rows:
        if label in names and names[label] != name:
            raise EndoctError(
                f"{path} names a label twice",
                found=f"{label}: {names[label]!r} and {name!r}"[:120],
                remedy="leave out one",
            )
        names[label] = name
    if not names or len(names) > MOST_LABELS:
        raise EndoctError(f"{path} holds no names of labels", found=f"{len(names)} names", expected=EXPECTED)
    return {label: name for label, name in names.items() if not NO_NAMES.fullmatch(name)}


def _text(path: Path) -> str:
    data = read_small(path)
    for encoding in ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise EndoctError(f"{path} cannot be read", found="no text", expected=EXPECTED)


def _looks_like_a_table(path: Path) -> bool:
    try:
        return bool(list(_rows(_text(path).splitlines())))
    except (EndoctError, ValueError):
        return False


def _rows(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Yield label and name of each line. Raises ``ValueError`` for a line that is none of a table."""
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if rows and "," in rows[0] and {"labelvalue", "name"} <= set(_lower(rows[0])):
        yield from _of_csv(rows)
        return
    for line in rows:
        parts = shlex.split(line)
        numbers = [part for part in parts[1:] if _NUMBER.fullmatch(part)]
        # ITK-SNAP: label R G B A visible mesh "name"; 3D Slicer: label name R G B A
        if len(parts) == 8 and all(_NUMBER.fullmatch(part) for part in parts[:7]):
            name = parts[7]
        elif len(parts) >= 5 and len(numbers) >= 3 and not _NUMBER.fullmatch(parts[1]):
            words = len(parts) - (4 if len(parts) > 5 and _NUMBER.fullmatch(parts[-4]) else 3)
            name = " ".join(parts[1:words]).replace("_", " ")
        else:
            raise ValueError(f"the line '{line.strip()[:60]}'")
        yield _label(parts[0]), name.strip()


def _of_csv(rows: list[str]) -> Iterator[tuple[int, str]]:
    heads = _lower(rows[0])
    at, name_at = heads.index("labelvalue"), heads.index("name")
    for row in csv.reader(rows[1:]):
        if len(row) <= max(at, name_at):
            raise ValueError(f"a row of {len(row)} fields")
        yield _label(row[at]), row[name_at].strip()


def _lower(row: str) -> list[str]:
    return [field.strip().lower() for field in next(csv.reader([row]))]


def _label(text: str) -> int:
    text = text.strip()
    if not re.fullmatch(r"\d{1,5}", text) or int(text) > LARGEST_LABEL:
        raise ValueError(f"a label '{text[:20]}'")
    return int(text)
