"""A page as HTML, and its heading: what it shows, the verdict with its doubts, the scores.

Heading and sections are there before any program runs, and without one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import NamedTuple

from markupsafe import Markup

from endoct.base.doubt import Doubt
from endoct.fusion.files.store import ComparisonOutline
from endoct.fusion.result import Result
from endoct.fusion.scoring.cells import Cell
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.recorded import path_of_recording
from endoct.workbench.report.findings import overlaps_of
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.manual import words, words_json
from endoct.workbench.report.next_steps import NextStep, Stated, next_steps
from endoct.workbench.report.sections import Section
from endoct.workbench.report.tables import conditions
from endoct.workbench.report.verdict import Verdict, recording_verdict, verdict_of
from endoct.workbench.report.wording import interval_text, share_text

Fact = tuple[str, str]
"""A name and a value."""


class Link(NamedTuple):
    """An ``address`` and its ``text``; ``again``: where what the page shows can be done again, "" for nowhere."""

    address: str
    text: str
    again: str = ""


RESEARCH = "Research software and no medical device."


@dataclass(frozen=True)
class Score:
    """A number of the headline: "Jaccard index on the common grid", "0.855", "95 % interval …"."""

    title: str
    value: str
    of: str

    @property
    def word(self) -> str:
        """The word of the glossary that says what it is, "" for none."""
        if "Li's threshold" in self.title:
            return "li's threshold"
        return next((word for word in ("Jaccard index", "Dice index", "Observed") if self.title.startswith(word)), "")


@dataclass(frozen=True)
class Heading:
    """What is said first: ``title`` and ``facts``, what it is; the ``verdict``, the ``doubts`` against it; ``scores``.

    ``notes``: how many there are. ``endoct``: the version that made it, "" where it is not known. ``steps``: what can
    be done about it, each with its command line. ``uncounted``: which cells are in no number of cells, and why.
    """

    title: str
    facts: tuple[Fact, ...]
    verdict: Verdict
    doubts: tuple[Doubt, ...]
    scores: tuple[Score, ...]
    notes: int
    endoct: str
    steps: tuple[tuple[NextStep, str], ...] = ()
    uncounted: str = ""


def comparison_heading(
    name: str, facts: Sequence[Fact], outline: ComparisonOutline, stated: Stated | None = None
) -> Heading:
    """Return the heading of the comparison ``name``; ``stated`` is as :func:`next_steps` takes it."""
    result = outline.result
    a, b = result.sides
    verdict = verdict_of(result)
    frame = "frame", f"θ and z of {a}" if outline.alignment is not None else "each side its own"
    return Heading(
        title=f"{name}: {a} and {b}",
        facts=(*facts, frame),
        verdict=Verdict(verdict.level, verdict.headline, (*verdict.sentences, conditions(result, outline.grid))),
        doubts=tuple(result.doubts),
        scores=tuple(_scores(result)),
        notes=sum(map(len, result.notes.values())),
        endoct=result.versions.get("endoct", ""),
        steps=tuple((step, step.command(result, f"{name}-again")) for step in next_steps(result, stated or {})),
        uncounted=uncounted_text(outline.cells, result.sides) if result.aligned else "",
    )


def uncounted_text(cells: Sequence[Cell], names: tuple[str, str]) -> str:
    """Return which ``cells`` of two aligned sides are not counted, and why; "" where all are."""
    missed = [cell for cell in cells if not cell.counts]
    if not missed:
        return ""
    said = [f"{len(missed)} of {len(cells)} cells {'are' if len(missed) > 1 else 'is'} not counted."]
    for side, other in (names, names[::-1]):
        unseen = sum(cell.side == side and cell.observed_by_other == 0 for cell in missed)
        partly = sum(cell.side == side for cell in missed) - unseen
        parts = [f"{unseen} where {other} observed nothing"] if unseen else []
        parts += [f"{partly} of which {other} observed less than half"] if partly else []
        said += [f"Of {side}: {', '.join(parts)}."] if parts else []
    return " ".join(said)


def panorama_heading(name: str, facts: Sequence[Fact], outline: PanoramaOutline) -> Heading:
    """Return the heading of the panorama ``name``."""
    frames = outline.per_frame.get(f"{outline.frame_dim}_z_mm")
    path = path_of_recording(outline)
    return Heading(
        title=name if name == outline.modality else f"{name}: {outline.modality}",
        facts=(
            *facts,
            (f"{outline.frame_dim}s", "0" if frames is None else str(frames.values.size)),
            *([] if path is None else [("recording", "/".join(path.parts[-2:]))]),
        ),
        verdict=recording_verdict(outline.doubts),
        doubts=outline.doubts,
        scores=(),
        notes=len(outline.notes),
        endoct=str(outline.provenance.get("versions", {}).get("endoct", "")),
    )


def _scores(result: Result) -> Iterator[Score]:
    for named in overlaps_of(result):
        if not named.is_detail:
            where, _, remark = named.where.partition(", ")
            side = "" if named.of == result.sides else f"of {named.of[0]} "
            said = ", ".join(filter(None, (remark, interval_text(named.overlap.jaccard_interval))))
            yield Score(f"Jaccard index {side}{where}", share_text(named.overlap.jaccard), said)
    if result.aligned:
        yield Score("Dice index on the common grid", share_text(result.dice), "")
        over = f"of the {result.overlap_mm:.1f} mm that they share" if result.overlap_mm is not None else "of the wall"
        yield Score("Observed by both sides", f"{result.valid_fraction:.1%}", over)


def document(
    template: str,
    heading: Heading,
    sections: Sequence[Section],
    *,
    remark: str = "",
    above: Link | None = None,
    manual: str = "",
    **values: object,
) -> Markup:
    """Return the page that a ``template`` makes of ``values``, by which its style and program come.

    ``above`` leads to what it is one of; ``manual`` is the address of the manuals, "" where there are none; ``remark``
    is said at its end.
    """
    said = {"heading": heading, "sections": sections, "remark": remark, "above": above, "manual": manual}
    said |= {"words": words, "program_words": words_json(manual)}
    return rendered(template, title=heading.title, research=RESEARCH, **said, **values)


def printed_page(heading: Heading, sections: Sequence[Section], remark: str) -> Markup:
    """Return a page that needs no other file, and has no program; ``remark`` is said at its end."""
    return document("page/printed.html", heading, sections, remark=remark, style=bundled("page.css"))


def bundled(name: str) -> Markup:
    """Return the page's own style, or one of its programs, for a page to embed unchanged."""
    return Markup(files("endoct.workbench.page").joinpath("bundle", name).read_text("utf-8"))
