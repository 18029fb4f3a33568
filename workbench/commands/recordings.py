"""Commands about one recording: unroll or describe it, or calibrate by it; a tube to calibrate by; what can be read."""

from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path

from rich.table import Table

from endoct.base.files.files import path_text
from endoct.workbench.commands.console import (
    TextConsole,
    command_stages,
    print_doubts,
    print_either,
    print_json,
    print_line,
    status_of,
)
from endoct.workbench.requests import CalibrateRequest, InfoRequest, Output, TargetRequest, UnrollRequest
from endoct.workbench.running.refusals import DONE


@dataclass(frozen=True, eq=False)
class Unroll(UnrollRequest):
    """Unroll one recording into a panorama of the bore wall, with a report.

    Args:
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        json: print as JSON
    """

    output: Output = field()
    _: KW_ONLY
    strict: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Unroll, print what was made, and return the exit status."""
        from endoct.workbench import api

        panorama, output = api.unroll(replace(self, progress=command_stages(self.json))), Path(self.output)
        facts = {
            "output": path_text(output),
            "report": path_text(output / "report.html"),
            "modality": panorama.modality,
            "rows": panorama.grid.n_z,
            "columns": panorama.grid.n_theta,
            "z_mm": [float(panorama.z_mm[0]), float(panorama.z_mm[-1])],
            "valid_fraction": float(panorama.valid.mean()),
            "doubts": [doubt.to_json() for doubt in panorama.doubts],
            "notes": list(panorama.notes),
        }
        if self.json:
            print_json(facts)
        else:
            print_line(
                f"panorama: {output} ({facts['rows']} rows × {facts['columns']} columns, "
                f"z {panorama.z_mm[0]:.2f} to {panorama.z_mm[-1]:.2f} mm, {panorama.valid.mean():.1%} valid)"
            )
            print_doubts(panorama.doubts, {"": panorama.notes})
            print_line(f"report: {output / 'report.html'}")
        return status_of(panorama.doubts, strict=self.strict)


@dataclass(frozen=True, eq=False)
class Info(InfoRequest):
    """Describe a recording, a panorama, a comparison, a CT, a label map or a plan, and what a sidecar lacks.

    Args:
        json: print as JSON
    """

    _: KW_ONLY
    json: bool = False

    def __call__(self) -> int:
        """Print what is asked for, and return the exit status."""
        from endoct.modalities.recognition import recognise
        from endoct.workbench.pipeline.information import describe, in_lines, write_thumbnail

        if self.thumbnail is not None:
            write_thumbnail(recognise(self.path, self.modality), self.thumbnail)
        if self.write_sidecar:
            return _write_sidecar(self)
        facts = describe(self.path, self.modality)
        return print_either(facts, in_lines(facts), as_json=self.json)


def _write_sidecar(request: InfoRequest) -> int:
    from endoct.modalities.recognition import STATED, recognise
    from endoct.workbench.pipeline.sidecar_template import write_sidecar_template

    recognised = recognise(request.path, request.modality)
    certainty = recognised.certainty
    sidecar, missing = write_sidecar_template(recognised, overwrite=request.overwrite)
    print_line(f"sidecar: {sidecar}")
    if certainty != STATED:
        print_line(f"modality: {recognised.manifest.name} ({certainty}: {recognised.sniff.reason})")
    for key, why in missing.items():
        print_line(f"to fill in: {key} – {why}")
    return DONE


def modalities(json: bool = False) -> int:
    """List the installed modalities.

    Args:
        json: print as JSON
    """
    from endoct.modalities.registry import manifests
    from endoct.workbench.pipeline.information import installed_modalities

    if json:
        print_json(installed_modalities())
        return DONE
    table = Table("name", "title", "provides", "reads", box=None)
    for manifest in manifests().values():
        table.add_row(manifest.name, manifest.title, ", ".join(sorted(manifest.provides)), " ".join(manifest.suffixes))
    TextConsole().print(table)
    return DONE


@dataclass(frozen=True, eq=False)
class Calibrate(CalibrateRequest):
    """Calibrate an instrument by a recording of a printed tube: scales, zeros and angles, each with its standard error.

    Args:
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        json: print as JSON
    """

    _: KW_ONLY
    strict: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Calibrate, print what was measured, and return the exit status."""
        from endoct.workbench.calibrating.calibration import calibrate, figure_path

        measured, output = calibrate(replace(self, progress=command_stages(self.json))), Path(self.output)
        if self.json:
            print_json(
                {
                    "output": path_text(output),
                    "figure": path_text(figure_path(output)),
                    "keys": dict(measured.keys),
                    "standard_errors": dict(measured.standard_errors),
                    "quantities": [vars(quantity) for quantity in measured.quantities],
                    "doubts": [doubt.to_json() for doubt in measured.doubts],
                }
            )
        else:
            for each in measured.quantities:
                print_line(f"{each.name} = {each.value:.6g} ± {each.sigma:.2g} {each.unit} ({each.title})")
            for name, value in measured.keys.items():
                if isinstance(value, str):
                    print_line(f"{name} = {value}")
            print_doubts(measured.doubts, {})
            print_line(f"calibration: {output}")
            print_line(f"figure: {figure_path(output)}")
        return status_of(measured.doubts, strict=self.strict)


@dataclass(frozen=True, eq=False)
class Tube(TargetRequest):
    """Write a tube to print and calibrate by: tube.toml, an STL, and a drawing with its dimensions."""

    def __call__(self) -> int:
        """Write the tube, and return the exit status."""
        from endoct.workbench.calibrating.printed_tube import write_tube

        write_tube(self)
        print_line(f"tube: {self.output}")
        return DONE
