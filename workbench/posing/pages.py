"""``report.html`` of a pose and of an outlook: one file that opens offline, with figures and tables, and no program."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import count

from markupsafe import Markup

from endoct.fusion.pose.outlook import Tried
from endoct.fusion.pose.pose import Difference, Estimate, Offset, offset_at
from endoct.fusion.pose.summary import PoseSummary
from endoct.fusion.pose.support import OPEN
from endoct.workbench.page.heading import Heading, Score, printed_page
from endoct.workbench.pipeline.information import texts_of
from endoct.workbench.pipeline.volumes import VolumeFacts
from endoct.workbench.posing.result import NOTICE, Made, OutlookResult, PoseResult, estimate_text, place_text
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.html_templates import rendered, rendered_blocks
from endoct.workbench.report.sections import MADE, Section, in_order, numbered
from endoct.workbench.report.verdict import Level, Verdict, count_doubts

BRACKETS = "In brackets: 95 % intervals."
PLAN_AXES = (
    "x and y lie across the plan: x points to the head, or to the front where the bore runs within 10° of that; y is "
    "90° on, clockwise as seen looking in along the plan."
)
REMARK = f"{NOTICE} The figures lie next to this page, lossless, in figures/."
TITLES = {"notes": "Notes", "volumes": "What was read", "provenance": MADE}
"""Titles of the sections on what a result was made from."""
LEVELS: dict[str, Level] = {"well": "trusted", "poorly": "doubted", "hardly": "unaligned"}
"""The verdict that each level of an outlook amounts to."""


def pose_page(result: PoseResult, title: str, drawn: Sequence[Drawn]) -> str:
    """Return the page of a pose as HTML."""
    return printed_page(_heading(result, title), _sections(result, numbered(drawn)), REMARK)


def outlook_page(result: OutlookResult, title: str, drawn: Sequence[Drawn]) -> str:
    """Return the page of an outlook as HTML: the wall that the CT predicts along the plan, and how rehearsals went."""
    return printed_page(_outlook_heading(result, title), _outlook_sections(result, numbered(drawn)), REMARK)


def _heading(result: PoseResult, title: str) -> Heading:
    summary, names = result.summary, " and ".join(result.answer.pose.names)
    if not result.told:
        why = (str(result.answer.reason),)
        verdict = Verdict("unaligned", f"It cannot be told where the bore lies. {NOTICE}", why, "Why")
    elif result.doubts:
        unless = " if the CT is not mirrored" if any(doubt.code == OPEN for doubt in result.doubts) else ""
        verdict = Verdict("doubted", f"Told by {names}{unless}, with {count_doubts(result.doubts)}. {NOTICE}")
    else:
        verdict = Verdict("trusted", f"Told by {names}. {NOTICE}")
    scores = tuple(_scores(summary)) if result.told else ()
    return _headed(result, f"{title}: the bore in the CT", ("sides", names), verdict, scores)


def _headed(
    result: PoseResult | OutlookResult, title: str, fact: tuple[str, str], verdict: Verdict, scores: tuple[Score, ...]
) -> Heading:
    return Heading(
        title=title,
        facts=(fact, ("coordinates", result.coordinates.upper())),
        verdict=verdict,
        doubts=result.doubts,
        scores=scores,
        notes=sum(len(facts.notes) for facts in result.volumes.values()),
        endoct=result.made.versions.get("endoct", ""),
    )


def _scores(summary: PoseSummary) -> Iterator[Score]:
    yield Score("Off the plan at the target", _mm(summary.at_target.distance_mm), BRACKETS)
    yield Score("5 mm beyond it", _mm(summary.beyond.distance_mm), BRACKETS)
    yield Score("Angle to the plan", f"{estimate_text(summary.angle_deg)}°", BRACKETS)
    if summary.clearances:
        nearest = min(summary.clearances, key=lambda clearance: clearance.margin_mm)
        yield Score(f"To the {nearest.name}", _mm(nearest.distance_mm), "from the bore's envelope, the least margin")


def _sections(result: PoseResult, figures: Mapping[str, Markup]) -> tuple[Section, ...]:
    titles = {
        "cut": "The CT along the bore",
        "plan": "Against the plan",
        "structures": "Structures",
        **{f"wall-{name}": f"The wall by {name}" for name in result.answer.pose.names},
        "sides": "Sides",
        "difference": "The two sides against each other",
        **TITLES,
    }
    summary = result.summary
    texts = rendered_blocks(
        "posing/pose.html",
        told=result.told,
        brackets=BRACKETS,
        in_ct=f"the axis in the CT ({result.coordinates.upper()}, mm)",
        plan_axes=PLAN_AXES,
        bare=summary.bare,
        places=_places(result),
        structures=[(one.name, estimate_text(one.distance_mm), _number(one.margin_mm)) for one in summary.clearances],
        sides=_sides(result),
        difference=summary.difference,
        difference_rows=_difference_rows,
    )
    return in_order(titles, figures, texts | _texts_on_input(result.volumes.values(), result.made))


def _texts_on_input(volumes: Collection[VolumeFacts], made: Made) -> dict[str, Markup]:
    """Return, by section, the notes on ``volumes``, what was read of them, and how a result was ``made``."""
    return rendered_blocks(
        "posing/read.html",
        notes=[(facts.title, note) for facts in volumes for note in facts.notes],
        volumes=volumes,
        fact_rows=lambda facts: [(name, text) for name, value in facts.facts.items() for text in texts_of(value)],
        made=made,
        seconds=[(name, f"{seconds:.1f}") for name, seconds in made.seconds.items()],
    )


def _places(result: PoseResult) -> list[tuple[str, ...]]:
    summary = result.summary
    places: list[tuple[str, Offset]] = [("entry", summary.at_entry), ("target", summary.at_target)]
    if summary.recess is not None:
        places.insert(1, ("facial recess", summary.recess))
    name, depth = result.deepest
    places.append((f"deepest row of {name}", offset_at(result.answer.pose, depth.value)))
    places.sort(key=lambda place: place[1].depth_mm)
    places.append(("5 mm beyond the target", summary.beyond))
    rows = []
    for name, at in places:
        texts = f"{at.depth_mm:.1f}", place_text(result.place(at.depth_mm)), _across(at), estimate_text(at.distance_mm)
        rows.append((name, *texts))
    return [*rows, ("angle of the axis (°)", "", "", "", estimate_text(summary.angle_deg))]


def _sides(result: PoseResult) -> Iterator[tuple[str, ...]]:
    pose, standing = result.answer.pose, result.answer.standing
    for number, name in enumerate(pose.names):
        first, last = result.summary.ends_mm[name]
        stands = f"{standing[number]:.1f}" if standing else "–"
        roll = estimate_text(result.summary.roll_deg[name], 0)
        agreement = f"{pose.fit.agreement[number]:.3f}"
        yield name, estimate_text(first), estimate_text(last), roll, agreement, stands


def _difference_rows(difference: Difference) -> list[tuple[str, str, str]]:
    return [
        ("entry (mm)", _across(difference.at_entry), estimate_text(difference.at_entry.distance_mm)),
        ("target (mm)", _across(difference.at_target), estimate_text(difference.at_target.distance_mm)),
        ("angle (°)", "", estimate_text(difference.angle_deg)),
    ]


def _across(offset: Offset) -> str:
    return ", ".join(map(_number, offset.across_mm))


def _number(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")


def _mm(value: Estimate) -> str:
    return f"{estimate_text(value)} mm"


def _outlook_heading(result: OutlookResult, title: str) -> Heading:
    outlook = result.outlook
    scores = [
        Score(
            f"Told by {one.instrument}",
            f"{one.n_told} of {len(one.tried)}",
            "rehearsals" if one.median_mm is None else f"{one.median_mm:.2f} mm off at the target, in the median",
        )
        for one in outlook.prospects
    ]
    said = f"The bore could be told {outlook.level}. {NOTICE}"
    verdict = Verdict(LEVELS[outlook.level], said, (f"It {outlook.sentence}.",), "Why")
    plan = "plan", f"{result.plan.length_mm:.1f} mm"
    return _headed(result, f"{title}: could the bore be told?", plan, verdict, tuple(scores))


def _outlook_sections(result: OutlookResult, figures: Mapping[str, Markup]) -> tuple[Section, ...]:
    prospects = {prospect.instrument: prospect.tried for prospect in result.outlook.prospects}
    titles = {
        "wall": "The wall by the CT",
        **{instrument: f"Rehearsals by {instrument}" for instrument in prospects},
        **TITLES,
    }
    texts = {"wall": rendered("report/plain_table.html", header=["", ""], rows=_wall_facts(result))}
    for instrument, tried in prospects.items():
        rows = map(_row, count(1), tried)
        reasons = [(str(number), one.reason) for number, one in enumerate(tried, 1) if one.reason is not None]
        texts[instrument] = rendered("posing/rehearsals.html", rehearsals=rows, reasons=reasons)
    return in_order(titles, figures, texts | _texts_on_input(result.volumes.values(), result.made))


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


def _wall_facts(result: OutlookResult) -> list[tuple[str, str]]:
    facts = result.outlook.facts
    rows = [
        ("share of air", f"{facts.air:.0%}"),
        ("cells met", str(facts.cells)),
        ("longest stretch without an edge (mm)", f"{facts.longest_bare_mm:.1f}"),
    ]
    if facts.likeness is not None and facts.turn_deg is not None:
        rows.append((f"correlation with itself turned by {facts.turn_deg:.0f}°", f"{facts.likeness:.2f}"))
    return rows
