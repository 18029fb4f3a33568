"""A published set made: every specimen from its seed, its panoramas, and the digests of both.

What is made already stays: a run that was stopped goes on with the same command.

Libraries choose instructions by the processor, and each choice rounds differently. Specimens are therefore made in
processes that use none beyond those of every x86-64 processor; see :data:`PLAIN_ARITHMETIC`.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import check_place
from endoct.base.files.scratch import clear_dead_scratch, new_file, scratch_next_to
from endoct.stitching.store import save_panorama
from endoct.workbench import api
from endoct.workbench.bench.published.definition import Half, Planned, Size, load_definition, planned
from endoct.workbench.bench.published.deposit import write_deposit
from endoct.workbench.bench.published.specimen_set import (
    SET_FILE,
    SIDES,
    SPECIMEN_FILE,
    Entry,
    SpecimenSet,
    check_specimen,
    entry_of,
    read_set,
    shipped_entries,
)
from endoct.workbench.running.outputs import versions
from endoct.workbench.running.progress import Advance, Stages
from endoct.workbench.running.refusals import refusing_disk_errors

PLAIN_ARITHMETIC = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    # the second half: names of glibc before 2.33
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX2_Usable,-FMA_Usable,-FMA4_Usable",
    "OPENCV_IPP": "disabled",
    "OPENCV_LOG_LEVEL": "ERROR",  # it warns of IPP's absence
}
"""Environment in which NumPy, OpenBLAS, Numba, OpenCV and the C library round alike on every x86-64 processor.

They read it as they are loaded. OpenCV is also told in the process, which holds for IPP in one thread alone.
"""

Writer = Callable[[Path, Planned], None]
"""Writes the recordings and the truth of a specimen into a folder that does not exist yet."""


def simulated_specimen(folder: Path, specimen: Planned) -> None:
    """Write a specimen of endoct's simulator."""
    from endoct.synthetic.specimen import simulate

    kind = specimen.kind
    if kind.preset is None:
        raise EndoctError(f"the kind {kind.name} has no preset")
    simulate(folder, preset=kind.preset, seed=specimen.seed, ranges=kind.vary, ct="pose" in kind.tasks, workers=1)


WRITERS: Mapping[str, Writer] = {"simulator": simulated_specimen}


def make_set(
    output: Path,
    name: str,
    *,
    half: Half = "public",
    size: Size = "small",
    key: int | None = None,
    task: str | None = None,
    writers: Mapping[str, Writer] = WRITERS,
    workers: int = 1,
    stages: Stages,
) -> SpecimenSet:
    """Make the set ``name`` in the folder ``output``, or what is missing of it there; return what it lists.

    ``key``: what the seeds follow from, needed for the hidden half. Of specimens that are not there yet, only those of
    a ``task`` are made, where one is named, and none of a generator that ``writers`` lack. The bytes do not depend on
    ``workers``. Raises :class:`EndoctError` where ``output`` holds something else or a specimen cannot be made. It is
    also raised where a specimen that is there was changed, and where the set differs from the published one by more
    than rounding.
    """
    definition = load_definition(name)
    if (half == "hidden") == (key is None):
        raise EndoctError(f"the {half} half {'needs a key' if key is None else 'has a key of its own'}")
    key = definition.public_key if key is None else key
    if task is not None and task not in definition.tasks:
        raise EndoctError(f"{name} has no task '{task}'", expected=" or ".join(definition.tasks))
    wanted = [
        one
        for one in planned(definition, half, size, key)
        if one.kind.generator in writers
        and (task is None or task in one.kind.tasks or (output / one.name / SPECIMEN_FILE).is_file())
    ]
    key_digest = hashlib.sha256(str(key).encode()).hexdigest()
    begun = SpecimenSet(set=name, half=half, size=size, key=key_digest, versions=versions(), specimens=())
    with refusing_disk_errors(output), stages.stage(f"{len(wanted)} specimens of {name}") as advance:
        _begin(output, begun)
        try:
            entries = dict(_made(output, wanted, writers, workers, advance))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"{output} is begun, and the same command goes on with it") from None
        listed = begun.model_copy(update={"specimens": tuple(entries[one.name] for one in wanted)})
        _list(output, listed)
        write_deposit(output, listed)
    if half == "public":
        _check_published(listed)
    return listed


def _begin(output: Path, begun: SpecimenSet) -> None:
    """Write that a set is begun. Raises :class:`EndoctError` where ``output`` is another one, or something else."""
    check_place(output)
    if (output / SET_FILE).is_file():
        there = read_set(output)
        if (there.half, there.key) != (begun.half, begun.key):  # the same key, the same specimens
            raise EndoctError(
                f"{output} holds another set",
                found=f"the {there.half} half of {there.set}",
                expected=f"the {begun.half} half of {begun.set}, of the same key",
                remedy="choose another folder",
            )
        clear_dead_scratch(output)
        return
    if output.exists() and any(output.iterdir()):
        raise EndoctError(f"{output} is no set, and not empty", remedy="choose another folder")
    output.mkdir(parents=True, exist_ok=True)
    _list(output, begun)


def _list(output: Path, listed: SpecimenSet) -> None:
    with new_file(output / SET_FILE) as file:
        file.write((listed.model_dump_json(indent=1) + "\n").encode())


def _check_published(listed: SpecimenSet) -> None:
    """Raise :class:`EndoctError` where a specimen is not the one that was published."""
    published = shipped_entries(listed.set)
    others = [one.name for one in listed.specimens if one.name in published and not one.is_alike(published[one.name])]
    if others:
        raise EndoctError(
            f"{len(others)} specimens are not those that were published",
            found=", ".join(others[:3]),
            expected=f"what {listed.set} is made of",
            remedy="download the set: it was made by another version of endoct or of a library",
        )


def _made(
    output: Path, wanted: Sequence[Planned], writers: Mapping[str, Writer], workers: int, advance: Advance
) -> Iterator[tuple[str, Entry]]:
    from distributed import as_completed

    from endoct.workbench.running.cluster import own_cluster

    jobs = [partial(make_specimen, output, one, writers[one.kind.generator]) for one in wanted]
    with _environment(PLAIN_ARITHMETIC), own_cluster(min(workers, len(jobs))) as client:
        for done, future in enumerate(as_completed([client.submit(_plainly, job, pure=False) for job in jobs]), 1):
            entry = future.result()
            yield entry.name, entry
            advance(done / len(jobs))


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that start meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _plainly(job: Callable[[], Entry]) -> Entry:
    """Do a job without OpenCV's faster instructions, in a process that is there for such jobs alone."""
    cv2.setUseOptimized(False)
    return job()


def make_specimen(output: Path, specimen: Planned, write: Writer) -> Entry:
    """Make a specimen of a set with its panoramas, or check the one that is there; return its entry."""
    place, kind = output / specimen.name, specimen.kind
    if (place / SPECIMEN_FILE).is_file():
        with refusing(f"{place} is no specimen of a set", remedy="move it away; it is then made again"):
            stated = Entry.model_validate_json(read_small(place / SPECIMEN_FILE))
        check_specimen(output, stated)
        return stated.model_copy(update={"tasks": kind.tasks, "split": specimen.split})
    with scratch_next_to(place) as scratch:
        folder = scratch / specimen.name
        write(folder, specimen)
        for side in SIDES:
            if (folder / side).is_dir():
                panorama = api.unroll(folder / side, progress=False)
                inputs = {Path(path).name: digest for path, digest in panorama.provenance.get("inputs", {}).items()}
                stored = replace(panorama, provenance={**panorama.provenance, "inputs": inputs})
                save_panorama(stored, folder / f"{side}.zarr")
        entry = entry_of(folder, specimen)
        (folder / SPECIMEN_FILE).write_text(entry.model_dump_json(indent=1) + "\n", encoding="utf-8")
        folder.rename(place)
    return entry
