"""Commands about one recording, and what can be read."""

from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from endoct.base.files.files import path_text
from endoct.workbench.commands.console import (
    TextConsole,
    command_stages,
    print_doubts,
    print_json,
    print_line,
    status_of,
)
from endoct.workbench.requests import UNSET, ModalityName, Output, UnrollRequest
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


def info(
    path: Positional[Path],
    modality: ModalityName = None,
    write_sidecar: bool = False,
    thumbnail: Annotated[Path | None, arg(metavar="FILE.png"), UNSET] = None,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Describe a recording, a panorama, a comparison, a CT, a label map or a plan, and what a sidecar lacks.

    Args:
        path: folder or file
        modality: plug-in to read it with
        write_sidecar: write an acquisition.toml to fill in
        thumbnail: write a picture of the first, the middle and the last frame of a recording
        overwrite: replace the acquisition.toml if it exists
        json: print as JSON
    """
    from endoct.workbench.pipeline.information import STATED, describe, in_lines, recognise, write_thumbnail
    from endoct.workbench.pipeline.sidecar_template import write_sidecar_template

    if thumbnail is not None:
        write_thumbnail(recognise(path, modality).sniff.preview, path, thumbnail)
    if write_sidecar:
        recognised = recognise(path, modality)
        sidecar, missing = write_sidecar_template(path, recognised.manifest.name, overwrite=overwrite)
        print_line(f"sidecar: {sidecar}")
        if recognised.certainty != STATED:
            print_line(f"modality: {recognised.manifest.name} ({recognised.certainty}: {recognised.sniff.reason})")
        for key, why in missing.items():
            print_line(f"to fill in: {key} – {why}")
        return DONE
    facts = describe(path, modality)
    if json:
        print_json(facts)
    else:
        for line in in_lines(facts):
            print_line(line)
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
