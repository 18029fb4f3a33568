"""What the files of a recording state themselves, and where its sidecar says otherwise."""

from pathlib import Path
from typing import Any

from endoct.base.doubt import Doubt
from endoct.modalities.acquisition import SIDECAR_NAME, Acquisition
from endoct.modalities.reading.format import Stated
from endoct.modalities.reading.recording import stated_by
from endoct.modalities.reading.remarks import NONE, Remarks

TOLERANCE = 0.01
"""Numbers that differ by less than this share are the same, as people round them."""


def stated_keys(path: Path, acquisition: type[Acquisition]) -> Stated:
    """Return the keys of ``acquisition`` that the files at ``path`` state themselves.

    Raises :class:`EndoctError` where they cannot be read.
    """
    stated = stated_by(path)
    fields = acquisition.model_fields
    return Stated({key: value for key, value in stated.keys.items() if key in fields}, stated.by)


def on_stated(path: Path, acquisition: Acquisition) -> Remarks:
    """Return a doubt for every key for which ``acquisition`` has another value than the files at ``path`` state.

    Raises :class:`EndoctError` where these cannot be read.
    """
    stated = stated_keys(path, type(acquisition))
    differing = [
        f"{key} is {_text(used)} in {SIDECAR_NAME} or the settings, and {_text(value)} in {stated.by}"
        for key, value in stated.keys.items()
        if _differ(used := getattr(acquisition, key), value)
    ]
    if not differing:
        return NONE
    what = f"The recording's files state something else than was used: {'; '.join(differing)}."
    return Remarks(doubts=(Doubt("stated-otherwise", what),))


def _differ(used: Any, stated: Any) -> bool:
    if isinstance(used, int | float) and isinstance(stated, int | float):
        return abs(used - stated) > TOLERANCE * max(abs(used), abs(stated))
    return not isinstance(stated, list | tuple | dict) and used != stated


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
