"""What the rehearsals of a bore along a plan are asked for."""

from types import SimpleNamespace
from typing import Any

import pytest

from endoct.fusion.pose import outlook
from endoct.fusion.pose.rehearsal import BY_CELLS, WITH_DEPTH
from endoct.workbench.posing import steps
from endoct.workbench.running.progress import SilentStages


def test_every_rehearsal_is_of_the_bore_that_is_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    """One radius for the wall and all rehearsals, so much of it seen, the same numbers for both instruments."""
    asked: list[Any] = []
    monkeypatch.setattr(outlook, "REHEARSALS", 2)
    monkeypatch.setattr(steps, "air_around", lambda ct, plan: (ct, plan))
    monkeypatch.setattr(outlook, "wall_of_plan", lambda *of: asked.append(of) or "wall")
    monkeypatch.setattr(outlook, "rehearsed", lambda *of: asked.append(of) or of)
    monkeypatch.setattr(outlook, "facts_of", lambda wall: f"facts of the {wall}")
    monkeypatch.setattr(steps, "facts_of", lambda ct, title, coordinates: (ct, coordinates))
    planned: Any = SimpleNamespace(ct="ct", plan="plan", files=(), coordinates="ras")
    result = steps.rehearse(planned, 0.9, 7.5, None, device="cpu", stages=SilentStages())
    air = "ct", "plan"
    of_each = [[(air, one, 0.9, 7.5, number, "cpu") for number in range(2)] for one in (WITH_DEPTH, BY_CELLS)]
    assert asked == [(air, 0.9), *of_each[0], *of_each[1]]
    assert [(one.instrument, list(one.tried)) for one in result.outlook.prospects] == [
        (WITH_DEPTH.name, of_each[0]),
        (BY_CELLS.name, of_each[1]),
    ]
    assert (result.outlook.facts, result.wall) == ("facts of the wall", "wall")
    assert (result.made.parameters["radius_mm"], result.made.parameters["seen_mm"]) == (0.9, 7.5)
