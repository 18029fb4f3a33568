"""Commands about calibration by a printed tube."""

from pathlib import Path

from tyro.conf import Positional

from endoct.base.files.files import path_text
from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line, status_of
from endoct.workbench.requests import OutputPath, Settings
from endoct.workbench.running.refusals import DONE


def calibrate(
    modality: Positional[str],
    recording: Positional[Path],
    target: Path,
    output: OutputPath,
    set: Settings = (),
    strict: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Calibrate an instrument by a recording of a printed tube: scales, zeros and angles, each with its standard error.

    Args:
        modality: oct, endoscope, or another that can be calibrated
        recording: folder or file of the recording of the tube
        target: tube.toml of the tube, as `endoct target` writes it, with the sizes that were measured
        output: file to write, such as calibration.toml, that sidecars cite; a figure is written next to it
        set: a key of the sidecar or a processing parameter; repeat for more
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        overwrite: replace the output if it exists
        json: print as JSON
    """
    from endoct.workbench.calibrating.calibration import calibrate as calibrated
    from endoct.workbench.calibrating.figure import figure_path
    from endoct.workbench.pipeline.settings import parse

    measured = calibrated(
        modality,
        recording,
        target=target,
        output=output,
        settings=parse(set),
        overwrite=overwrite,
        progress=command_stages(json),
    )
    if json:
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
    return status_of(measured.doubts, strict=strict)


def target(output: OutputPath, bore: float = 2.5, overwrite: bool = False) -> int:
    """Write a tube to print and calibrate by: tube.toml, an STL, and a drawing with its dimensions.

    Args:
        output: folder to write
        bore: inner diameter, mm: that of the holes that are recorded
        overwrite: replace the folder if it exists
    """
    from endoct.workbench.calibrating.printed_tube import write_tube

    write_tube(output, bore_diameter_mm=bore, overwrite=overwrite)
    print_line(f"tube: {output}")
    return DONE
