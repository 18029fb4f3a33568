"""A published set made: the same bytes by any number of workers, resumed, and never mixed with something else."""

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from distributed import Client
from published_sets import tiny

from endoct.base.errors import EndoctError
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.workbench.bench.published import making
from endoct.workbench.bench.published.definition import Planned, SpecimenKind
from endoct.workbench.bench.published.making import PLAIN_ARITHMETIC, make_set, make_specimen, simulated_specimen
from endoct.workbench.bench.published.specimen_set import Entry, SpecimenSet, read_finished_set, read_set
from endoct.workbench.running.progress import SilentStages


def made(output: Path, workers: int = 1) -> SpecimenSet:
    return make_set(output, "endoct-bench-2", workers=workers, stages=SilentStages())


@contextmanager
def cluster_here(_: int) -> Iterator[Client]:
    """Work in this process, which has its libraries: enough to find what lies there."""
    with Client(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as client:
        yield client


def truth_alone(folder: Path, specimen: Planned) -> None:
    """Write the least that a specimen holds: a real one compiles for plain arithmetic first."""
    (folder / "truth").mkdir(parents=True)
    wall = {name: Named(("z", "theta"), np.ones((4, 8), of)) for name, of in (("relief_mm", "f4"), ("cell", "?"))}
    wall |= {name: Named((name,), np.arange(n, dtype=np.float64)) for name, n in (("z", 4), ("theta", 8))}
    write_arrays(folder / "truth" / "wall.zarr", wall, {})
    (folder / "truth" / "recording.json").write_text("{}")


def test_a_set_lists_what_can_be_made_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "load_definition", lambda _: tiny())
    monkeypatch.setattr(making, "shipped_entries", lambda _: {})

    writers = {"simulator": truth_alone}
    first = make_set(tmp_path / "set", "endoct-bench-2", writers=writers, stages=SilentStages())
    assert [entry.name for entry in first.specimens] == ["simulator-easy-000"]  # the second generator has no writer
    assert read_set(tmp_path / "set") == first
    monkeypatch.setattr("endoct.workbench.running.cluster.own_cluster", cluster_here)
    monkeypatch.setattr(making, "_plainly", lambda job: job())

    def never(folder: Path, specimen: Planned) -> None:
        raise AssertionError(f"{specimen.name} was made again in {folder}")

    again = make_set(tmp_path / "set", "endoct-bench-2", writers={"simulator": never}, stages=SilentStages())
    assert again == first
    monkeypatch.setattr(making, "shipped_entries", lambda _: {each.name: each for each in first.specimens})
    assert made(tmp_path / "set") == first
    another = first.specimens[0].model_copy(update={"means": {"oct": (1.0,)}})
    monkeypatch.setattr(making, "shipped_entries", lambda _: {another.name: another})
    with pytest.raises(EndoctError, match="not those that were published"):
        made(tmp_path / "set")


def test_a_set_is_made_task_by_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = [SpecimenKind(generator="simulator", difficulty="easy", tasks=(of,), count=1) for of in ("oct", "pose")]
    monkeypatch.setattr(making, "load_definition", lambda _: tiny().model_copy(update={"kinds": tuple(kinds)}))
    monkeypatch.setattr(making, "shipped_entries", lambda _: {})
    monkeypatch.setattr("endoct.workbench.running.cluster.own_cluster", cluster_here)
    monkeypatch.setattr(making, "_plainly", lambda job: job())

    def listed(task: str | None) -> list[str]:
        writers = {"simulator": truth_alone}
        return [
            entry.name
            for entry in make_set(
                tmp_path / "set", "endoct-bench-2", task=task, writers=writers, stages=SilentStages()
            ).specimens
        ]

    assert listed("pose") == ["pose-simulator-easy-000"]
    assert listed("oct") == ["simulator-easy-000", "pose-simulator-easy-000"]  # what is there stays
    with pytest.raises(EndoctError, match="has no task 'otc'"):
        listed("otc")


@pytest.mark.slow
def test_workers_change_no_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "load_definition", lambda _: tiny(count=2))
    monkeypatch.setattr(making, "shipped_entries", lambda _: {})
    assert made(tmp_path / "alone").digest == made(tmp_path / "together", workers=2).digest


def test_a_specimen_that_was_changed_is_refused(changed_set: Path, plan: Planned) -> None:
    with (changed_set / plan.name / "oct" / "acquisition.toml").open("a", encoding="utf-8") as file:
        file.write("# a remark\n")
    with pytest.raises(EndoctError, match="not as it was made"):
        make_specimen(changed_set, plan, simulated_specimen)


def test_a_folder_of_others_is_refused(tmp_path: Path, plan: Planned) -> None:
    (tmp_path / plan.name).mkdir()
    (tmp_path / plan.name / "specimen.json").write_text('{"name": "mine"}', encoding="utf-8")
    with pytest.raises(EndoctError, match="no specimen of a set"):
        make_specimen(tmp_path, plan, simulated_specimen)


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path, plan: Planned) -> None:
    def fails(folder: Path, specimen: Planned) -> None:
        folder.mkdir()
        (folder / "half").write_text(specimen.name, encoding="utf-8")
        raise EndoctError("no more")

    with pytest.raises(EndoctError, match="no more"):
        make_specimen(tmp_path, plan, fails)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names of instructions of x86-64")
def test_specimens_are_made_by_plain_arithmetic_and_this_process_keeps_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(making, "load_definition", lambda _: tiny())
    monkeypatch.setenv("NUMBA_CPU_NAME", "host")
    monkeypatch.delenv("NUMBA_CPU_FEATURES", raising=False)

    def tells(folder: Path, specimen: Planned) -> None:
        import threadpoolctl

        blas = {each["architecture"] for each in threadpoolctl.threadpool_info() if "architecture" in each}
        facts = {"opencv": cv2.useOptimized(), "blas": sorted(blas)} | {
            name: os.environ[name] for name in PLAIN_ARITHMETIC
        }
        raise EndoctError(json.dumps(facts))

    with pytest.raises(EndoctError) as stated:
        make_set(tmp_path / "set", "endoct-bench-2", writers={"simulator": tells}, stages=SilentStages())
    assert json.loads(str(stated.value)) == {"opencv": False, "blas": ["Nehalem"], **PLAIN_ARITHMETIC}
    assert os.environ["NUMBA_CPU_NAME"] == "host"
    assert "NUMBA_CPU_FEATURES" not in os.environ
    assert cv2.useOptimized()


def test_a_folder_that_is_not_empty_or_another_set_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "load_definition", lambda _: tiny())
    (tmp_path / "README.md").write_text("mine", encoding="utf-8")
    with pytest.raises(EndoctError, match="not empty"):
        made(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]

    def stopped(*_: object) -> Iterator[tuple[str, Entry]]:
        raise KeyboardInterrupt

    hidden = tmp_path / "hidden"
    with monkeypatch.context() as patch:
        patch.setattr(making, "_made", stopped)
        with pytest.raises(KeyboardInterrupt, match="goes on"):
            make_set(hidden, "endoct-bench-2", half="hidden", key=7, stages=SilentStages())
    with pytest.raises(EndoctError, match="not finished"):
        read_finished_set(hidden)
    for half, key in (("hidden", 8), ("public", None)):
        with pytest.raises(EndoctError, match="another set"):
            make_set(hidden, "endoct-bench-2", half=half, key=key, stages=SilentStages())


def test_each_half_has_its_key(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="needs a key"):
        make_set(tmp_path, "endoct-bench-2", half="hidden", stages=SilentStages())
    with pytest.raises(EndoctError, match="key of its own"):
        make_set(tmp_path, "endoct-bench-2", key=5, stages=SilentStages())


def test_what_a_killed_run_left_is_cleared(tmp_path: Path) -> None:
    begun = SpecimenSet(set="endoct-bench-2", half="public", size="small", key="", versions={}, specimens=())
    making._begin(tmp_path / "set", begun)
    stale = tmp_path / "set" / ".endoct-simulator-easy-003-x"
    stale.mkdir()
    (stale / "lock").write_text("process 1 on a machine\n")
    making._begin(tmp_path / "set", begun)
    assert [path.name for path in (tmp_path / "set").iterdir()] == ["set.json"]
