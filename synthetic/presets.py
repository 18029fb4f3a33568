"""How large a simulated specimen is. How hard it is does not depend on the preset: see ``parameters``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

PresetName = Literal["quick", "paper"]


@dataclass(frozen=True)
class Preset:
    """Sizes of one specimen.

    Attributes: ``n_slices`` and ``n_frames``, recorded by the OCT and by the endoscope; ``n_ascans`` a turn,
    a multiple of ``ascans_per_column``, the A-scans between two independently drawn columns of the optical
    field (which is oversampled when a turn has 14 000 A-scans); ``n_depth`` samples an A-scan;
    ``pitch_mm``, nominal, of both instruments (Laves 2019, Methods: 0.2 mm); ``wall_dz_mm`` and
    ``wall_n_theta``, the grid of the wall and of the truth.
    """

    n_slices: int
    n_ascans: int
    ascans_per_column: int
    n_frames: int
    n_depth: int = 512
    pitch_mm: float = 0.2
    wall_dz_mm: float = 0.01
    wall_n_theta: int = 2048


PRESETS: Mapping[PresetName, Preset] = {
    "quick": Preset(n_slices=40, n_ascans=2000, ascans_per_column=1, n_frames=40),
    # 30 mm of pullback, 390 turns a minute at 91 000 A-scans a second (Laves 2019, Methods)
    "paper": Preset(n_slices=150, n_ascans=14000, ascans_per_column=7, n_frames=150),
}
