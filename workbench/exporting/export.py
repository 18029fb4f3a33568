"""One panorama, comparison or truth to one file of another program's format."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text
from endoct.base.files.output import check_output, never, new_output
from endoct.workbench.exporting.formats import FORMATS, Format, format_for
from endoct.workbench.exporting.mark import is_marked
from endoct.workbench.exporting.source import open_for_export
from endoct.workbench.requests import ExportRequest, FormatName, by_request
from endoct.workbench.running.outputs import EXPORT
from endoct.workbench.running.progress import stages_for
from endoct.workbench.running.scheduler import one_blas_thread


@dataclass(frozen=True)
class Exported:
    """What was written: ``path``, the name of its ``format``, what is in it (``facts``), and its doubts and notes."""

    path: Path
    format: FormatName
    facts: Mapping[str, object]
    doubts: tuple[Doubt, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """Return it for machines."""
        said = {"doubts": [doubt.to_json() for doubt in self.doubts], "notes": list(self.notes)}
        return {"output": path_text(self.path), "format": self.format, **self.facts, **said}


@by_request(ExportRequest)
@one_blas_thread()
def export(request: ExportRequest) -> Exported:
    """Write a panorama, a comparison or a simulated specimen's truth for another program to open, sizes in mm.

    Arguments are those of :class:`~endoct.workbench.requests.ExportRequest`. Raises :class:`EndoctError` where ``path``
    has nothing of the kind, an option is not one of the format, or ``output`` exists and ``overwrite`` is not set.

    With the comparison that :func:`~endoct.workbench.api.demo` makes in its example:

    >>> from endoct.workbench import export
    >>> wall = export("demo/comparison", "wall.ply", color="endoscope")
    >>> wall.format, wall.facts["relief"]
    ('ply', 'oct relief')
    """
    path, output, overwrite = Path(request.path), Path(request.output), request.overwrite
    chosen = format_for(request.to, output)
    _check_options(chosen, request)
    source, stages = open_for_export(path), stages_for(request.progress)
    is_ours = is_marked if chosen.is_marked and not chosen.is_folder else never
    inputs = [path, source.folder]
    if output.is_file() and not chosen.is_marked and overwrite:
        raise EndoctError(
            f"{output} exists, and a {chosen.name} file cannot say that endoct wrote it",
            remedy="move that away, or choose another output",
        )
    check_output(output, EXPORT, overwrite=overwrite, inputs=inputs, is_ours=is_ours)
    if chosen.name == "labels" and not source.labels:
        raise EndoctError(
            f"{path} has no cells", found=f"a {source.kind}", expected="a folder written by `endoct compare`"
        )
    with new_output(output, EXPORT, overwrite=overwrite, inputs=inputs, is_ours=is_ours) as scratch:
        facts = chosen.load()(source, scratch, request, stages)
    return Exported(output, chosen.name, facts, source.doubts, source.notes)


def _check_options(chosen: Format, request: ExportRequest) -> None:
    """Raise :class:`EndoctError` for an option that the format does not have, or a value that is none."""
    of_some = {option for form in FORMATS.values() for option in form.options}
    for name in (field.name for field in fields(request) if field.name in of_some):
        if name not in chosen.options and getattr(request, name) is not None:
            has = ", ".join(chosen.options) or "none"
            raise EndoctError(f"{chosen.name} has no option '{name}'", expected=has, remedy="leave it out")
    if request.version not in (None, "0.5", "0.4"):
        raise EndoctError("there is no such version of OME-Zarr", found=str(request.version), expected="0.5 or 0.4")
