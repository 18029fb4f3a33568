"""The page as one file that opens offline: its program, its style, its description and tiles down to some level."""

import base64
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from importlib.resources import files
from typing import Any

from endoct.stitching.parallel import thread_map
from endoct.workbench.page.description import Description
from endoct.workbench.page.document import document
from endoct.workbench.page.layer import is_blank
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import TILE_PX, Tile
from endoct.workbench.report.sections import Section

PACKAGE = "endoct.workbench.page"
MOST_BYTES = 14_500_000
"""Of a page: tiles take what all else leaves."""
GROWTH = 3.5
"""Times the bytes of a level that the next one takes, about: it has four times the pixels."""


def frozen_page(shown: Shown, sections: Sequence[Section] | None = None, remark: str = "") -> str:
    """Return the page of ``shown`` as HTML that needs nothing else: no server, no network, no other file.

    With other ``sections`` than those of ``shown`` where some are given. Tiles go down to the finest level for which
    there is room.
    """
    script, style = (files(PACKAGE).joinpath("bundle", name).read_text("utf-8") for name in ("page.js", "page.css"))
    policy = (
        f"default-src 'none'; script-src {_digest(script)}; style-src {_digest(style)} {_digest('')}; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n'
        f'<meta name="referrer" content="no-referrer">\n<style>{style}</style>\n'
    )
    text = document(shown.heading, shown.sections if sections is None else sections, head=head, remark=remark)
    held = {
        "description": _alone(shown.description).to_json(),
        "outlines": shown.outlines(),
        "pictures": pictures_of(shown),
        "type": "image/png",
    }
    rest = json.dumps(held, allow_nan=False, separators=(",", ":"))[1:]
    tiles = json.dumps(tiles_of(shown, MOST_BYTES - len(text) - len(rest) - len(script)), separators=(",", ":"))
    # within a script element nothing but "<" can end it
    data = f'{{"tiles":{tiles},{rest}'.replace("<", "\\u003c")
    foot = f'<script type="application/json" id="frozen">{data}</script>\n<script>{script}</script>\n'
    before, end, after = text.rpartition("</body>")
    return f"{before}{foot}{end}{after}"


def _alone(description: Description) -> Description:
    """Return the description without what only a server can do: to read recordings again, from where they lie."""
    return replace(description, frames=tuple(replace(part, recording="") for part in description.frames))


def pictures_of(shown: Shown) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return by side, by the frame's place, the pictures of single frames that were kept."""
    return {
        part.side: {str(place): shown.pictures(part.side, place) for place in part.pictured}
        for part in shown.description.frames
    }


def tiles_of(shown: Shown, most_bytes: int) -> dict[str, list[dict[str, str]]]:
    """Return by layer, by level, by "column_row", the pictures of tiles in base64; blank ones are left out.

    All together have about ``most_bytes`` at most.
    """
    finest = {layer.key: layer.finest_level for layer in shown.description.layers}
    held: dict[str, list[dict[str, str]]] = {key: [] for key in finest}
    n_bytes = last = 0
    for level in range(max(finest.values()) + 1):
        if level and n_bytes + GROWTH * last > most_bytes:
            break
        last = 0
        for key in (key for key, most in finest.items() if level <= most):
            held[key].append(_level(shown, key, level))
            last += sum(map(len, held[key][-1].values()))
        n_bytes += last
    return held


def _level(shown: Shown, key: str, level: int) -> dict[str, str]:
    tiles = list(_tiles(shown, level))
    pictures = thread_map(lambda tile: shown.png(key, tile), tiles)
    found = zip(tiles, pictures, strict=True)
    return {f"{t.column}_{t.row}": base64.b64encode(one).decode("ascii") for t, one in found if not is_blank(one)}


def _tiles(shown: Shown, level: int) -> Iterator[Tile]:
    for row in range(-(-shown.wall.height_px(level) // TILE_PX)):
        for column in range(shown.wall.width_px(level) // TILE_PX):
            yield Tile(level, column, row)


def _digest(text: str) -> str:
    """Return how a content security policy names the one script or style that a page may have."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"
