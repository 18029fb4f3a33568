"""What a run states about itself."""

import json

from bench_tasks import DOUBLING

from endoct.workbench.bench.checkpoint import machine, plan_facts
from endoct.workbench.bench.runner import Plan
from endoct.workbench.bench.task import AnyTask


def test_facts_can_be_written_as_json(doubling: AnyTask) -> None:
    facts = plan_facts(Plan("doubling", ("right",), (3,), 1, DOUBLING.ranges))
    assert json.loads(json.dumps(facts)) == facts
    assert facts["conditions"] == {"size": [0.0, 1.0], "kind": ["plain", "odd"]}
    assert {"processor", "cores", "cores_usable", "system"} <= set(json.loads(json.dumps(machine())))
