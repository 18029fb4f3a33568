"""The command that writes what other programs open."""

from dataclasses import KW_ONLY, dataclass, fields

from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.refusals import DONE


@dataclass(frozen=True, eq=False)
class Export(ExportRequest):
    """Write a panorama, a comparison or a specimen's truth for other programs to open (see docs/how-to/export.md).

    Args:
        json: print as JSON
    """

    _: KW_ONLY
    inverse: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Write the file, print what is in it, and return the exit status."""
        from endoct.workbench.exporting.export import export

        given = {one.name: getattr(self, one.name) for one in fields(ExportRequest)}
        own = {"inverse": self.inverse or None, "progress": command_stages(self.json)}
        exported = export(ExportRequest(**given | own))
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
