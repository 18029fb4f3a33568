"""Panoramas aligned with other people's libraries."""

from endoct.workbench.bench.rivals import alignment as rivals
from endoct.workbench.bench.tasks.alignment import TASK, AlignmentCase


def test_a_rival_finds_what_hardly_moved(easy: AlignmentCase) -> None:
    assert TASK.judge(easy, rivals.phase_correlation(*easy.given))["success"] == 1
