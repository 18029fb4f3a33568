"""Commands about one recording, and what can be read."""

from pathlib import Path

from rich.table import Table
from tyro.conf import Positional

from endoct.workbench.commands.console import (
    TextConsole,
    command_stages,
    print_doubts,
    print_json,
    print_line,
    status_of,
)
from endoct.workbench.commands.options import ModalityName, Output, Settings
from endoct.workbench.pipeline.inputs import path_text
from endoct.workbench.running.status import DONE


def unroll(
    path: Positional[Path],
    output: Output,
    modality: ModalityName = None,
    set: Settings = (),
    volume: bool = False,
    strict: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Unroll one recording into a panorama of the bore wall.

    Args:
        path: folder or file of the recording
        output: Zarr store to write
        modality: plug-in to read it with, where the sidecar does not say
        set: a key of the sidecar or a processing parameter; repeat for more
        volume: add the dense hollow cylinder, sub-surface included
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        overwrite: replace the output if it exists
        json: print as JSON
    """
    from endoct.workbench import api
    from endoct.workbench.pipeline.settings import parse

    panorama = api.unroll(
        path,
        output,
        modality=modality,
        settings=parse(set),
        volume=volume,
        overwrite=overwrite,
        progress=command_stages(json),
    )
    facts = {
        "output": path_text(output),
        "modality": panorama.modality,
        "rows": panorama.grid.n_z,
        "columns": panorama.grid.n_theta,
        "z_mm": [float(panorama.z_mm[0]), float(panorama.z_mm[-1])],
        "valid_fraction": float(panorama.valid.mean()),
        "doubts": [doubt.to_json() for doubt in panorama.doubts],
        "notes": list(panorama.notes),
    }
    if json:
        print_json(facts)
    else:
        print_line(
            f"panorama: {output} ({facts['rows']} rows × {facts['columns']} columns, "
            f"z {panorama.z_mm[0]:.2f} to {panorama.z_mm[-1]:.2f} mm, {panorama.valid.mean():.1%} valid)"
        )
        print_doubts(panorama.doubts, {"": panorama.notes})
    return status_of(panorama.doubts, strict=strict)


def info(
    path: Positional[Path],
    modality: ModalityName = None,
    write_sidecar: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Describe a recording, a panorama or a comparison, and what its sidecar lacks.

    Args:
        path: folder or file
        modality: plug-in to read it with
        write_sidecar: write an acquisition.toml to fill in
        overwrite: replace the acquisition.toml if it exists
        json: print as JSON
    """
    from endoct.workbench.pipeline.information import describe, write_sidecar_template

    if write_sidecar:
        sidecar, missing = write_sidecar_template(path, modality, overwrite=overwrite)
        print_line(f"sidecar: {sidecar}")
        for key, why in missing.items():
            print_line(f"to fill in: {key} – {why}")
        return DONE
    facts = describe(path, modality)
    if json:
        print_json(facts)
    else:
        table = Table(show_header=False, box=None)
        for key, value in facts.items():
            table.add_row(key, str(value))
        TextConsole().print(table)
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
