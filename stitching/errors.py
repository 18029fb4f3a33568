"""What endoct raises for input it cannot use."""


class EndoctError(Exception):
    """Input that cannot be used, told in one line: what, found, expected, remedy.

    ``what`` is the problem; ``found``, ``expected`` and ``remedy`` are phrases without a full stop,
    left out where there is nothing to say. ``str()`` gives the one line a user sees.
    """

    def __init__(self, what: str, *, found: str = "", expected: str = "", remedy: str = "") -> None:
        super().__init__(what, found, expected, remedy)
        self.what = what
        self.found = found
        self.expected = expected
        self.remedy = remedy

    def __str__(self) -> str:
        parts = [
            self.what,
            f"found {self.found}" if self.found else "",
            f"expected {self.expected}" if self.expected else "",
            self.remedy,
        ]
        return " ".join("; ".join(part for part in parts if part).split())

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.what, self.found, self.expected, self.remedy)


class NotSeen(EndoctError):
    """A recording that can be read, but does not show what is looked for in it."""


def _rebuild(kind: type[EndoctError], what: str, found: str, expected: str, remedy: str) -> EndoctError:
    return kind(what, found=found, expected=expected, remedy=remedy)
