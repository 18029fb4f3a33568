"""The command that checks whether outputs are as they were written."""

from pathlib import Path

from tyro.conf import Positional

from endoct.base.errors import EndoctError
from endoct.workbench.commands.console import command_stages, print_json, print_line
from endoct.workbench.running.refusals import DONE, UNUSABLE_INPUT


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
