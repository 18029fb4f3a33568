"""``report.html`` of an outlook: the wall that the CT predicts along the plan, and how rehearsals went."""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np

from endoct.fusion.pose.outlook import Tried
from endoct.fusion.pose.search import COLUMNS, ROWS_MM
from endoct.stitching.contents import marked
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.document import document
from endoct.workbench.page.heading import Heading, Score
from endoct.workbench.posing.outlook_result import OutlookResult
from endoct.workbench.posing.page import REMARK, STYLE, notes_html, provenance, volumes_html
from endoct.workbench.posing.result import NOTICE
from endoct.workbench.report.figures.drawing import INTENSITY_COLOURS, journal_style, render
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.report.figures.wall_panels import colour_bar, panel_figure, scale_text, show_surface, wall_panel
from endoct.workbench.report.illustrated import numbered
from endoct.workbench.report.sections import Section
from endoct.workbench.report.verdict import Level, Verdict
from endoct.workbench.report.wording import table

LEVELS: dict[str, Level] = {"well": "trusted", "poorly": "doubted", "hardly": "unaligned"}


def write_outlook_page(result: OutlookResult, radius_mm: float, folder: Path) -> None:
    """Write the page and its figure into ``folder``."""
    drawn = [_draw_wall(result, radius_mm)]
    write_figures(drawn, folder / "figures")
    sections = tuple(_sections(result, numbered(drawn)))
    style = files(STYLE).joinpath("bundle", "page.css").read_text("utf-8")
    page = document(
        _heading(result, folder.name), sections, head=f"<style>{style}</style>\n", remark=REMARK, has_panes=False
    )
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
        doubts=tuple(doubt for facts in result.volumes.values() for doubt in facts.doubts),
        scores=tuple(scores),
        notes=sum(len(facts.notes) for facts in result.volumes.values()),
        endoct=result.made.versions.get("endoct", ""),
    )


def _sections(result: OutlookResult, figures: dict[str, str]) -> Iterator[Section]:
    yield Section("wall", "The wall by the CT", figures["wall"] + _facts(result))
    for one in result.outlook.prospects:
        rows = [_row(number, tried) for number, tried in enumerate(one.tried, 1)]
        heads = ("", "told", "place", "off at the target (mm)", "σ stated (mm)", "roll off (°)", "correlation",
                 "second best")  # fmt: skip
        yield Section(one.instrument, f"Rehearsals by {one.instrument}", table(rows, heads) + _reasons(one.tried))
    if notes := notes_html(result.volumes):
        yield Section("notes", "Notes", notes)
    yield Section("volumes", "What was read", volumes_html(result.volumes))
    yield Section("provenance", "How it was made", provenance(result.made))


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


def _reasons(tried: tuple[Tried, ...]) -> str:
    reasons = [(str(number), one.reason) for number, one in enumerate(tried, 1) if one.reason is not None]
    return table(reasons, ("", "why it was not told"), text=(1,)) if reasons else ""


def _facts(result: OutlookResult) -> str:
    facts = result.outlook.facts
    rows = [
        ("share of air", f"{facts.air:.0%}"),
        ("cells met", str(facts.cells)),
        ("longest stretch without an edge (mm)", f"{facts.longest_bare_mm:.1f}"),
    ]
    if facts.likeness is not None and facts.turn_deg is not None:
        rows.append((f"correlation with itself turned by {facts.turn_deg:.0f}°", f"{facts.likeness:.2f}"))
    return table(rows, ("", ""))


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
