"""Commands about outputs: write them for other programs, and check that they are as they were written."""

from dataclasses import KW_ONLY, dataclass, replace

from endoct.base.errors import EndoctError
from endoct.workbench.commands.console import command_stages, print_doubts, print_json, print_line
from endoct.workbench.requests import ExportRequest, VerifyRequest
from endoct.workbench.running.refusals import DONE, UNUSABLE_INPUT


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

        chosen = self.inverse or None  # a flag that is not given chooses nothing
        exported = export(replace(self, inverse=chosen, progress=command_stages(self.json)))  # type: ignore[arg-type]
        if self.json:
            print_json(exported.to_json())
            return DONE
        facts = exported.facts
        said = [" × ".join(map(str, shape))] if isinstance(shape := facts.get("shape"), list) else []
        said += [f"{facts[key]} {key}" for key in ("vertices", "faces", "rows", "figures") if key in facts]
        if isinstance(step_mm := facts.get("step_mm"), list):
            said.append(f"{' × '.join(f'{step:.4g}' for step in step_mm)} mm a step")
        if "from" in facts:
            said.append(f"from {facts['from']} to {facts['to']}")
        print_line(f"{exported.format}: {self.output} ({', '.join(said)})")
        print_doubts(exported.doubts, {"": exported.notes})
        return DONE


@dataclass(frozen=True, eq=False)
class Verify(VerifyRequest):
    """Check that an output of endoct is as it was written, to the byte: nothing changed, missing or added.

    Args:
        json: print as JSON
    """

    _: KW_ONLY
    json: bool = False

    def __call__(self) -> int:
        """Check, print what is not as it was written, and return the exit status."""
        from endoct.workbench.verifying import verify

        verdicts = verify(replace(self, progress=command_stages(self.json)))
        wrong = [verdict for verdict in verdicts if not verdict.intact]
        if self.json:
            print_json([verdict.to_json() for verdict in verdicts])
            return UNUSABLE_INPUT if wrong else DONE
        for verdict in verdicts:
            state = "as it was written" if verdict.intact else str(verdict.differences)
            print_line(f"{verdict.path}: {verdict.kind}, {verdict.files} files, {verdict.bytes / 1e6:.1f} MB: {state}")
        if wrong:
            raise EndoctError(
                f"{len(wrong)} of {len(verdicts)} outputs in {self.path} are not as they were written"
                if len(verdicts) > 1
                else f"{self.path} is not as it was written",
                found=str(wrong[0].differences),
                remedy="make it again, or take back what was changed",
            )
        return DONE
