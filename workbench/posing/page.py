"""``report.html`` of a pose: one file that opens offline, with figures and tables, and no program."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files

from endoct.fusion.pose.clinical import Estimate, Offset
from endoct.fusion.pose.summary import PoseSummary
from endoct.stitching.contents import marked
from endoct.workbench.page.document import document
from endoct.workbench.page.heading import Heading, Score
from endoct.workbench.pipeline.information import texts_of
from endoct.workbench.pipeline.volumes import VolumeFacts
from endoct.workbench.posing.result import NOTICE, Made, PoseResult, estimate_text, place_text
from endoct.workbench.report.doubts import count_doubts
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.illustrated import numbered
from endoct.workbench.report.sections import Section
from endoct.workbench.report.verdict import Verdict
from endoct.workbench.report.wording import table

STYLE = "endoct.workbench.page"
BRACKETS = "In brackets: 95 % intervals."
PLAN_AXES = (
    "x and y lie across the plan: x points to the head, or to the front where the bore runs within 10° of that; y is "
    "90° on, clockwise as seen looking in along the plan."
)
REMARK = f"{NOTICE} The figures lie next to this page, lossless, in figures/."


def pose_page(result: PoseResult, title: str, drawn: Sequence[Drawn]) -> str:
    """Return the page of a pose as HTML."""
    style = files(STYLE).joinpath("bundle", "page.css").read_text("utf-8")
    sections = tuple(_sections(result, numbered(drawn)))
    head = f"<style>{style}</style>\n"
    return marked(document(_heading(result, title), sections, head=head, remark=REMARK, has_panes=False))


def _heading(result: PoseResult, title: str) -> Heading:
    summary, names = result.summary, " and ".join(result.answer.pose.names)
    doubts, of_ct = result.answer.doubts, tuple(doubt for facts in result.volumes.values() for doubt in facts.doubts)
    if not result.told:
        why = (str(result.answer.reason),)
        verdict = Verdict("unaligned", f"It cannot be told where the bore lies. {NOTICE}", why, "Why")
    elif doubts:
        verdict = Verdict("doubted", f"Told by {names}, with {count_doubts(doubts)}. {NOTICE}", doubts, "Why")
    elif of_ct:
        verdict = Verdict("doubted", f"Told by {names}, with {count_doubts(of_ct)}. {NOTICE}")
    else:
        verdict = Verdict("trusted", f"Told by {names}. {NOTICE}")
    scores = _scores(summary) if result.told else ()
    return Heading(
        title=f"{title}: the bore in the CT",
        facts=(("sides", names), ("coordinates", result.coordinates.upper())),
        verdict=verdict,
        doubts=of_ct,
        scores=tuple(scores),
        notes=sum(len(facts.notes) for facts in result.volumes.values()),
        endoct=result.made.versions.get("endoct", ""),
    )


def _scores(summary: PoseSummary) -> Iterator[Score]:
    yield Score("Off the plan at the target", _mm(summary.at_target.distance_mm), BRACKETS)
    yield Score("5 mm beyond it", _mm(summary.beyond.distance_mm), BRACKETS)
    yield Score("Angle to the plan", f"{estimate_text(summary.angle_deg)}°", BRACKETS)
    if summary.clearances:
        nearest = min(summary.clearances, key=lambda one: one.margin_mm)
        yield Score(f"To the {nearest.name}", _mm(nearest.distance_mm), "from the bore's envelope, the least margin")


def _sections(result: PoseResult, figures: dict[str, str]) -> Iterator[Section]:
    summary = result.summary
    yield Section("cut", "The CT along the bore", figures["cut"])
    told = "" if result.told else "<p>Of the best pose there is, which is not told.</p>"
    yield Section("plan", "Against the plan", told + _against_plan(result))
    if summary.clearances:
        yield Section("structures", "Structures", told + _structures(summary))
    for name in result.answer.pose.names:
        yield Section(f"wall-{name}", f"The wall by {name}", figures[f"wall-{name}"])
    yield Section("sides", "Sides", _sides(result))
    if summary.difference is not None:
        yield Section("difference", "The two sides against each other", _difference(result))
    if notes := notes_html(result.volumes):
        yield Section("notes", "Notes", notes)
    yield Section("volumes", "What was read", volumes_html(result.volumes))
    yield Section("provenance", "How it was made", provenance(result.made))


def _against_plan(result: PoseResult) -> str:
    summary = result.summary
    places: list[tuple[str, Offset]] = [("entry", summary.at_entry), ("target", summary.at_target)]
    if summary.recess is not None:
        places.insert(1, ("facial recess", summary.recess))
    places.append(("5 mm beyond the target", summary.beyond))
    rows = [
        (name, f"{one.depth_mm:.1f}", place_text(result.place(one.depth_mm)), _across(one),
         estimate_text(one.distance_mm))
        for name, one in places
    ]  # fmt: skip
    rows.append(("angle of the axis (°)", "", "", "", estimate_text(summary.angle_deg)))
    in_ct = f"the axis in the CT ({result.coordinates.upper()}, mm)"
    bare = summary.bare
    said = (
        f"{BRACKETS} {PLAN_AXES} The longest stretch that was seen without an edge of a cell is {bare.length_mm:.1f} "
        f"mm, from {bare.from_mm:.1f} to {bare.to_mm:.1f} mm depth: there the axis is drawn on from the rest."
    )
    return table(rows, ("", "depth (mm)", in_ct, "x, y of the plan (mm)", "off the plan (mm)")) + f"<p>{said}</p>"


def _structures(summary: PoseSummary) -> str:
    rows = [(one.name, estimate_text(one.distance_mm), _number(one.margin_mm)) for one in summary.clearances]
    said = (
        f"{BRACKETS} They hold the error of the axis and half a voxel of the labels; what the segmentation itself gets "
        "wrong is not in them. Below 0 the bore cuts the structure."
    )
    return table(rows, ("", "from the bore's envelope (mm)", "margin (mm)")) + f"<p>{said}</p>"


def _sides(result: PoseResult) -> str:
    pose, standing = result.answer.pose, result.answer.standing
    rows = []
    for number, name in enumerate(pose.names):
        first, last = result.summary.ends_mm[name]
        stands = f"{standing[number]:.1f}" if standing else "–"
        roll = estimate_text(result.summary.roll_deg[name], 0)
        agreement = f"{pose.fit.agreement[number]:.3f}"
        rows.append((name, estimate_text(first), estimate_text(last), roll, agreement, stands))
    heads = ("", "first row's depth (mm)", "last row's depth (mm)", "roll (°)", "correlation with the CT", "standing")
    said = "Roll: where θ = 0 of the panorama lies about the axis, from x of the plan towards y."
    return table(rows, heads) + f"<p>{BRACKETS} {said}</p>"


def _difference(result: PoseResult) -> str:
    found = result.summary.difference
    if found is None:
        return ""
    rows = [
        ("entry (mm)", _across(found.at_entry), estimate_text(found.at_entry.distance_mm)),
        ("target (mm)", _across(found.at_target), estimate_text(found.at_target.distance_mm)),
        ("angle (°)", "", estimate_text(found.angle_deg)),
    ]
    what = f"The axis by {found.of[0]} alone less that by {found.of[1]} alone. {BRACKETS}"
    return table(rows, ("", "x, y of the plan", "length")) + f"<p>{what}</p>"


def notes_html(volumes: Mapping[str, VolumeFacts]) -> str:
    """Return the notes on volumes as a table, "" where there are none."""
    rows = [(facts.title, note) for facts in volumes.values() for note in facts.notes]
    return table(rows, text=(1,)) if rows else ""


def volumes_html(volumes: Mapping[str, VolumeFacts]) -> str:
    """Return what was read of volumes as tables."""
    return "".join(
        table(
            [(name, text) for name, value in facts.facts.items() for text in texts_of(value)],
            (facts.title, ""),
            text=(1,),
        )
        for facts in volumes.values()
    )


def provenance(made: Made) -> str:
    """Return inputs, versions and seconds as tables."""
    return (
        table(made.inputs.items(), ("file", "sha256"), code=(1,))
        + table([(name, version) for name, version in made.versions.items()], ("", "version"), text=(1,))
        + table([(name, f"{seconds:.1f}") for name, seconds in made.seconds.items()], ("", "seconds"))
    )


def _across(offset: Offset) -> str:
    return ", ".join(map(_number, offset.across_mm))


def _number(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")


def _mm(value: Estimate) -> str:
    return f"{estimate_text(value)} mm"
