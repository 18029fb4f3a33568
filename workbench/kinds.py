"""What lies at a path: one table of kinds, each with its mark and its readers, and one walk through a folder.

A new kind is a row here, and a module with the functions that the row names. They are loaded when they are needed.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.contents import kind_of
from endoct.base.files.files import exists
from endoct.fusion.files.drawings import is_label_store
from endoct.fusion.files.outlines import OUTLINE_SUFFIXES
from endoct.fusion.files.store import COMPARISON_STORE, WALL_STORE, read_outline
from endoct.modalities.acquisition import sidecar_path
from endoct.modalities.ct.ct_volume import is_volume
from endoct.modalities.ct.trajectory import is_plan
from endoct.modalities.reading.recording import IMAGE_SUFFIXES, open_stack
from endoct.stitching.store import is_panorama
from endoct.workbench.running.outputs import COMPARISON, DATA_SET, DATA_SET_FILE, PANORAMA, POSE, SPECIMEN, SUMMARY

RECORDING, VOLUME, PLAN, MASK = "recording", "volume", "plan", "mask"
SAMPLE = Path("truth", "sample.json")
DEEPEST = 5
"""So many folders below the one that is looked through anything is looked for."""
MOST_FOLDERS = 50_000


@dataclass(frozen=True)
class PathKind:
    """What may lie at a path: ``is_at`` tells it by its mark. Its readers are "module:function", "" where it has none.

    Attributes: ``title`` in lists; ``described``, what `endoct info` says of a path; ``loaded``, what Python gets;
    ``listed``, what a table of outputs says; ``shown``, its page; ``pictured``, its thumbnail; ``has_recordings`` in
    the folders below.
    """

    name: str
    is_at: Callable[[Path], bool]
    title: str = ""
    described: str = ""
    loaded: str = ""
    listed: str = ""
    shown: str = ""
    pictured: str = ""
    has_recordings: bool = False


def is_comparison(path: Path) -> bool:
    """Say whether ``path`` is, or should be, a folder that `endoct compare` wrote."""
    return (path / COMPARISON_STORE).is_dir()


def check_has_wall(path: Path) -> None:
    """Raise :class:`EndoctError`, with the reason, where ``path`` is the one wall of a comparison that has none."""
    if path.name == WALL_STORE and is_comparison(path.parent) and not exists(path):
        raise EndoctError(
            f"{path.parent} has no wall of both sides",
            found=read_outline(path.parent / COMPARISON_STORE).result.reason or "",
            expected="two aligned sides, of which one measures depth and the other sees light",
        )


def is_mask(path: Path) -> bool:
    """Say whether ``path`` is a mask drawn by hand, not a recording.

    Outlines; one image of at most two values, or of whole numbers of 32 bits and more, which are labels; a Zarr store
    of labels. Raises :class:`EndoctError` where an image cannot be read.
    """
    if path.is_dir():
        return is_label_store(path) and not is_panorama(path) and not sidecar_path(path).is_file()
    if path.is_file() and path.suffix.lower() in OUTLINE_SUFFIXES:
        return True
    if not path.is_file() or path.suffix.lower() not in IMAGE_SUFFIXES or sidecar_path(path).is_file():
        return False
    stack = open_stack(path)
    if len(stack) != 1:
        return False
    stored = stack.stored(0)
    if stored.ndim == 3 and stored.shape[2] in (2, 4) and (stored[..., -1] == 0).any():
        return True  # drawn on a transparent ground
    return (stack.dtype.kind in "ui" and stack.dtype.itemsize >= 4) or np.unique(stack[0]).size <= 2


_INFORMATION, _VOLUMES = "endoct.workbench.pipeline.information", "endoct.workbench.pipeline.volumes"
_COLLECTION, _OPENING = "endoct.workbench.page.collection", "endoct.workbench.page.opening"
KINDS: dict[str, PathKind] = {
    row.name: row
    for row in (
        PathKind(
            COMPARISON,
            is_comparison,
            title="comparison",
            described=f"{_INFORMATION}:describe_comparison",
            loaded="endoct.fusion.files.store:load_compared",
            listed=f"{_COLLECTION}:listed_comparison",
            shown=f"{_OPENING}:opened_comparison",
            pictured=f"{_COLLECTION}:pictured_page",
        ),
        PathKind(
            PANORAMA,
            is_panorama,
            title="recording",
            described=f"{_INFORMATION}:describe_panorama",
            loaded="endoct.stitching.store:load_panorama",
            listed=f"{_COLLECTION}:listed_panorama",
            shown=f"{_OPENING}:opened_panorama",
            pictured=f"{_COLLECTION}:pictured_page",
        ),
        PathKind(
            SPECIMEN,
            lambda path: (path / SAMPLE).is_file(),
            title="specimen",
            listed=f"{_COLLECTION}:listed_specimen",
            pictured=f"{_COLLECTION}:pictured_specimen",
            has_recordings=True,
        ),
        PathKind(
            SUMMARY,
            lambda path: kind_of(path) == SUMMARY,
            title="summary",
            listed=f"{_COLLECTION}:listed_summary",
            pictured=f"{_COLLECTION}:pictured_summary",
        ),
        PathKind(DATA_SET, lambda path: (path / DATA_SET_FILE).is_file(), has_recordings=True),
        PathKind(
            POSE, lambda path: kind_of(path) == POSE, loaded="endoct.workbench.pipeline.summarising_poses:read_pose"
        ),
        PathKind(PLAN, lambda path: path.is_file() and is_plan(path), described=f"{_VOLUMES}:describe_volume"),
        PathKind(VOLUME, is_volume, described=f"{_VOLUMES}:describe_volume"),
        PathKind(MASK, is_mask),
        PathKind(RECORDING, lambda _: True),
    )
}
"""All kinds by name, in the order in which a path is asked for them. What is none of them may be a recording."""
INPUTS = (PLAN, VOLUME, MASK, RECORDING)


def output_at(path: Path) -> str | None:
    """Return which kind of output lies at ``path``, also one that has no row here; None where there is none.

    Raises :class:`EndoctError` where the list of an output cannot be read, or a comparison has no wall to give.
    """
    check_has_wall(path)
    outputs = (name for name, row in KINDS.items() if name not in INPUTS and row.is_at(path))
    return next(outputs, None) or kind_of(path)


def row_at(path: Path) -> PathKind | None:
    """Return the row of the output at ``path``; None where there is none. Raises what :func:`output_at` does."""
    return KINDS.get(output_at(path) or "")


def kind_at(path: Path) -> str:
    """Return which kind lies at ``path``; RECORDING where that is left, as a sidecar says or a plug-in has to.

    Raises :class:`EndoctError` where an image, or the list of an output, cannot be read.
    """
    if (output := output_at(path)) is not None:
        return output
    is_described = exists(sidecar_path(path))
    asked = (MASK, RECORDING) if is_described else INPUTS  # outlines are drawn, whatever lies beside them
    return next(name for name in asked if KINDS[name].is_at(path))


def reader(named: str) -> Callable[..., Any]:
    """Return the function that a row names as "module:function"."""
    module, _, function = named.partition(":")
    return getattr(import_module(module), function)  # type: ignore[no-any-return]


@dataclass
class Place:
    """A folder on the walk: ``output`` is the kind that lies there, None for any other.

    ``folders`` in it are gone into next; whoever walks takes out those that are of no use. Hidden ones are left out,
    and links are not followed.
    """

    path: Path
    output: str | None
    folders: list[Path]
    files: list[Path]


def places_in(folder: Path) -> Iterator[Place]:
    """Yield ``folder`` and the folders below it, each before what it holds.

    Raises :class:`EndoctError` where there is more than anybody could look through.
    """
    below, looked_at = [(folder, 0)], 0
    while below:
        if (looked_at := looked_at + 1) > MOST_FOLDERS:
            raise EndoctError(f"{folder} has too many folders to look through", expected=f"{MOST_FOLDERS} at most")
        here, depth = below.pop()
        try:
            output = output_at(here)
        except (EndoctError, OSError):  # a list that is damaged, or a folder that is somebody else's, says nothing
            output = None
        place = Place(here, output, *_listed(here))
        yield place
        if depth < DEEPEST:
            below += [(path, depth + 1) for path in reversed(place.folders)]


def _listed(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the folders and the files in ``folder``, each by name; none where it is somebody else's."""
    try:
        with os.scandir(folder) as scan:
            listed = [each for each in scan if not each.name.startswith(".")]
            folders = [Path(each.path) for each in listed if each.is_dir(follow_symlinks=False)]
            files = [Path(each.path) for each in listed if each.is_file(follow_symlinks=False)]
    except OSError:
        return [], []
    return sorted(folders), sorted(files)
