"""The page as one file that opens offline: its program, its style, its description and tiles down to some level."""

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from markupsafe import Markup
from PIL import Image as Pillow

from endoct.base.compute.parallel import thread_map
from endoct.workbench.page.description import Description
from endoct.workbench.page.heading import bundled, document
from endoct.workbench.page.layers import MOST_SAMPLES, is_blank, png_of
from endoct.workbench.page.shown import Shown
from endoct.workbench.report.sections import Section

MOST_TILE_BYTES = 8_000_000
"""Of all tiles together: with the text, its figures and the pictures of frames a page then has at most 15 MB."""
GROWTH = 3.5
"""Times the bytes of a level that the next one takes, about: it has four times the pixels."""


def frozen_page(shown: Shown, sections: Sequence[Section], data: Markup, remark: str = "") -> Markup:
    """Return the page of ``shown`` as HTML that needs nothing else: no server, no network, no other file.

    ``data`` is its :func:`frozen_data`; ``remark`` is said at its end.
    """
    programs, style = (bundled("cylinder.js"), bundled("page.js")), bundled("page.css")
    policy = (
        f"default-src 'none'; script-src {' '.join(map(_digest, programs))}; "
        f"style-src {_digest(style)} {_digest('')}; img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return document(
        "page/frozen.html",
        shown.heading,
        sections,
        remark=remark,
        policy=policy,
        style=style,
        data=data,
        programs=programs,
    )


def frozen_data(shown: Shown) -> Markup:
    """Return as JSON what the program of the page of ``shown`` asks a server for: tiles, outlines, pictures.

    Tiles go down to the finest level for which there is room.
    """
    held = {
        "description": _alone(shown.description).to_json(),
        "outlines": shown.outlines(),
        "pictures": pictures_of(shown),
        "tiles": tiles_of(shown),
        "reliefs": reliefs_of(shown),
        "session": None if shown.session is None else shown.session.state(offline=True),
        "type": "image/png",
    }
    # within a script element nothing but "<" can end it
    return Markup(json.dumps(held, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def _alone(description: Description) -> Description:
    """Return the description without what only a server can do: to read recordings again, and to send a volume."""
    frames = tuple(replace(part, recording="") for part in description.frames)
    return replace(description, frames=frames, has_volume=False)


def pictures_of(shown: Shown) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return by side, by the frame's place, the pictures of single frames that were kept."""
    return {
        part.side: {str(place): shown.pictures(part.side, place) for place in part.pictured}
        for part in shown.description.frames
    }


def reliefs_of(shown: Shown) -> dict[str, str]:
    """Return the reliefs of the sides in base64, together of no more samples than one may have."""
    keys = shown.reliefs
    held = {key: shown.relief(key, MOST_SAMPLES // len(keys)) for key in keys}
    return {key: base64.b64encode(one).decode("ascii") for key, one in held.items()}


def tiles_of(shown: Shown) -> dict[str, list[dict[str, str]]]:
    """Return by layer, by level, by "column_row", the pictures of tiles in base64; blank ones are left out."""
    finest = {layer.key: layer.finest_level for layer in shown.description.layers}
    held: dict[str, list[dict[str, str]]] = {key: [] for key in finest}
    n_bytes = last = 0
    for level in range(max(finest.values()) + 1):
        if level and n_bytes + GROWTH * last > MOST_TILE_BYTES:
            break
        last = 0
        for key in (key for key, most in finest.items() if level <= most):
            held[key].append(_level(shown, key, level))
            last += sum(map(len, held[key][-1].values()))
        n_bytes += last
    return held


def _level(shown: Shown, key: str, level: int) -> dict[str, str]:
    def coded(row: int) -> dict[str, str]:
        tiles = enumerate(shown.row_of_tiles(key, level, row))
        return {f"{column}_{row}": _base64(tile) for column, tile in tiles if not is_blank(tile)}

    held: dict[str, str] = {}
    for one in thread_map(coded, range(shown.wall.rows_of_tiles(level))):
        held |= one
    return held


def _base64(tile: Pillow.Image) -> str:
    return base64.b64encode(png_of(tile)).decode("ascii")


def _digest(text: str) -> str:
    """Return how a content security policy names the one script or style that a page may have."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"
