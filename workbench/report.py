"""The report of a comparison: figures as files, and one page that holds everything and opens offline."""

import base64
import gc
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from PIL import Image

from endoct.stitching.output import new_output
from endoct.workbench.figures.all import draw_all
from endoct.workbench.figures.drawing import Drawn
from endoct.workbench.figures.quality import flag_sentences
from endoct.workbench.findings import Findings, SideFindings, read_findings
from endoct.workbench.wording import bullets, flattened, key_text, table, value_text

LEAST_VALID_SHARE = 0.9
"""A side, or the overlap, that observed less of the wall is said not to be trusted."""
LEAST_CONFIDENCE = 0.5
CSS_PIXELS_PER_INCH = 148
EMBEDDED_QUALITY = 88
"""Quality of the WebP copies in the page; the files in figures/ are lossless."""

SECTIONS = {
    "panoramas": "Panoramas",
    "masks": "Cells and difference",
    "alignment": "Alignment",
    "depth": "Depth",
    "frames": "Single frames, as recorded and undistorted",
    "cylinder": "The bore in three dimensions",
    "quality": "Quality along the bore",
}
AFTER_NUMBERS = ("quality",)


def write_report(folder: Path) -> Path:
    """Write ``figures/*.png`` and ``report.html`` into ``folder``, replacing older ones; return the page's path.

    ``folder`` is what ``endoct compare`` wrote; nothing else in it is changed. Raises :class:`EndoctError` where
    it is no whole comparison or cannot be written.
    """
    findings = read_findings(folder)
    page = folder / "report.html"
    with new_output(folder / "figures", overwrite=True) as figures:
        figures.mkdir()
        drawn = draw_all(findings, figures)
        html = page_html(findings, drawn)
    with new_output(page, overwrite=True) as scratch:
        scratch.write_text(html, encoding="utf-8")
    return page


def page_html(findings: Findings, drawn: Sequence[Drawn]) -> str:
    """Return the whole page, images and style embedded."""
    result = findings.result
    a, b = findings.sides
    numbered = [(k, figure) for k, figure in enumerate(drawn, 1)]

    def figures(section: str) -> str:
        shown = "".join(_figure(k, figure) for k, figure in numbered if figure.section == section)
        return f'<section id="{section}"><h2>{SECTIONS[section]}</h2>\n{shown}</section>\n' if shown else ""

    sections = [figures(name) for name in SECTIONS if name not in AFTER_NUMBERS]
    sections.append(_section("numbers", "Numbers", "".join(_numbers(findings))))
    sections += [figures(name) for name in AFTER_NUMBERS]
    sections.append(_section("distrust", "What was not trusted", _distrust_html(findings)))
    sections.append(_section("provenance", "How it was made", "".join(_provenance(result))))
    heading = f"{a.name} and {b.name}: one bore, compared"
    template = Template(files("endoct.workbench").joinpath("report.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(f"endoct: {heading}"),
        style=files("endoct.workbench").joinpath("report.css").read_text(encoding="utf-8"),
        heading=escape(heading),
        headline="".join(_headline(findings)),
        sections="\n".join(sections),
        footer=escape(f"Written by endoct {result.get('versions', {}).get('endoct', '')}. θ runs clockwise as seen "
                      "looking into the bore, z inward from the mouth. The figures lie in figures/, lossless."),
    )  # fmt: skip


def distrust(findings: Findings) -> list[str]:
    """Return what a reader should not rely on, in full sentences."""
    sentences: list[str] = []
    if not findings.aligned:
        sentences.append(f"The two sides were not aligned: {_without_stop(findings.result.get('reason'))}.")
    alignment = findings.result.get("alignment") or {}
    if "confidence" in alignment and alignment["confidence"] < LEAST_CONFIDENCE:
        sentences.append(f"The alignment has a confidence of only {alignment['confidence']:.2f}.")
    for side in findings.sides:
        share = float(side.panorama.valid.mean())
        if share < LEAST_VALID_SHARE:
            sentences.append(f"{side.name}: only {share:.1%} of its own panorama is observed wall.")
        sentences += [f"{side.name}: {sentence}" for sentence in flag_sentences(side)]
        sentences += [f"{side.name}: {note}" for note in findings.result.get("notes", {}).get(side.name, ())]
    return sentences


def _headline(findings: Findings) -> Iterator[str]:
    result = findings.result
    a, b = findings.sides
    doubts = len(distrust(findings))
    if findings.aligned:
        alignment = result["alignment"]
        confidence = f" with confidence {alignment['confidence']:.2f}" if "confidence" in alignment else ""
        yield f'<p class="verdict aligned">Aligned{escape(confidence)}.</p>\n'
        yield f"<p>{escape(_placement(a.name, b.name, alignment))}</p>\n"
        cards = [("Jaccard index", result["jaccard"], f"cells of {a.name} and {b.name}, on the common grid")]
        cards.append(("Dice", result["dice"], "the same cells"))
        headline = result["jaccard"]
        for name, scores in _scored({"scores": result.get("scores") or {}, "truth": result.get("truth") or {}}):
            if scores["jaccard"] != headline:
                cards.append(("Jaccard index", scores["jaccard"], name))
    else:
        yield '<p class="verdict unaligned">Not aligned: the two sides could not be brought onto each other.</p>\n'
        yield (
            f"<p>Reason: {escape(_without_stop(result.get('reason')))}. Without an alignment no place on one side "
            "corresponds to a place on the other, so there is no score and no difference image. Everything below "
            "shows each side by itself.</p>\n"
        )
        cards = []
    if findings.aligned:
        cards.append(("Observed", result.get("valid_fraction"), "share of the common grid that both sides observed"))
    yield '<ul class="cards">' + "".join(
        f"<li><span>{escape(title)}</span><b>{escape(_score(value))}</b><span>{escape(of)}</span></li>"
        for title, value, of in cards
        if value is not None
    ) + "</ul>\n"  # fmt: skip
    yield f"<p>{escape(_conditions(findings))}</p>\n"
    if doubts:
        yield (
            f'<p class="warn"><a href="#distrust">{doubts} thing{"s were" if doubts > 1 else " was"} not trusted</a>, '
            "listed below.</p>\n"
        )
    else:
        yield "<p>Nothing was reported as not trusted.</p>\n"


def _placement(a: str, b: str, alignment: Mapping[str, Any]) -> str:
    sign = ("−" if alignment.get("mirrored") else "", "−" if alignment.get("z_reversed") else "")
    theta, z, scale = (alignment.get(key) for key in ("theta_shift_rad", "z_shift_mm", "z_scale"))
    said = f"{b} lies in the frame of {a}"
    if theta is not None:
        said += f" turned by {math.degrees(theta):.2f}°"
    if z is not None:
        said += f" and shifted by {z:.3f} mm along the bore".replace("-", "−")
    if scale is not None:
        said += f", its z scaled by {scale:.4f}"
    turned = [text for text, flag in zip(("mirrored in θ", "reversed in z"), sign, strict=True) if flag]
    return f"{said}; {' and '.join(turned) if turned else 'neither mirrored nor reversed'}."


def _conditions(findings: Findings) -> str:
    grid, result = findings.grid, findings.result
    parts = [
        f"Common grid: {grid.n_z} × {grid.n_theta} samples (z × θ), {grid.dz_mm * 1000:.3g} µm along the bore and "
        f"{grid.dtheta_mm * 1000:.3g} µm around it at a bore radius of {grid.radius_mm:.3f} mm."
    ]
    for side in findings.sides:
        of = (result.get("threshold") or {}).get(side.name)
        if of:
            parts.append(f"Cells of {side.name}: {_threshold_text(of)}.")
        parts.append(f"{side.name} observed {side.valid.mean():.1%} of the grid.")
    return " ".join(parts)


def _threshold_text(threshold: Mapping[str, Any]) -> str:
    of = _without_stop(threshold.get("of")) or "as given"
    value, unit = threshold.get("value"), threshold.get("unit") or ""
    return of if value is None else f"{of}, above {value:.4g}{f' {unit}' if unit not in ('', '1') else ''}"


def _numbers(findings: Findings) -> Iterator[str]:
    result = findings.result
    if findings.aligned:
        headline = {"on the common grid": {"jaccard": result["jaccard"], "dice": result["dice"]}}
        found = {"scores": result.get("scores") or {}, "truth": result.get("truth") or {}}
        scored = [row for row in _scored(found) if dict(row[1]).get("jaccard") != result["jaccard"] or len(row[1]) > 2]
        if not any(scores["jaccard"] == result["jaccard"] for _, scores in scored):
            scored = [*_scored(headline), *scored]
        keys = list(dict.fromkeys(key for _, scores in scored for key in scores))
        yield "<h3>Overlap of the cells</h3>\n"
        yield table(
            ([name, *(value_text(key, scores.get(key)) for key in keys)] for name, scores in scored),
            ["", *(key_text(key).capitalize() for key in keys)],
        )
        rest = [(name, value_text(key, value)) for name, key, value in _unscored(found)]
        yield table(rest)
        yield "<h3>Alignment</h3>\n"
        yield table((name, value_text(key, value)) for name, key, value in flattened(result["alignment"]))
    yield "<h3>Sides</h3>\n"
    columns = [_side_facts(side, (result.get("threshold") or {}).get(side.name)) for side in findings.sides]
    yield table(
        ([name, *(column[name] for column in columns)] for name in columns[0]),
        ["", *(side.name for side in findings.sides)],
    )


def _side_facts(side: SideFindings, threshold: Mapping[str, Any] | None) -> dict[str, str]:
    panorama = side.panorama
    cells = side.mask[side.valid].mean() if side.valid.any() else math.nan
    depth = "none"
    if side.depth_mm is not None:
        low, high = (float(v) for v in np.nanpercentile(side.depth_mm[side.valid], (5, 95)))
        depth = f"{low:.3f} to {high:.3f} mm".replace("-", "−")
    frames = side.frame_z_mm.size
    return {
        "Recorded": f"{frames} {panorama.frame_dim}{'s' if frames != 1 else ''}" if frames else "–",
        "Own panorama, z × θ": f"{panorama.grid.n_z} × {panorama.grid.n_theta} samples",
        "Observed of its own panorama": f"{panorama.valid.mean():.1%}",
        "Observed of the common grid": f"{side.valid.mean():.1%}",
        "Cells, of the wall it observed": f"{cells:.1%}" if math.isfinite(cells) else "–",
        "Depth, 5th to 95th percentile": depth,
        "Threshold": _threshold_text(threshold) if threshold else "–",
    }


def _provenance(result: Mapping[str, Any]) -> Iterator[str]:
    yield "<h3>Inputs</h3>\n"
    yield table(result.get("inputs", {}).items(), ["file", "sha256"], code=(1,))
    yield '<div class="columns"><div>\n<h3>Seconds per stage</h3>\n'
    seconds = result.get("seconds", {})
    rows = [(name, f"{value:.1f} s") for name, value in seconds.items() if isinstance(value, int | float)]
    yield table([*rows, ("in all, before this report", f"{sum(v for v in seconds.values()):.1f} s")])
    yield "</div><div>\n<h3>Versions</h3>\n"
    yield table(result.get("versions", {}).items())
    yield "</div></div>\n<h3>Parameters</h3>\n"
    yield table(
        ((name, value_text(key, value)) for name, key, value in flattened(result.get("parameters", {}))), code=(1,)
    )


def _distrust_html(findings: Findings) -> str:
    sentences = distrust(findings)
    if not sentences:
        return "<p>Nothing was reported as not trusted.</p>\n"
    return f'<div class="distrust">{bullets(sentences)}</div>\n'


def _scored(values: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield (where, scores) of every mapping that holds a Jaccard index, however deep."""
    for key, value in values.items():
        if not isinstance(value, Mapping):
            continue
        name = f"{path} › {key_text(str(key))}" if path else key_text(str(key))
        if "jaccard" in value:
            scores = {k: v for k, v in value.items() if not isinstance(v, Mapping | str)}
            yield _where(name.removeprefix("scores › "), value), scores
        yield from _scored(value, name)


def _where(name: str, scores: Mapping[str, Any]) -> str:
    if "rows_of" in scores:
        return f"on the own rows of {scores['rows_of']}, without interpolating them"
    return "on the common grid" if name == "grid" else name


def _unscored(values: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, str, Any]]:
    if "jaccard" in values:
        return
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _unscored(value, f"{path}{key_text(str(key))} › ")
        else:
            yield f"{path}{key_text(str(key))}".removeprefix("scores › "), str(key), value


def _section(name: str, title: str, body: str) -> str:
    return f'<section id="{name}"><h2>{escape(title)}</h2>\n{body}</section>\n'


def _figure(number: int, figure: Drawn) -> str:
    with Image.open(figure.path) as png:
        buffer = io.BytesIO()
        png.convert("RGB").save(buffer, "WEBP", quality=EMBEDDED_QUALITY, method=2)
    gc.collect()  # figures refer to themselves in circles
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return (
        f'<figure id="{escape(figure.path.stem)}"><img src="data:image/webp;base64,{data}" '
        f'alt="{escape(figure.title)}" width="{round(figure.width_in * CSS_PIXELS_PER_INCH)}">\n'
        f"<figcaption><b>Figure {number}. {escape(figure.title)}.</b> {escape(figure.caption)} "
        f'<span class="code">figures/{escape(figure.path.name)}</span></figcaption></figure>\n'
    )


def _score(value: float) -> str:
    return f"{value:.3f}"


def _without_stop(text: object) -> str:
    return str(text or "").strip().rstrip(".")
