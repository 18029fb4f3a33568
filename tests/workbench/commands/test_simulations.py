"""Compiling before it is needed: by a small comparison, which leaves nothing but the machine code."""

from pathlib import Path

import pytest
from numba.core.caching import CompileResultCacheImpl

from endoct.base.errors import EndoctError
from endoct.workbench import api
from endoct.workbench.commands import run


def test_a_small_comparison_is_made_and_thrown_away(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[Path] = []

    def demo(output: Path, *, preset: str, progress: object) -> None:
        assert (preset, progress) == ("learning", False)
        output.mkdir()
        made.append(output)

    monkeypatch.setattr(api, "demo", demo)
    assert run(["warm-up"]) == 0
    assert capsys.readouterr() == ("compiled\n", "compiling\n")  # and nothing of a comparison
    assert len(made) == 1
    assert not made[0].exists()


def test_nothing_is_compiled_that_cannot_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    with pytest.raises(EndoctError, match=r"cannot be kept.*NUMBA_CACHE_DIR"):
        run(["warm-up"])
