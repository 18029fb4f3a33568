"""The task "ablate": the main comparison with one step switched off, or as the paper did it, at a time."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from endoct.workbench.bench.cases.specimens import DIFFICULTIES
from endoct.workbench.bench.task import Task
from endoct.workbench.bench.tasks.comparison import (
    RANGES,
    SCORES,
    USUAL,
    ComparedPair,
    PartSettings,
    Settings,
    Specimen,
    compare_pair,
    judge,
    own_cases,
    simulated_case,
)
from endoct.workbench.sides.recipes import RECIPES

MAIN = "main"
EVEN_TURNS: PartSettings = {
    f"correct_{step}": False for step in ("rotation", "turn_length", "start_angle", "lost_ascans")
}


@dataclass(frozen=True)
class Step:
    """A step of the main comparison, and the settings that switch it off."""

    title: str
    oct: PartSettings = field(default_factory=dict)
    endoscope: PartSettings = field(default_factory=dict)
    compare: PartSettings = field(default_factory=dict)

    @property
    def settings(self) -> Settings:
        """Return the settings by part."""
        return {"oct": self.oct, "endoscope": self.endoscope, "compare": self.compare}


STEPS: Mapping[str, Step] = {
    MAIN: Step("everything as it is"),
    "literal": Step("the paper's chain for the OCT", oct=RECIPES["paper"]["oct"]),
    "no-turning": Step("turns are taken for even, whole and starting at one angle", oct=EVEN_TURNS),
    "no-circle": Step("undistort by the sine, not by the circle off the axis", oct={"undistort": "sine"}),
    "no-edge": Step("the wall is the brightest sample, not the first edge", oct={"wall": "maximum"}),
    "no-continuity": Step("the wall may jump along θ at no cost", oct={"slope_cost_per_mm": 0, "jump_cost": 0.0}),
    "no-denoising": Step("no wavelets before the capillary is sought", oct={"denoise_threshold": 0}),
    "no-rotation": Step("the smooth error of angle within a turn stays", oct={"correct_rotation": False}),
    "no-turn-length": Step("turns are as long as they should be", oct={"correct_turn_length": False}),
    "no-start-angle": Step("turns start where they should", oct={"correct_start_angle": False}),
    "no-lost-ascans": Step("jumps of angle stay", oct={"correct_lost_ascans": False}),
    "no-faint": Step("slices count, however little their wall stands out", oct={"least_wall_sigmas": 0}),
    "no-feed": Step("frames lie where the nominal feed has them", endoscope={"correct_feed": False}),
    "no-roll": Step("the probe does not roll", endoscope={"correct_roll": False}),
    "no-offset": Step("the probe runs on the bore's axis", endoscope={"probe_offset": False}),
    "no-cone": Step("the mirror is a cone of 45°, where it is not stated", endoscope={"self_calibration": False}),
    "no-dirt": Step("samples behind dirt count", endoscope={"least_transmission": 0}),
    "no-taper": Step("all rows of a frame count alike", endoscope={"taper": 0.01}),
    "no-cap": Step("relief and contrast are not capped", compare={"relief_cap_mm": 10, "contrast_cap": 50}),
    "no-floor": Step("relief in front of the wall stays", compare={"relief_floor_mm": -10}),
    "no-spread": Step("contrast within the wall's own spread stays", compare={"contrast_floor_sigmas": 0}),
    "no-outlines": Step("dark cells end at Li's threshold", compare={"outlines": False}),
    "no-smoothing": Step("nothing is smoothed before the threshold", compare={"smooth_mm": 0}),
    "no-cleaning": Step(
        "masks are not opened, closed or cleared of specks", compare={"open_mm": 0, "close_mm": 0, "smallest_mm2": 0}
    ),
    "no-depth": Step("the OCT's cells are found by intensity, not by depth", compare={"segment": "intensity"}),
    "no-scale": Step("the two pitches are believed", compare={"z_scale_min": 1.0, "z_scale_max": 1.0}),
}


def without(name: str, specimen: Specimen) -> ComparedPair:
    """Compare with the step ``name`` off."""
    return compare_pair(specimen, STEPS[name].settings)


TASK = Task(
    name="ablate",
    title="the main comparison with each step off",
    signature=(
        "method(specimen: Specimen) -> ComparedPair, both of endoct.workbench.bench.tasks.comparison; "
        "compare_pair(specimen, settings) makes one"
    ),
    cases=simulated_case,
    judge=judge,
    ranges=RANGES,
    usual=USUAL,
    optional=DIFFICULTIES,
    scores=SCORES,
    own=own_cases,
    methods={name: partial(without, name) for name in STEPS},
    against=MAIN,
)
