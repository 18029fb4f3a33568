"""A specimen that is simulated, and what is made of it next to it; neither is left where one of them fails."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from endoct.base.compute.own_process import undone_in_the_end
from endoct.base.errors import EndoctError
from endoct.base.files.output import OVERWRITE, check_output, check_place, remove_output
from endoct.workbench.running.kinds import SPECIMEN

Made = TypeVar("Made")


def demonstrate(
    output: Path,
    result: tuple[str, str],
    simulate: Callable[[Path], object],
    make: Callable[[Path, Path], Made],
    *,
    overwrite: bool,
) -> Made:
    """Simulate in ``output``/specimen, then make a ``result``, a name in ``output`` and its kind, and return that.

    ``simulate`` gets the specimen's folder, ``make`` this and the result's. Raises :class:`EndoctError` where
    ``output`` exists and ``overwrite`` is not set, or cannot be written.
    """
    existed = output.exists()
    if existed and not overwrite:
        raise EndoctError(f"{output} exists already", remedy=OVERWRITE)
    check_place(output)
    specimen, place = output / "specimen", output / result[0]
    for part, kind in ((specimen, SPECIMEN), (place, result[1])):
        check_output(part, kind, overwrite=overwrite)

    def leave_nothing() -> None:
        if not existed and not place.exists():
            remove_output(specimen, SPECIMEN)
            with suppress(OSError):  # somebody else has put something there
                output.rmdir()

    with undone_in_the_end(leave_nothing):
        try:
            simulate(specimen)
            return make(specimen, place)
        except BaseException:
            leave_nothing()
            raise
