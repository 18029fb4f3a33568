"""Commands about calibration by a printed tube."""

from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path

from endoct.base.files.files import path_text
from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line, status_of
from endoct.workbench.requests import CalibrateRequest, TargetRequest
from endoct.workbench.running.refusals import DONE


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
                    "quantities": [vars(each) for each in measured.quantities],
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
