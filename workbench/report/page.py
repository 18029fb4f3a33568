"""The report of a comparison: figures as files, and one page that holds everything and opens offline."""

import base64
import hashlib
from collections.abc import Iterator, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from endoct.stitching.contents import is_marked, marked
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, new_output
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.report.doubts import count_doubts, count_notes, doubts_box, notes_table
from endoct.workbench.report.figures.all import draw_on_grid, draw_on_own_rows
from endoct.workbench.report.figures.drawing import Drawn
from endoct.workbench.report.findings import Findings, read_findings
from endoct.workbench.report.quality import quality_of
from endoct.workbench.report.scores import score_tables
from endoct.workbench.report.tables import numbers, provenance, threshold_text
from endoct.workbench.report.verdict import placement, strength
from endoct.workbench.report.wording import interval_text, share_text, without_stop
from endoct.workbench.report.words import words
from endoct.workbench.running.kinds import FIGURES, REPORT
from endoct.workbench.running.refusals import visible_lines

CSS_PIXELS_PER_INCH = 148
FIGURE_SECTIONS = {
    "panoramas": "Panoramas",
    "masks": "Cells and difference",
    "agreement": "How far they agree, and what stands in the way",
    "alignment": "Alignment",
    "depth": "Depth",
    "frames": "Single frames, as recorded and as processed",
    "cylinder": "The bore in three dimensions",
}


def write_report(folder: Path, process: WorkerProcess | None = None) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``folder``, replacing older ones; return the page's path.

    Half of the figures are drawn in ``process`` where there is one. ``folder`` is what ``endoct compare``
    wrote; nothing else in it is changed. Raises :class:`EndoctError` where it is no whole comparison or cannot be
    written.
    """
    page = folder / "report.html"
    for part in (page, folder / "figures"):
        if part.is_symlink():
            raise EndoctError(f"{part} is a link", expected="what endoct wrote", remedy="move it away")
    check_output(page, REPORT, overwrite=True, is_ours=is_marked)
    check_output(folder / "figures", FIGURES, overwrite=True)
    findings = read_findings(folder)
    with new_output(folder / "figures", FIGURES, overwrite=True) as figures:
        figures.mkdir()
        there = None if process is None else process.call(_draw_there, folder, figures)
        on_grid = draw_on_grid(findings, figures)
        own = draw_on_own_rows(findings, figures) if there is None else there.result()
        html = page_html(findings, [*on_grid, *own])
    with new_output(page, REPORT, overwrite=True, is_ours=is_marked) as scratch:
        scratch.write_text(marked(html), encoding="utf-8")
    return page


def _draw_there(folder: Path, figures: Path) -> list[Drawn]:
    return draw_on_own_rows(read_findings(folder), figures)


def page_html(findings: Findings, drawn: Sequence[Drawn]) -> str:
    """Return the whole page, figures and style embedded; figures by section, in the order given."""
    of_frames = [f"{part}-{side.name}" for side in findings.sides for part in ("quality", "numbers")]
    bodies = dict.fromkeys((*FIGURE_SECTIONS, *of_frames), "")
    for number, figure in enumerate(sorted(drawn, key=lambda one: list(bodies).index(one.section)), 1):
        bodies[figure.section] += _figure(number, figure)
    bodies["agreement"] += "".join(score_tables(findings.result))
    titles = FIGURE_SECTIONS if findings.aligned else FIGURE_SECTIONS | {"masks": "Cells"}
    quality = (
        "".join(quality_of(side, bodies[f"quality-{side.name}"], bodies[f"numbers-{side.name}"]))
        for side in findings.sides
    )
    sections = [
        *(_section(name, title, bodies[name]) for name, title in titles.items()),
        _section("numbers", "Numbers", "".join(numbers(findings))),
        _section("notes", "Notes", notes_table(findings.result)),
        _section("quality", "Quality along the bore", "".join(quality)),
        _section("words", "Words", words(findings)),
        _section("provenance", "How it was made", "".join(provenance(findings.result))),
    ]
    a, b = findings.sides
    heading = f"{a.name} and {b.name}: one bore, compared"
    version = findings.result.versions.get("endoct", "")
    style = files("endoct.workbench.report").joinpath("report.css").read_text(encoding="utf-8")
    template = Template(files("endoct.workbench.report").joinpath("report.html").read_text(encoding="utf-8"))
    page = template.substitute(
        title=escape(f"endoct: {heading}"),
        style=style,
        style_digest=_digest(style),
        heading=escape(heading),
        headline="".join(_headline(findings)),
        sections="\n".join(sections),
        footer=escape(f"Written by endoct {version}. The figures lie next to this page, lossless, in figures/."),
    )
    return visible_lines(page)  # a text from a file turns nothing around, and can be encoded


def _digest(style: str) -> str:
    """Return how a content security policy names the one style that a page may have."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(style.encode()).digest()).decode('ascii')}'"


def _headline(findings: Findings) -> Iterator[str]:
    result = findings.result
    a, b = (side.name for side in findings.sides)
    if alignment := result.alignment if findings.aligned else None:
        stands_out = escape(strength(alignment))
        if result.doubts:
            yield f'<p class="verdict doubted">Aligned, with {count_doubts(result.doubts)}.</p>\n'
            yield f"{doubts_box(result.doubts)}<p>Aligned {stands_out}</p>\n"
        else:
            yield f'<p class="verdict aligned">Aligned {stands_out}</p>\n'
        yield f"<p>{escape(placement(a, b, alignment))}</p>\n"
    else:
        yield '<p class="verdict unaligned">Not aligned: the two sides could not be brought onto each other.</p>\n'
        yield doubts_box(result.doubts)
        yield (
            f"<p>Reason: {escape(without_stop(result.reason))}. Without an alignment no place on one side "
            "corresponds to a place on the other, so the two are not scored against each other and there is no "
            "difference image. Everything below shows each side by itself.</p>\n"
        )
    if cards := "".join(_cards(findings)):
        yield f'<ul class="cards">{cards}</ul>\n'
    yield f"<p>{escape(_conditions(findings))}</p>\n"
    if count := count_notes(result):
        said = "1 note" if count == 1 else f"{count} notes"
        yield f'<p><a href="#notes">{said}</a>, below.</p>\n'


def _cards(findings: Findings) -> Iterator[str]:
    def card(title: str, value: str, of: str) -> str:
        return f"<li><span>{escape(title)}</span><b>{escape(value)}</b><span>{escape(of)}</span></li>"

    for named in findings.overlaps:
        if named.is_detail:
            continue
        of = f"cells of {named.of[0]} and {named.of[1]}, {named.where}"
        if named.overlap.jaccard_interval:
            of += f"; {interval_text(named.overlap.jaccard_interval)}"
        yield card("Jaccard index", share_text(named.overlap.jaccard), of)
    result = findings.result
    if result.aligned:
        yield card("Dice", share_text(result.dice), "on the common grid")
        over = f" over the {result.overlap_mm:.1f} mm that they share" if result.overlap_mm is not None else ""
        yield card("Observed", f"{result.valid_fraction:.1%}", f"of the wall, by both sides{over}")


def _conditions(findings: Findings) -> str:
    grid, thresholds = findings.grid, findings.result.threshold or {}
    parts = [
        f"Common grid: {grid.n_z} × {grid.n_theta} samples (z × θ), {grid.dz_mm * 1000:.3g} µm along the bore and "
        f"{grid.dtheta_mm * 1000:.3g} µm around it at a bore radius of {grid.radius_mm:.3f} mm."
    ]
    parts += [
        f"Cells of {s.name}: {threshold_text(thresholds[s.name])}." for s in findings.sides if s.name in thresholds
    ]
    return " ".join(parts)


def _section(name: str, title: str, body: str) -> str:
    return f'<section id="{name}"><h2>{escape(title)}</h2>\n{body}</section>\n' if body else ""


def _figure(number: int, figure: Drawn) -> str:
    saved = figure.saved
    data = base64.b64encode(saved.webp).decode("ascii")
    return (
        f'<figure id="{escape(saved.path.stem)}"><img src="data:image/webp;base64,{data}" '
        f'alt="{escape(figure.title)}" width="{round(saved.width_in * CSS_PIXELS_PER_INCH)}">\n'
        f"<figcaption><b>Figure {number}. {escape(figure.title)}.</b> {escape(figure.caption)} "
        f'<span class="code">figures/{escape(saved.path.name)}</span></figcaption></figure>\n'
    )
