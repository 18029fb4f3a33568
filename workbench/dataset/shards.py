"""Shards: tar files as the webdataset library reads them, the same bytes from any machine."""

import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np

from endoct.workbench.dataset.reading import read_specimen

AS_THEY_ARE = {
    "sample.json": "truth/sample.json",
    "recording.json": "truth/recording.json",
    "oct.toml": "oct/acquisition.toml",
    "endoscope.toml": "endoscope/acquisition.toml",
}


@contextmanager
def new_shard(path: Path) -> Iterator[tarfile.TarFile]:
    """Open a new tar file to add specimens to."""
    with tarfile.open(path, "x", format=tarfile.USTAR_FORMAT) as tar:
        yield tar


def add_specimen(tar: tarfile.TarFile, name: str, folder: Path) -> None:
    """Add the specimen in ``folder``: its arrays as ``NAME.array.npy``, its sidecars and what was drawn as they are."""
    for array, values in read_specimen(folder).items():
        buffer = BytesIO()
        np.save(buffer, values, allow_pickle=False)
        _add(tar, f"{name}.{array}.npy", buffer.getvalue())
    for member, path in AS_THEY_ARE.items():
        _add(tar, f"{name}.{member}", (folder / path).read_bytes())


def copy_specimens(shard: Path, tar: tarfile.TarFile) -> None:
    """Add all that ``shard`` holds."""
    with tarfile.open(shard) as old:
        for member in old:
            if (file := old.extractfile(member)) is not None:
                tar.addfile(member, file)


def _add(tar: tarfile.TarFile, member: str, data: bytes) -> None:
    info = tarfile.TarInfo(member)  # owner, time and rights are those of TarInfo: nobody, 1970, 644
    info.size = len(data)
    tar.addfile(info, BytesIO(data))
