"""What the scale of a panorama along the bore rests on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from endoct.stitching.errors import EndoctError


@dataclass(frozen=True)
class AxialScale:
    """What z, in mm, was taken from.

    Attributes: ``stated``, the keys of the sidecar to which z is proportional and their values, by name, > 0; empty
    where there is no such key, as for positions of every frame. ``checked``: whether the recording itself measures
    what is stated, as a feed that is seen in the images does; what that says against it is a doubt of the panorama.

    Raises :class:`EndoctError` for a value that is not a positive number.
    """

    stated: Mapping[str, float] = field(default_factory=dict)
    checked: bool = False

    def __post_init__(self) -> None:
        for key, value in self.stated.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
                raise EndoctError(
                    f"'{key}' cannot scale a panorama", found=repr(value)[:80], expected="a positive number"
                )

    def to_json(self) -> dict[str, Any]:
        """Return it as a panorama's store has it."""
        return {"stated": dict(self.stated), "checked": self.checked}
