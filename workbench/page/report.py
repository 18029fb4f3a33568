"""Reports: figures as files, and the page as one file that opens offline; of a comparison, or of one recording.

The file holds the page's program, its style, its description, and tiles down to some level.
"""

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote

from markupsafe import Markup

from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.files.contents import is_marked, read_contents, whole_of, write_marked
from endoct.base.files.output import check_output, new_output
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.kinds import output_at
from endoct.workbench.page.heading import bundled, document
from endoct.workbench.page.layers import MOST_SAMPLES, is_blank, png_of
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.shown import Shown
from endoct.workbench.report.figures.rendered import (
    Drawn,
    Figures,
    begin_both,
    begin_pictures,
    begin_wall,
    drawn_of,
    write_figures,
)
from endoct.workbench.report.findings import Findings, read_findings
from endoct.workbench.report.sections import Section, recording_sections, report_sections
from endoct.workbench.report.side_findings import SideFindings, recording_in
from endoct.workbench.running.outputs import FIGURES, PANORAMA, REPORT
from endoct.workbench.running.scheduler import ALONE, Scheduler

PAGE = "report.html"
REMARK = "The figures lie next to this page, lossless, in figures/."
MOST_TILE_BYTES = 8_000_000
"""Bytes of all tiles together: with text, figures and pictures of frames a page then has at most 15 MB."""
GROWTH = 3.5
"""About how many times the bytes of a level the next one takes: it has four times the pixels."""


def write_report(path: Path, scheduler: Scheduler = ALONE) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``path``, replacing older ones; return the page's path.

    ``path`` is what ``endoct compare`` or ``endoct unroll`` wrote; nothing else in it is changed. Raises
    :class:`EndoctError` where ``path`` is neither, not whole, or cannot be written.
    """
    if output_at(path) == PANORAMA:
        contents = read_contents(path)
        if contents is None or PAGE not in contents.parts:
            raise EndoctError(
                f"{path} has no report of its own",
                found="no list of what it holds" if contents is None else "a panorama that was unrolled without one",
                expected="a panorama written by `endoct unroll`, or a folder written by `endoct compare`",
                remedy=f"unroll the recording again, or look at it by `endoct serve {quote(str(path))}`",
            )
        return write_panorama_report(path, load_panorama(path), scheduler)
    _check(path)
    findings = read_findings(path)
    return write_comparison_report(path, findings, begin_both(findings, scheduler, with_sides=True))


def write_comparison_report(folder: Path, findings: Findings, begun: Sequence[Figures]) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of a comparison into its ``folder``, which holds all but these.

    ``findings`` are what it holds, ``begun`` its figures but those of its scores. Returns the page's path. Raises
    :class:`EndoctError` where they cannot be written.
    """
    shown = open_shown(folder)
    data = frozen_data(shown)
    figures = drawn_of(findings, begun)
    return _write(folder, shown, figures, report_sections(findings, figures), data)


def write_panorama_report(store: Path, panorama: Panorama, scheduler: Scheduler = ALONE) -> Path:
    """Write ``figures/*.png`` and ``report.html`` of one recording into the ``store`` of its ``panorama``.

    Returns the page's path. Raises :class:`EndoctError` where they cannot be written.
    """
    _check(store)
    side = recording_in(store, panorama)
    return write_recording_report(store, side, [begin_wall(panorama, scheduler), begin_pictures(side, scheduler)])


def write_recording_report(store: Path, side: SideFindings, begun: Sequence[Figures]) -> Path:
    """Write the report of a recording into its ``store``, which holds all but that; return the page's path.

    ``side``: what it holds, ``begun`` its figures. Raises :class:`EndoctError` where they cannot be written.
    """
    shown = open_shown(store)
    data = frozen_data(shown)
    figures = [one for figures in begun for one in figures.result()]
    sections = recording_sections(side, shown.side(side.name).outline, figures)
    return _write(store, shown, figures, sections, data)


def _check(folder: Path) -> None:
    """Raise :class:`EndoctError` where a report may not be written, before any work is done."""
    if (whole := whole_of(folder)) is not None:
        raise EndoctError(
            f"{folder} is a part of {whole.name}, which lists all that it holds",
            found="a part without a report of its own",
            remedy=f"look at it by `endoct serve {quote(str(folder))}`, or write the report of a copy of that folder",
        )
    for part in (folder / PAGE, folder / "figures"):
        if part.is_symlink():
            raise EndoctError(f"{part} is a link", expected="what endoct wrote", remedy="move it away")
    check_output(folder / PAGE, REPORT, overwrite=True, is_ours=is_marked)
    check_output(folder / "figures", FIGURES, overwrite=True)


def _write(folder: Path, shown: Shown, drawn: Sequence[Drawn], sections: Sequence[Section], data: Markup) -> Path:
    page = folder / PAGE
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        write_figures(drawn, figures)
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        write_marked(frozen_page(shown, sections, data, REMARK), scratch)
    return page


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
    """Return as JSON what the page's program else asks a server for: tiles, outlines, pictures of ``shown``.

    Tiles go down to the finest level for which there is room.
    """
    # without what only a server can do: to read recordings again, and to send a volume
    frames, keys = tuple(replace(part, recording="") for part in shown.description.frames), shown.reliefs
    held = {
        "description": replace(shown.description, frames=frames, has_volume=False).to_json(),
        "outlines": shown.outlines(),
        "pictures": {
            part.side: {str(place): shown.pictures(part.side, place) for place in part.pictured} for part in frames
        },
        "tiles": tiles_of(shown),
        # together they have no more samples than one may have
        "reliefs": {key: _base64(shown.relief(key, MOST_SAMPLES // len(keys))) for key in keys},
        "session": None if shown.session is None else shown.session.state(offline=True),
        "type": "image/png",
    }
    # within a script element nothing but "<" can end it
    return Markup(json.dumps(held, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def tiles_of(shown: Shown) -> dict[str, list[dict[str, str]]]:
    """Return the pictures of tiles in base64 by layer, level and "column_row"; blank ones are left out."""
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
        return {f"{column}_{row}": _base64(png_of(tile)) for column, tile in tiles if not is_blank(tile)}

    held: dict[str, str] = {}
    for one in thread_map(coded, range(shown.wall.rows_of_tiles(level))):
        held |= one
    return held


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _digest(text: str) -> str:
    """Return the hash by which a content security policy allows a script or style."""
    return f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'"
