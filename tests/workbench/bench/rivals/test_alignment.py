"""Panoramas aligned with other people's libraries."""

import sys

import pytest

from endoct.workbench.bench.rivals import alignment as rivals
from endoct.workbench.bench.task import NotInstalled
from endoct.workbench.bench.tasks.alignment import TASK, AlignmentCase


def test_a_rival_finds_what_hardly_moved(easy: AlignmentCase) -> None:
    assert TASK.judge(easy, rivals.phase_correlation(*easy.given))["success"] == 1


@pytest.mark.parametrize(("rival", "package"), [("kornia_similarity", "kornia"), ("mutual_information", "SimpleITK")])
def test_a_rival_that_is_not_installed_says_so(
    easy: AlignmentCase, monkeypatch: pytest.MonkeyPatch, rival: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setitem(sys.modules, "kornia.geometry.transform", None)
    with pytest.raises(NotInstalled, match=f"{package} is not installed; pip install {package}"):
        getattr(rivals, rival)(*easy.given)
