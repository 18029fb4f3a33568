"""Doubts in the JSON of a result, also in that of older versions."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, InstanceOf, PlainSerializer

from endoct.stitching.doubt import Doubt, as_doubt, without_doubts
from endoct.stitching.errors import EndoctError


def _read(given: object) -> Doubt:
    try:
        return as_doubt(given)
    except EndoctError as error:  # pydantic collects ValueErrors only
        raise ValueError(str(error)) from error


StoredDoubt = Annotated[InstanceOf[Doubt], BeforeValidator(_read), PlainSerializer(Doubt.to_json)]
"""A doubt that a result's JSON holds as an object."""


def with_doubts_as_list(stored: Mapping[str, object]) -> Mapping[str, object]:
    """Return the object of a ``result.json`` with one list of doubts.

    Older versions wrote sentences by side, which their notes repeated. What is of neither form is left as it is.
    """
    by_side = stored.get("doubts")
    if not isinstance(by_side, Mapping) or not all(_is_texts(said) for said in by_side.values()):
        return stored
    doubts = tuple(_read(text).of_side(str(side)) for side, said in by_side.items() for text in said)
    notes = stored.get("notes")
    if isinstance(notes, Mapping) and all(_is_texts(said) for said in notes.values()):
        notes = {side: without_doubts(tuple(said), doubts) for side, said in notes.items()}
    return {**stored, "doubts": doubts} | ({} if notes is None else {"notes": notes})


def _is_texts(said: object) -> bool:
    return isinstance(said, list | tuple) and all(isinstance(text, str) for text in said)
