"""``report.html`` of an outlook: the wall that the CT predicts along the plan, and how rehearsals went."""

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path

import numpy as np
from markupsafe import Markup

from endoct.base.files.contents import marked
from endoct.fusion.pose.outlook import Tried
from endoct.fusion.pose.search import COLUMNS, ROWS_MM
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.heading import Heading, Score, printed_page
from endoct.workbench.posing.outlook_result import OutlookResult
from endoct.workbench.posing.page import REMARK, TITLES, texts_on_input
from endoct.workbench.posing.result import NOTICE
from endoct.workbench.report.figures.drawing import INTENSITY_COLOURS, journal_style, render
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.report.figures.wall_panels import colour_bar, panel_figure, scale_text, show_surface, wall_panel
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.sections import Section, in_order, numbered
from endoct.workbench.report.verdict import Level, Verdict

LEVELS: dict[str, Level] = {"well": "trusted", "poorly": "doubted", "hardly": "unaligned"}


def write_outlook_page(result: OutlookResult, radius_mm: float, folder: Path) -> None:
    """Write the page and its figure into ``folder``."""
    drawn = [_draw_wall(result, radius_mm)]
    write_figures(drawn, folder / "figures")
    page = printed_page(_heading(result, folder.name), _sections(result, numbered(drawn)), REMARK)
    (folder / "report.html").write_text(marked(page), encoding="utf-8")


def _heading(result: OutlookResult, title: str) -> Heading:
    outlook = result.outlook
    scores = [
        Score(
            f"Told by {one.instrument}",
            f"{one.n_told} of {len(one.tried)}",
            "rehearsals" if one.median_mm is None else f"{one.median_mm:.2f} mm off at the target, in the median",
        )
        for one in outlook.prospects
    ]
    return Heading(
        title=f"{title}: could the bore be told?",
        facts=(("plan", f"{result.plan.length_mm:.1f} mm"), ("coordinates", result.coordinates.upper())),
        verdict=Verdict(
            LEVELS[outlook.level],
            f"The bore could be told {outlook.level}. {NOTICE}",
            (f"It {outlook.sentence}.",),
            "Why",
        ),
        doubts=result.doubts,
        scores=tuple(scores),
        notes=sum(len(facts.notes) for facts in result.volumes.values()),
        endoct=result.made.versions.get("endoct", ""),
    )


def _sections(result: OutlookResult, figures: Mapping[str, Markup]) -> tuple[Section, ...]:
    prospects = {one.instrument: one.tried for one in result.outlook.prospects}
    titles = {
        "wall": "The wall by the CT",
        **{instrument: f"Rehearsals by {instrument}" for instrument in prospects},
        **TITLES,
    }
    texts = {"wall": rendered("report/plain_table.html", header=["", ""], rows=_facts(result))}
    for instrument, tried in prospects.items():
        rows = map(_row, count(1), tried)
        texts[instrument] = rendered("posing/rehearsals.html", rehearsals=rows, reasons=_reasons(tried))
    return in_order(titles, figures, texts | texts_on_input(result.volumes.values(), result.made))


def _row(number: int, tried: Tried) -> tuple[str, ...]:
    return (
        str(number),
        "yes" if tried.told else "no",
        "right" if tried.right else "wrong",
        f"{tried.error_mm:.2f}",
        f"{tried.deviation_mm:.2f}",
        f"{tried.turn_deg:.0f}".replace("-", "−"),
        f"{tried.agreement:.2f}".replace("-", "−"),
        "–" if tried.second is None else f"{tried.second:.2f}".replace("-", "−"),
    )


def _reasons(tried: Sequence[Tried]) -> list[tuple[str, str]]:
    return [(str(number), one.reason) for number, one in enumerate(tried, 1) if one.reason is not None]


def _facts(result: OutlookResult) -> list[tuple[str, str]]:
    facts = result.outlook.facts
    rows = [
        ("share of air", f"{facts.air:.0%}"),
        ("cells met", str(facts.cells)),
        ("longest stretch without an edge (mm)", f"{facts.longest_bare_mm:.1f}"),
    ]
    if facts.likeness is not None and facts.turn_deg is not None:
        rows.append((f"correlation with itself turned by {facts.turn_deg:.0f}°", f"{facts.likeness:.2f}"))
    return rows


def _draw_wall(result: OutlookResult, radius_mm: float) -> Drawn:
    wall = result.wall
    grid = SurfaceGrid.full_circle(wall.shape[0], COLUMNS, z0_mm=0.0, dz_mm=ROWS_MM, radius_mm=radius_mm)
    with journal_style():
        figure, (axes,) = panel_figure(grid, 1)
        wall_panel(axes, grid, "predicted by the CT")
        image = show_surface(axes, grid, 1 - wall, np.ones(wall.shape, np.bool_), INTENSITY_COLOURS, 0.0, 1.0)
        colour_bar(axes, image, "share of bone")
        rendered = render(figure, "wall")
    caption = f"Along the plan, {scale_text(grid)}. θ and z are those of the plan's frame; dark: air."
    return Drawn(rendered, "wall", "The wall of a bore along the plan, by the CT", caption)
