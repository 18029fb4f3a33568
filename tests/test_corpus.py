"""Files that once ended in a traceback, a hang or much memory, or try to: ``corpus/READER/what-it-is.ext``.

``what-it-is.tree.zip`` is unpacked, and its folder read; ``what-it-is.on-2.zip`` is unpacked over the reader's sound
folder 2 (:func:`benchmarks.fuzz.readers.seeds_of`); ``what-it-is.json`` for a reader of folders takes the place of one
file of its sound folder 0 (:data:`IN_PLACE`).
"""

import sys
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import pytest

from benchmarks.fuzz.outcome import READ, REFUSED, outcome_of
from benchmarks.fuzz.readers import READERS, seeds_of
from benchmarks.fuzz.trees import write_tree

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="watches time and memory as POSIX has it")

CORPUS = Path(__file__).parent / "corpus"
FILES = sorted(path for path in CORPUS.glob("*/*") if path.is_file())
IN_PLACE = {
    ("sidecar", ".toml"): "acquisition.toml",
    ("describe", ".json"): "result.json",
    ("report", ".json"): "result.json",
    ("summary", ".json"): "a/x/1/result.json",
    ("truth", ".json"): "truth/recording.json",
    ("specimens", ".json"): "dataset.json",
    ("specimens", ".csv"): "manifest.csv",
    ("records", ".json"): "dataset.json",
}
"""By reader and suffix the file of its first sound folder that a file of the corpus stands for."""
MOST_BYTES = 600_000_000
PATIENT_S = 120.0
"""Ends a hang; no test depends on how long a reader takes."""


def put(file: Path, case: Path) -> Path:
    """Write what is to be read into ``case``, and return what the reader is given."""
    reader, how = file.parent.name, Path(file.stem).suffix
    if file.suffix == ".zip" and how:
        sound = seeds_of(reader)[int(how.removeprefix(".on-")) if how != ".tree" else 0]
        with zipfile.ZipFile(file) as archive:
            changed = {info.filename: archive.read(info) for info in archive.infolist()}
        write_tree(({} if how == ".tree" else dict(sound.files)) | changed, case)
        return case / sound.target if (case / sound.target).exists() else case
    place = IN_PLACE.get((reader, file.suffix))
    if place is None:
        write_tree({file.name: file.read_bytes()}, case)
        return case / file.name
    write_tree({**seeds_of(reader)[0].files, place: file.read_bytes()}, case)
    return case


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_is_read_or_refused_in_one_line_within_bounds(file: Path, tmp_path: Path) -> None:
    reader = READERS[file.parent.name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        target = put(file, tmp_path / "case")
        tracemalloc.start()
        try:
            outcome = outcome_of(reader.read, target, case=tmp_path / "case", seconds=PATIENT_S)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert outcome.kind in (READ, REFUSED), f"{outcome.kind} in {outcome.where}\n{outcome.message}"
    assert most < MOST_BYTES


def test_the_corpus_is_small() -> None:
    assert len(FILES) >= 40
    assert max(file.stat().st_size for file in FILES) < 4000
    assert sum(file.stat().st_size for file in FILES) < 150_000
