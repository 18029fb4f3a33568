"""The command that writes what other programs open."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line
from endoct.workbench.exporting.formats import FormatName, OmeVersion
from endoct.workbench.requests import UNSET, OutputPath
from endoct.workbench.running.refusals import DONE


def export(
    path: Positional[Path],
    output: OutputPath,
    to: Annotated[FormatName | None, UNSET] = None,
    color: Annotated[str | None, arg(metavar="SIDE|relief"), UNSET] = None,
    side: Annotated[str | None, arg(metavar="SIDE"), UNSET] = None,
    voxel_mm: Annotated[float | None, UNSET] = None,
    vertex_mm: Annotated[float | None, UNSET] = None,
    version: Annotated[OmeVersion | None, UNSET] = None,
    inverse: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
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
    from endoct.workbench.exporting.export import export as write

    exported = write(
        path,
        output,
        to=to,
        color=color,
        side=side,
        voxel_mm=voxel_mm,
        vertex_mm=vertex_mm,
        version=version,
        inverse=inverse or None,
        overwrite=overwrite,
        progress=command_stages(json),
    )
    if json:
        print_json(exported.to_json())
        return DONE
    facts = exported.facts
    said = [" × ".join(map(str, shape))] if isinstance(shape := facts.get("shape"), list) else []
    said += [f"{facts[key]} {key}" for key in ("vertices", "faces", "rows") if key in facts]
    if isinstance(step_mm := facts.get("step_mm"), list):
        said.append(f"{' × '.join(f'{step:.4g}' for step in step_mm)} mm a step")
    if "from" in facts:
        said.append(f"from {facts['from']} to {facts['to']}")
    print_line(f"{exported.format}: {output} ({', '.join(said)})")
    print_doubts(exported.doubts, {"": exported.notes})
    return DONE
