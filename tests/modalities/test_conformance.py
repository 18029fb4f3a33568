"""The two modalities that come with endoct keep the contract, on a simulated specimen."""

from pathlib import Path

import pytest

from endoct.modalities.conformance import CHECKS, Check, Subject
from endoct.modalities.registry import manifests


@pytest.fixture(scope="module", params=["oct", "endoscope"])
def subject(request: pytest.FixtureRequest, quick_specimen: Path) -> Subject:
    return Subject(manifests()[request.param], quick_specimen / request.param)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_conforms(check: Check, subject: Subject) -> None:
    check(subject)
