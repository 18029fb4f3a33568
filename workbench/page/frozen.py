"""The page as one file that opens offline: its program, its style, its description and tiles down to some level."""

import base64
import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from importlib.resources import files
from typing import Any

from endoct.stitching.parallel import thread_map
from endoct.workbench.page.description import Description
from endoct.workbench.page.layer import is_blank
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import TILE_PX, Tile

PACKAGE = "endoct.workbench.page"
MOST_TILE_BYTES = 10_000_000
"""Of all pictures together; in base64 they take a third more."""
GROWTH = 3.5
"""Times the bytes of a level that the next one takes, about: it has four times the pixels."""


def frozen_page(shown: Shown) -> str:
    """Return the page of ``shown`` as HTML that needs nothing else: no server, no network, no other file.

    Tiles go down to the finest level for which there is room.
    """
    script, style = (files(PACKAGE).joinpath("bundle", name).read_text("utf-8") for name in ("page.js", "page.css"))
    held = {
        "description": _alone(shown.description).to_json(),
        "outlines": shown.outlines(),
        "tiles": tiles_of(shown),
        "pictures": pictures_of(shown),
        "type": "image/png",
    }
    # within a script element nothing but "<" can end it
    data = json.dumps(held, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    policy = (
        f"default-src 'none'; script-src {_digest(script)}; style-src {_digest(style)} {_digest('')}; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n'
        '<meta name="referrer" content="no-referrer">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(shown.description.title)}</title>\n<link rel="icon" href="data:,">\n<style>{style}</style>\n'
        "</head>\n<body>\n<noscript>This page needs JavaScript.</noscript>\n"
        f'<script type="application/json" id="frozen">{data}</script>\n<script>{script}</script>\n</body>\n</html>\n'
    )


def _alone(description: Description) -> Description:
    """Return the description without what only a server can do: to read recordings again, from where they lie."""
    return replace(description, frames=tuple(replace(part, recording="") for part in description.frames))


def pictures_of(shown: Shown) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return by side, by the frame's place, the pictures of single frames that were kept."""
    return {
        part.side: {str(place): shown.pictures(part.side, place) for place in part.pictured}
        for part in shown.description.frames
    }


def tiles_of(shown: Shown) -> dict[str, list[dict[str, str]]]:
    """Return by layer, by level, by "column_row", the pictures of tiles in base64; blank ones are left out."""
    finest = {layer.key: layer.finest_level for layer in shown.description.layers}
    held: dict[str, list[dict[str, str]]] = {key: [] for key in finest}
    n_bytes = last = 0
    for level in range(max(finest.values()) + 1):
        if n_bytes + GROWTH * last > MOST_TILE_BYTES:
            break
        last = 0
        for key in (key for key, most in finest.items() if level <= most):
            names, pictures = _level(shown, key, level)
            last += sum(map(len, pictures))
            held[key].append(
                {name: base64.b64encode(one).decode("ascii") for name, one in zip(names, pictures, strict=True)}
            )
        n_bytes += last
    return held


def _level(shown: Shown, key: str, level: int) -> tuple[list[str], list[bytes]]:
    tiles = list(_tiles(shown, level))
    pictures = list(thread_map(lambda tile: shown.png(key, tile), tiles))
    kept = [(tile, one) for tile, one in zip(tiles, pictures, strict=True) if not is_blank(one)]
    return [f"{tile.column}_{tile.row}" for tile, _ in kept], [one for _, one in kept]


def _tiles(shown: Shown, level: int) -> Iterator[Tile]:
    for row in range(-(-shown.wall.height_px(level) // TILE_PX)):
        for column in range(shown.wall.width_px(level) // TILE_PX):
            yield Tile(level, column, row)


def _digest(text: str) -> str:
    """Return how a content security policy names the one script or style that a page may have."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"
