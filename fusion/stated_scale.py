"""Which values in the sidecars would make two recordings equally long along the bore."""

from collections.abc import Iterator
from dataclasses import dataclass

from endoct.fusion.evidence.side import Side


@dataclass(frozen=True)
class Remedy:
    """``key`` of the sidecar of ``side``, what it states, and the value at which both sides would agree."""

    side: str
    key: str
    stated: float
    agreeing: float

    @property
    def unit(self) -> str:
        """Unit of both values."""
        return "mm/s" if self.key.endswith("_mm_s") else "mm"

    def __str__(self) -> str:
        return f"{self.key} = {self.agreeing:.4g} of {self.side} ({self.stated:.4g} is stated)"


def remedies(a: Side, b: Side, z_scale: float) -> tuple[Remedy, ...]:
    """Return what would agree where ``b`` fits ``a`` once its z is multiplied by ``z_scale``.

    A side whose scale its own recording bears out is not suspected unless both are borne out. Empty where no single key
    sets the scale of a suspected side.
    """
    factors = (a, 1 / z_scale), (b, z_scale)
    suspected = [(side, factor) for side, factor in factors if not _borne_out(side)]
    return tuple(remedy for side, factor in suspected or factors for remedy in _of(side, factor))


def _of(side: Side, factor: float) -> Iterator[Remedy]:
    for key, value in side.panorama.axial_scale.stated.items():
        yield Remedy(side.name, key, value, value * factor)


def _borne_out(side: Side) -> bool:
    return side.panorama.axial_scale.checked and not side.panorama.doubts
