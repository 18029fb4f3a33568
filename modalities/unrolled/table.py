"""Tables of numbers: a row of the wall a line, a column of the wall a field.

Fields are separated by commas, semicolons, tabs or spaces. One first line may name the columns. An empty field, and one
that reads NaN, was not observed. A decimal comma is refused by name: "1,5" may be two numbers.
"""

from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size, read_small, text_of

MOST_BYTES = 500_000_000
SEPARATORS = ("\t", ";", ",")


def read_table(path: Path) -> Coordinates:
    """Return the numbers of a table, float64 (rows, columns), NaN where a field is empty.

    Raises :class:`EndoctError` where the file is no table of numbers, or its lines differ in length.
    """
    try:
        text = text_of(read_small(path, MOST_BYTES))
    except UnicodeDecodeError as error:
        raise _no_table(path, "bytes that are no text") from error
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise _no_table(path, "no line")
    separator = next((one for one in SEPARATORS if one in text), None)
    fields = [line.split(separator) for line in lines]
    if any(field.strip()[:1].isalpha() and not _is_number(field) for field in fields[0]):
        fields = fields[1:]  # the names of columns
    if not fields:
        raise _no_table(path, "one line without a number")
    n_columns = len(fields[0])
    check_array_size((len(fields), n_columns), 8, f"{path}")
    table = np.empty((len(fields), n_columns))
    for index, row in enumerate(fields):
        if len(row) != n_columns:
            raise _no_table(path, f"{len(row)} fields in row {index}, {n_columns} in the first")
        try:
            table[index] = [float(field) if field.strip() else np.nan for field in row]
        except ValueError as error:
            wrong = next(field for field in row if field.strip() and not _is_number(field))
            raise _no_table(path, f"{wrong.strip()[:40]!r} in row {index}") from error
    return table


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _no_table(path: Path, instead: str) -> EndoctError:
    return EndoctError(
        f"{path} is no table of numbers",
        found=instead,
        expected="a line for each row, as many numbers in each, with decimal points",
        remedy="export it again, one line of column names at most",
    )
