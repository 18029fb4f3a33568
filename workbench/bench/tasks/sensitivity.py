"""The task "sensitivity": the main comparison with each parameter up and down by a factor, one at a time."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from pydantic import BaseModel

from endoct.fusion.parameters import CompareParameters
from endoct.modalities.registry import manifests
from endoct.workbench.bench.cases.specimens import DIFFICULTIES
from endoct.workbench.bench.task import DOWN, UP, Case, Range, Task
from endoct.workbench.bench.tasks.ablate import MAIN
from endoct.workbench.bench.tasks.comparison import (
    RANGES,
    SCORES,
    USUAL,
    ComparedPair,
    ComparisonCase,
    Part,
    Specimen,
    compare_pair,
    judge,
    own_cases,
    simulated_case,
)

FactorCase = Case[tuple[Specimen, float], Path]
FACTOR = 1.5
NOT_TUNED = {"oct": {"seed"}, "endoscope": set[str](), "compare": {"z_scale_min", "z_scale_max"}}
"""These numbers are no amounts: a seed, and bounds about 1."""


def scaled(part: Part, name: str, default: float, power: int, specimen: Specimen, factor: float) -> ComparedPair:
    """Compare with one parameter at ``default · factor**power``, rounded where it is a whole number."""
    value = default * factor**power
    return compare_pair(specimen, {part: {name: round(value) if isinstance(default, int) else value}})


def parameters() -> dict[tuple[Part, str], float]:
    """Return (part, name) → default of every parameter that is a number other than 0."""
    plugins = manifests()
    models: dict[Part, type[BaseModel]] = {
        "oct": plugins["oct"].load().parameters,
        "endoscope": plugins["endoscope"].load().parameters,
        "compare": CompareParameters,
    }
    return {
        (part, name): field.default
        for part, model in models.items()
        for name, field in model.model_fields.items()
        if isinstance(value := field.default, int | float) and not isinstance(value, bool) and value != 0
        if name not in NOT_TUNED[part]
    }


def _methods() -> dict[str, Callable[..., ComparedPair]]:
    methods: dict[str, Callable[..., ComparedPair]] = {MAIN: lambda specimen, _factor: compare_pair(specimen, {})}
    for (part, name), default in parameters().items():
        for suffix, power in ((UP, 1), (DOWN, -1)):
            methods[f"{part}.{name}{suffix}"] = partial(scaled, part, name, default, power)
    return methods


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> FactorCase:
    """Return a simulated specimen, and the factor, as a case."""
    case = simulated_case(seed, index, ranges)
    return _with_factor(case, float(case.conditions["factor"]))


def own(folder: Path) -> list[FactorCase]:
    """Return a folder of the user's own, and the factor, as a case."""
    return [_with_factor(case, FACTOR) for case in own_cases(folder)]


def _with_factor(case: ComparisonCase, factor: float) -> FactorCase:
    return Case(case.name, (*case.given, factor), case.truth, case.conditions, case.scratch)


TASK = Task(
    name="sensitivity",
    title="the main comparison with each parameter up and down by a factor",
    signature=(
        "method(specimen: Specimen, factor: float) -> ComparedPair, both of "
        "endoct.workbench.bench.tasks.comparison; compare_pair(specimen, settings) makes one"
    ),
    cases=cases,
    judge=judge,
    ranges={**RANGES, "factor": (FACTOR, FACTOR)},
    usual=USUAL,
    optional=DIFFICULTIES,
    scores=SCORES,
    own=own,
    methods=_methods(),
    against=MAIN,
)
