"""Commands about outputs: write them for other programs, and check that they are as they were written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from endoct.base.errors import EndoctError
from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line
from endoct.workbench.exporting.formats import FormatName, OmeVersion
from endoct.workbench.requests import UNSET, OutputPath
from endoct.workbench.running.refusals import DONE, UNUSABLE_INPUT


@dataclass(frozen=True, eq=False)
class Export:
    """Write a panorama, a comparison or a specimen's truth for other programs to open (see docs/how-to/export.md).

    Args:
        path: a panorama written by `endoct unroll`, a folder written by `endoct compare`, or a simulated specimen
        output: file to write, or of OME-Zarr the folder
        to: format, where the suffix of the output does not say it; labels always have to be named
        color: what colours a wall (ply, glb): a side's name for its brightness, or relief
        side: whose relief a wall has (ply, stl, glb), or whose numbers a table (csv)
        voxel_mm: size of a volume's voxels across the bore (nrrd, nifti); default 0.01. Along it they are as far apart
            as the slices
        vertex_mm: distance of a wall's vertices (ply, stl, glb); default 0.02
        version: of OME-Zarr; default 0.5
        inverse: a transform from the first side's frame to the second's (itk-transform), as resampling takes it
        overwrite: replace the output if it exists
        json: print as JSON
    """

    path: Positional[Path]
    output: OutputPath
    to: Annotated[FormatName | None, UNSET] = None
    color: Annotated[str | None, arg(metavar="SIDE|relief"), UNSET] = None
    side: Annotated[str | None, arg(metavar="SIDE"), UNSET] = None
    voxel_mm: Annotated[float | None, UNSET] = None
    vertex_mm: Annotated[float | None, UNSET] = None
    version: Annotated[OmeVersion | None, UNSET] = None
    inverse: bool = False
    overwrite: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Write the file, print what is in it, and return the exit status."""
        from endoct.workbench.exporting.export import export

        exported = export(
            self.path,
            self.output,
            to=self.to,
            color=self.color,
            side=self.side,
            voxel_mm=self.voxel_mm,
            vertex_mm=self.vertex_mm,
            version=self.version,
            inverse=self.inverse or None,
            overwrite=self.overwrite,
            progress=command_stages(self.json),
        )
        if self.json:
            print_json(exported.to_json())
            return DONE
        facts = exported.facts
        said = [" × ".join(map(str, shape))] if isinstance(shape := facts.get("shape"), list) else []
        said += [f"{facts[key]} {key}" for key in ("vertices", "faces", "rows") if key in facts]
        if isinstance(step_mm := facts.get("step_mm"), list):
            said.append(f"{' × '.join(f'{step:.4g}' for step in step_mm)} mm a step")
        if "from" in facts:
            said.append(f"from {facts['from']} to {facts['to']}")
        print_line(f"{exported.format}: {self.output} ({', '.join(said)})")
        print_doubts(exported.doubts, {"": exported.notes})
        return DONE


def verify(path: Positional[Path], json: bool = False) -> int:
    """Check that an output of endoct is as it was written, to the byte: nothing changed, missing or added.

    Args:
        path: a panorama, comparison, report, export, specimen, data set, summary or bench results, or a folder of such
        json: print as JSON
    """
    from endoct.workbench.verifying import verify as check

    verdicts = check(path, progress=command_stages(json))
    wrong = [verdict for verdict in verdicts if not verdict.intact]
    if json:
        print_json([verdict.to_json() for verdict in verdicts])
        return UNUSABLE_INPUT if wrong else DONE
    for verdict in verdicts:
        state = "as it was written" if verdict.intact else str(verdict.differences)
        print_line(f"{verdict.path}: {verdict.kind}, {verdict.files} files, {verdict.bytes / 1e6:.1f} MB: {state}")
    if wrong:
        raise EndoctError(
            f"{len(wrong)} of {len(verdicts)} outputs in {path} are not as they were written"
            if len(verdicts) > 1
            else f"{path} is not as it was written",
            found=str(wrong[0].differences),
            remedy="make it again, or take back what was changed",
        )
    return DONE
