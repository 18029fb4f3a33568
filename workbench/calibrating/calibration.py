"""Calibrate by a recording of a printed tube: the file that later sidecars cite, and a figure of what was measured."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomlkit
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_unchanged, digests, path_text, sha256_of, state_of
from endoct.base.files.output import check_output, new_output
from endoct.modalities.contract import CalibratingModality
from endoct.modalities.recognition import Recognised, recognise
from endoct.modalities.tube.measurement import Measurement
from endoct.modalities.tube.target import Target, read_target
from endoct.workbench.exporting.mark import BLANK, is_marked, mark
from endoct.workbench.requests import CalibrateRequest, by_request
from endoct.workbench.running.outputs import CALIBRATION, versions
from endoct.workbench.running.progress import stages_for
from endoct.workbench.settings import parse, split

SAME_DIAMETER = 0.02
"""The sidecar's bore and the tube's are the same where they differ by less than this share."""
DIGITS = 6
COLUMNS = 3
PANEL_IN = 3.2, 2.5
LINE_IN = 0.2
DPI = 150
MOST_POINTS = 4000


@by_request(CalibrateRequest)
def calibrate(request: CalibrateRequest) -> Measurement:
    """Calibrate an instrument by a recording of a printed tube; write the file that sidecars cite, and its figure.

    Arguments are those of :class:`~endoct.workbench.requests.CalibrateRequest`. The figure lies next to ``output``, by
    the same name with ``.png``. Raises :class:`EndoctError` where the plug-in cannot be calibrated, the recording does
    not show the tube's marks, or the tube's diameter contradicts it. Nothing is written in these cases.

    A bore of another diameter than the tube's is refused at once; with the specimen of
    :func:`~endoct.workbench.api.demo`'s example:

    >>> from endoct.workbench import calibrate
    >>> from endoct.workbench.calibrating.printed_tube import write_tube
    >>> tube = write_tube("tube", bore_diameter_mm=4.0)
    >>> calibrate("oct", "demo/specimen/oct", target="tube/tube.toml", output="calibration.toml")
    Traceback (most recent call last):
        ...
    endoct.base.errors.EndoctError: the diameter in the sidecar is not that of the tube; ...
    """
    recording, target, output = Path(request.recording), Path(request.target), Path(request.output)
    modality, overwrite, stages = request.modality, request.overwrite, stages_for(request.progress)
    tube = read_target(target)
    figure = figure_path(output)
    for path in (output, figure):
        check_output(path, CALIBRATION, overwrite=overwrite, inputs=[target], is_ours=is_marked)
    files = state_of(recording)
    recognised = recognise(recording, modality)
    manifest = recognised.manifest
    implementation = manifest.load()
    if not hasattr(implementation, "calibrate"):
        raise EndoctError(f"the modality '{manifest.name}' cannot be calibrated by a tube")
    overrides, parameters = split(parse(request.settings), manifest)
    stream = recognised.open(_bore_of(recognised, tube, overrides))
    with stages.stage(f"calibrate {manifest.name}"):
        measured = cast(CalibratingModality[Any, Any], implementation).calibrate(stream, parameters, tube)
    check_unchanged(recording, files)
    text = _toml(measured, recording, target)
    with new_output(figure, CALIBRATION, overwrite=overwrite, inputs=[target], is_ours=is_marked) as scratch:
        write_figure(measured, scratch)
        mark(scratch)
    with new_output(output, CALIBRATION, overwrite=overwrite, inputs=[target], is_ours=is_marked) as scratch:
        scratch.write_text(text, encoding="utf-8")
        mark(scratch)
    return measured


def _bore_of(recognised: Recognised, tube: Target, overrides: Mapping[str, object]) -> dict[str, object]:
    """Return the overrides with the tube's diameter. Raises :class:`EndoctError` where the sidecar has another."""
    stated = overrides.get("bore_diameter_mm", recognised.sidecar_keys.get("bore_diameter_mm"))
    if isinstance(stated, int | float) and abs(stated / tube.bore_diameter_mm - 1) > SAME_DIAMETER:
        raise EndoctError(
            "the diameter in the sidecar is not that of the tube",
            found=f"bore_diameter_mm = {stated:g} in {recognised.sidecar}",
            expected=f"{tube.bore_diameter_mm:g}",
            remedy="name the tube.toml of the tube that was recorded",
        )
    return {**overrides, "bore_diameter_mm": tube.bore_diameter_mm}


def _toml(measured: Measurement, recording: Path, target: Path) -> str:
    found = digests(recording)
    recorded = next(iter(found.values())) if len(found) == 1 else f"{len(found)} files"
    lines = [
        f"# Calibration by endoct ({BLANK}).",
        '# Sidecars next to it cite it as calibration = "NAME.toml" and leave out these keys.',
        f"# endoct {versions()['endoct']}; recording {path_text(recording.name)} ({recorded}); "
        f"tube {path_text(target.name)} ({sha256_of(target)})",
        *(f"# DOUBT {doubt.code}: {doubt.what}" for doubt in measured.doubts),
    ]
    keys = {name: _rounded(value) for name, value in measured.keys.items()}
    errors = {name: float(f"{value:.2g}") for name, value in measured.standard_errors.items()}
    return "\n".join(lines) + "\n\n" + tomlkit.dumps({**keys, "standard_errors": errors})


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return round(value, DIGITS + 2) if abs(value) < 1 else round(value, DIGITS)
    if isinstance(value, tuple):
        return [_rounded(each) for each in value]
    if isinstance(value, Mapping):
        return {name: _rounded(each) for name, each in value.items()}
    return value


def figure_path(output: Path) -> Path:
    """Return where the figure of the calibration ``output`` lies."""
    return output.with_suffix(".png")


def write_figure(measured: Measurement, path: Path) -> None:
    """Write the panels of a calibration as PNG, and its quantities with their standard errors below."""
    rows = -(-len(measured.panels) // COLUMNS)
    text_in = LINE_IN * len(measured.quantities)
    size = COLUMNS * PANEL_IN[0], rows * PANEL_IN[1] + text_in + 0.3
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(
        rows + 1, COLUMNS, height_ratios=[PANEL_IN[1]] * rows + [0.2 * len(measured.quantities)]
    )
    for k, panel in enumerate(measured.panels):
        axes = figure.add_subplot(places[k // COLUMNS, k % COLUMNS])
        some = slice(None, None, max(1, panel.x.size // MOST_POINTS))
        axes.plot(panel.x[some], panel.y[some], ".", markersize=2, color="0.45")
        if panel.line is not None:
            order = np.argsort(panel.line[:, 0])
            axes.plot(*panel.line[order].T, "-", linewidth=1, color="tab:red")
        axes.set_title(panel.title, fontsize=8)
        axes.set_xlabel(panel.x_label, fontsize=7)
        axes.set_ylabel(panel.y_label, fontsize=7)
        axes.tick_params(labelsize=6)
    axes = figure.add_subplot(places[rows, :])
    axes.axis("off")
    lines = [f"{each.title}: {each.value:.6g} ± {each.sigma:.2g} {each.unit}" for each in measured.quantities]
    axes.text(0, 1, "\n".join(lines), fontsize=7, va="top", family="monospace", transform=axes.transAxes)
    figure.savefig(path, dpi=DPI, format="png", metadata={"Software": BLANK})
