"""What a format of recordings is: which files it claims, how their frames are read, what they state by themselves.

Each format is a module of this room that ends in one :class:`Format`. At its top stand what the format is, where that
is specified, and its traps. They are asked in the order of :data:`endoct.modalities.reading.recording.FORMATS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks

Files = tuple[Path, ...]
"""What one recording lies in: one file or folder, or the files of a folder that are one recording together."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Opened files: how many frames they hold, and ``read``, which returns one of them by its index.

    A frame is (row, column) or (row, column, channel); of an OCT it is (depth, A-scan). ``read`` is picklable, and safe
    to share among threads. ``along``: what the files say of the frames' places; ``remarks``: notes and doubts on them.
    """

    n_frames: int
    read: Callable[[int], NDArray[Any]]
    along: Along | None = None
    remarks: Remarks = NONE


@dataclass(frozen=True)
class Stated:
    """Keys of a sidecar that the files of a recording state themselves, ``modality`` among them where they say it.

    ``by``: where they do, in words, as "the header of scan.oct". A sidecar's own keys replace them; values that differ
    are doubted.
    """

    keys: Mapping[str, Any] = field(default_factory=dict)
    by: str = ""


@dataclass(frozen=True, eq=False)
class Format:
    """A format of recordings.

    Attributes: ``name``, as a message names it; ``claims`` says by its content, cheaply, whether a file is of it (a
    folder, where ``is_folder``), and never raises; ``open`` and ``states`` take the files of one recording and raise
    :class:`~endoct.base.errors.EndoctError` where these cannot be read. ``joins``: several such files in a folder are
    one recording.

    >>> import numpy as np
    >>> def open_stack(files):
    ...     frames = np.memmap(files[0], np.uint8, "r", offset=4).reshape(-1, 512, 1024)
    ...     return Frames(len(frames), frames.__getitem__)
    >>> raw = Format("a stack of ours", lambda path: path.read_bytes()[:4] == b"OURS", open_stack)
    >>> path = Path("pullback.raw")
    >>> path.write_bytes(b"OURS" + bytes(3 * 512 * 1024))
    1572868
    >>> raw.claims(path), raw.open((path,)).n_frames, raw.open((path,)).read(2).shape
    (True, 3, (512, 1024))
    """

    name: str
    claims: Callable[[Path], bool]
    open: Callable[[Files], Frames]
    states: Callable[[Files], Stated] = lambda _: Stated()
    is_folder: bool = False
    joins: bool = False
