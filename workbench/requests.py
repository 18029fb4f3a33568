"""What a command is asked for: one request each, which the command line and Python read alike.

An option of a command is a field here, with its meaning, its default and its flag, and nowhere else. The command line
makes a request of its words; a function of the Python interface makes one of its arguments, by :func:`by_request`.
"""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, ParamSpec, Protocol, TypeVar, overload

from tyro.conf import Fixed, Positional, Suppress, UseAppendAction, arg

from endoct.base.files.files import path_text
from endoct.modalities.device import Device
from endoct.synthetic.sample.presets import PresetName

UNSET = arg(help_behavior_hint="")
"""For an option without a value. Its help names no default, since its sentence says what holds then."""
FormatName = Literal[
    "ome-zarr", "ome-tiff", "nrrd", "nifti", "ply", "stl", "glb", "itk-transform", "labels", "dicom", "csv",
    "pdf", "svg",
]  # fmt: skip
RecipeName = Literal["paper"]
OmeVersion = Literal["0.5", "0.4"]
P = ParamSpec("P")
Request = TypeVar("Request")
Asked = TypeVar("Asked", contravariant=True)
Out = TypeVar("Out", covariant=True)

if TYPE_CHECKING:  # what Python takes; below, what the command line makes of its words
    from endoct.modalities.ct.stored import Convention
    from endoct.modalities.ct.trajectory import Point
    from endoct.stitching.panorama import Panorama
    from endoct.synthetic.sample.ranges import Range
    from endoct.workbench.running.progress import Stages

    AnyPath = Path | str
    Recorded = Panorama | Path | str
    Recordings = Sequence[Panorama | Path | str]
    Paths = Sequence[Path | str]
    Names = Sequence[str] | str
    Conditions = Sequence[str]
    Settings = Mapping[str, object] | Sequence[str] | None
    Ranges = Mapping[str, Range] | Sequence[str] | None
    Place = Point | str | None
    TableName = Path | str | None
    Progress = bool | Stages
    Remark = Callable[[str], None] | None
else:
    AnyPath = Recorded = Path
    Recordings = Paths = tuple[Path, ...]
    Names, Conditions = Annotated[str, arg(metavar="NAME,NAME")], tuple[str, ...]
    Settings = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")]
    Ranges = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=LOW..HIGH")]
    Place = Annotated[str | None, arg(metavar="X,Y,Z"), UNSET]
    TableName = Annotated[str | None, arg(metavar="FILE|endoct"), UNSET]
    Convention = Literal["ras", "lps"]
    Progress = Remark = Suppress[Fixed[Any]]

Output = Annotated[AnyPath, arg(aliases=["-o"])]
OutputPath = Annotated[Path, arg(aliases=["-o"])]
ModalityName = Annotated[str | None, arg(metavar="NAME"), UNSET]
Recipe = Annotated[RecipeName | None, UNSET]


@dataclass(frozen=True, eq=False)
class UnrollRequest:
    """What to unroll, and how.

    Args:
        path: folder or file of the recording
        output: Zarr store to write
        modality: plug-in to read it with, where the sidecar does not say
        recipe: settings by one word; paper: the chain of Laves et al. 2019. What is set besides wins over it
        settings: a key of the sidecar or a processing parameter; repeat for more
        volume: add the dense hollow cylinder, sub-surface included
        overwrite: replace the output if it exists
        progress: False displays none
    """

    path: Positional[AnyPath]
    output: Annotated[Output | None, UNSET] = None
    _: KW_ONLY
    modality: ModalityName = None
    recipe: Recipe = None
    settings: Annotated[Settings, arg(name="set")] = ()
    volume: bool = False
    overwrite: bool = False
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class InfoRequest:
    """What to describe, and what to write of it.

    Args:
        path: folder or file
        modality: plug-in to read it with
        write_sidecar: write an acquisition.toml to fill in
        thumbnail: write a picture of the first, the middle and the last frame of a recording
        overwrite: replace the acquisition.toml if it exists
    """

    path: Positional[Path]
    _: KW_ONLY
    modality: ModalityName = None
    write_sidecar: bool = False
    thumbnail: Annotated[Path | None, arg(metavar="FILE.png"), UNSET] = None
    overwrite: bool = False


@dataclass(frozen=True, eq=False)
class CompareRequest:
    """Which two sides to compare, and how.

    Args:
        a: first side; the comparison is in its frame
        b: second side
        output: folder to write to
        truth: mask drawn over side A's panorama, to score both against: an image, labels in Zarr, shapes of napari
            (.csv) or regions of Fiji (.roi, .zip); several may follow, named RATER_SESSION.png; or a simulated
            specimen's truth folder
        session: file with landmark pairs, as the page of `endoct serve` saves it: some correct the alignment by hand,
            the others check it
        known: comparisons of nine or more other specimens with --truth, by which the error of this one is bounded
        modality_a: plug-in to read side A with
        modality_b: plug-in to read side B with
        recipe: settings by one word; paper: the chain of Laves et al. 2019, for both sides and the comparison. What is
            set besides wins over it
        settings: a parameter of the comparison; repeat for more
        settings_a: a key of side A's sidecar or a parameter of its processing
        settings_b: a key of side B's sidecar or a parameter of its processing
        overwrite: replace the output if it exists
        progress: False displays none
    """

    a: Positional[Recorded]
    b: Positional[Recorded]
    output: Annotated[Output | None, UNSET] = None
    _: KW_ONLY
    truth: Paths = ()
    session: Annotated[AnyPath | None, UNSET] = None
    known: Paths = ()
    modality_a: ModalityName = None
    modality_b: ModalityName = None
    recipe: Recipe = None
    settings: Annotated[Settings, arg(name="set")] = ()
    settings_a: Annotated[Settings, arg(name="set-a")] = ()
    settings_b: Annotated[Settings, arg(name="set-b")] = ()
    overwrite: bool = False
    progress: Progress = True

    def asked(self) -> dict[str, str | tuple[str, ...]]:
        """Return what is asked for beyond the defaults, the output left out, as words; panoramas at hand have none."""
        words: dict[str, str | tuple[str, ...]] = {}
        for field in fields(CompareRequest):
            value = getattr(self, field.name)
            if field.name in ("output", "overwrite", "progress") or not value or value == field.default:
                continue
            if isinstance(value, Mapping):
                value = [
                    f"{key}={of if isinstance(of, str) else json.dumps(of, default=str)}" for key, of in value.items()
                ]
            if isinstance(value, str | Path):
                words[field.name] = path_text(value)
            elif isinstance(value, Sequence):
                words[field.name] = tuple(path_text(one) for one in value)
        return words


@dataclass(frozen=True, eq=False)
class SimulateRequest:
    """Which specimen to simulate, and with what.

    Args:
        output: folder for the specimen
        preset: size and difficulty of the recordings
        seed: seed of the specimen; the same seed gives the same bytes
        replay: truth/sample.json of a specimen to simulate again; nothing is drawn then
        vary: range or choices of a parameter, such as oct.wall_db=6..14 or oct.scan=step|helical; repeat for more
        bone: CT or segmentation of one to drill into: a file .nrrd, .nii.gz, .mha, or a folder of DICOM
        entry_mm: where the drill enters that bone, mm, as --entry=12.5,-40,7
        target_mm: where it ends, mm
        coordinates: what x, y and z of these two mean; default: as the file says (NIfTI RAS, NRRD its space, else LPS)
        bone_hu: least Hounsfield unit that is bone; default: 300
        bone_label: label that is bone, in a segmentation; default: every one but 0
        detail_mm: rms in mm of roughness finer than the voxels to add to that bone
        ct: add truth/ct.nii.gz, a CT of the bone before drilling, with labels and cells (preset mastoid, or --bone)
        ct_slice_mm: thickness of its slices in mm, as 0.6; default: as its voxels, 0.15 to 0.3
        cone_beam: add truth/cone_beam.nii.gz, a CT after drilling
        labels: add truth/labels: layers, visibility, shadows, noise-free twins, pixel to pixel maps
        spectra: add oct-spectra: the spectrometer's raw data, 2 kB per A-scan
        overwrite: replace the folder if it exists
        on_remark: called with what was mended in the bone and what is doubted of it, in sentences
        progress: False displays none
    """

    output: Output
    _: KW_ONLY
    preset: PresetName = "quick"
    seed: int = 0
    replay: Annotated[AnyPath | None, UNSET] = None
    vary: Ranges = ()
    bone: Annotated[AnyPath | None, UNSET] = None
    entry_mm: Annotated[Place, arg(name="entry")] = None
    target_mm: Annotated[Place, arg(name="target")] = None
    coordinates: Annotated["Convention | None", UNSET] = None
    bone_hu: Annotated[float | None, UNSET] = None
    bone_label: Annotated[int | None, UNSET] = None
    detail_mm: Annotated[float, arg(name="detail")] = 0.0
    ct: bool = False
    ct_slice_mm: Annotated[float | None, arg(name="ct-slice"), UNSET] = None
    cone_beam: bool = False
    labels: bool = False
    spectra: bool = False
    overwrite: bool = False
    on_remark: Remark = None
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """What to write for another program, and in which format.

    Args:
        path: a panorama written by `endoct unroll`, a folder written by `endoct compare`, or a simulated specimen
        output: file to write, or of OME-Zarr and DICOM the folder
        to: format, where the suffix of the output does not say it; labels always have to be named
        color: what colours a wall (ply, glb): a side's name for its brightness, or relief
        side: whose relief a wall has (ply, stl, glb), or whose numbers a table (csv)
        voxel_mm: size of a volume's voxels across the bore (nrrd, nifti); default 0.01. Along it they are as far apart
            as the slices
        vertex_mm: distance of a wall's vertices (ply, stl, glb); default 0.02
        version: of OME-Zarr; default 0.5
        inverse: a transform from the first side's frame to the second's (itk-transform), as resampling takes it
        overwrite: replace the output if it exists
        progress: False displays none
    """

    path: Positional[AnyPath]
    output: Output
    _: KW_ONLY
    to: Annotated[FormatName | None, UNSET] = None
    color: Annotated[str | None, arg(metavar="SIDE|relief"), UNSET] = None
    side: Annotated[str | None, arg(metavar="SIDE"), UNSET] = None
    voxel_mm: Annotated[float | None, UNSET] = None
    vertex_mm: Annotated[float | None, UNSET] = None
    version: Annotated[OmeVersion | None, UNSET] = None
    inverse: bool | None = None
    overwrite: bool = False
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class CalibrateRequest:
    """Which instrument to calibrate, and by what.

    Args:
        modality: oct, endoscope, or another that can be calibrated
        recording: folder or file of the recording of the tube
        target: tube.toml of the tube, as `endoct target` writes it, with the sizes that were measured
        output: file to write, such as calibration.toml, that sidecars cite; a figure is written next to it
        settings: a key of the sidecar or a processing parameter; repeat for more
        overwrite: replace the output if it exists
        progress: False displays none
    """

    modality: Positional[str]
    recording: Positional[AnyPath]
    _: KW_ONLY
    target: AnyPath
    output: Output
    settings: Annotated[Settings, arg(name="set")] = ()
    overwrite: bool = False
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class TargetRequest:
    """Which tube to print and calibrate by.

    Args:
        output: folder to write
        bore_diameter_mm: inner diameter, mm: that of the holes that are recorded
        overwrite: replace the folder if it exists
    """

    output: Output
    _: KW_ONLY
    bore_diameter_mm: Annotated[float, arg(name="bore")] = 2.5
    overwrite: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanRequest:
    """Where a bore was planned, and how to look for it.

    Args:
        entry_mm: where the bore was planned to begin, mm, as --entry=12.5,-40,7
        target_mm: where it was planned to end, mm
        plan: instead of these two, a line of 3D Slicer (.mrk.json)
        coordinates: what x, y and z of these two mean; default: as the file says (NIfTI RAS, NRRD its space, else LPS)
        device: where to compute; cuda: on a GPU
        overwrite: replace the output if it exists
        progress: False displays none
    """

    entry_mm: Annotated[Place, arg(name="entry")] = None
    target_mm: Annotated[Place, arg(name="target")] = None
    plan: Annotated[AnyPath | None, UNSET] = None
    coordinates: Annotated["Convention | None", UNSET] = None
    device: Device = "cpu"
    overwrite: bool = False
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class PoseRequest(PlanRequest):
    """Which bore to find in which CT.

    Args:
        sides: one or two of one bore, none with --plan-only: a recording, a panorama, or one side of a
            comparison as DIR:SIDE
        ct: CT from before drilling: a file .nrrd, .nii.gz, .mha, or a folder of DICOM
        output: folder to write to
        labels: segmentation in the world of the CT, with the names of its labels in it or in a table next to it
        label_names: table of these names, of 3D Slicer or ITK-SNAP; or the word endoct: 1 bone, 2 facial nerve,
            3 chorda tympani, 4 cochlea, 5 sigmoid sinus, 6 antrum
        modality_a: plug-in to read the first side with
        modality_b: plug-in to read the second side with
        settings_a: a key of the first side's sidecar or a parameter of its processing
        settings_b: a key of the second side's sidecar or a parameter of its processing
    """

    sides: Positional[Recordings]
    ct: AnyPath
    output: Annotated[Output | None, UNSET] = None
    _: KW_ONLY
    labels: Annotated[AnyPath | None, UNSET] = None
    label_names: TableName = None
    modality_a: ModalityName = None
    modality_b: ModalityName = None
    settings_a: Annotated[Settings, arg(name="set-a")] = ()
    settings_b: Annotated[Settings, arg(name="set-b")] = ()


@dataclass(frozen=True, eq=False)
class OutlookRequest(PlanRequest):
    """How well a bore in which CT could be told.

    Args:
        ct: CT from before drilling: a file .nrrd, .nii.gz, .mha, or a folder of DICOM
        output: folder to write to
        radius_mm: of the bore
        seen_mm: how much of the bore a recording would show; default: the plan's length
    """

    ct: AnyPath
    output: Annotated[AnyPath | None, UNSET] = None
    _: KW_ONLY
    radius_mm: float = 1.25
    seen_mm: Annotated[float | None, UNSET] = None


@dataclass(frozen=True, eq=False)
class SummariseRequest:
    """Which comparisons, or poses, to summarise.

    Args:
        folders: folders written by `endoct compare`, or by `endoct pose`
        output: folder to write to
        against: a second set of comparisons, paired with the first by their recordings, or else by folder names
        repeats: comparisons in one folder are of one specimen; report their repeatability
        overwrite: replace the output if it exists
    """

    folders: Positional[Paths]
    output: Annotated[Output | None, UNSET] = None
    _: KW_ONLY
    against: Paths = ()
    repeats: bool = False
    overwrite: bool = False


@dataclass(frozen=True, eq=False)
class VerifyRequest:
    """Which output to check.

    Args:
        path: a panorama, comparison, report, export, specimen, data set, summary or bench results, or a folder of such
        progress: False displays none
    """

    path: Positional[AnyPath]
    _: KW_ONLY
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class TrainRequest:
    """How to train a learned eye.

    Args:
        output: folder for the weights and their card
        bores: simulated bores to learn from, 10 to 20 s each
        steps: steps of the fit; 3000 take two minutes on a large GPU, and hours on two cores
        batch: pieces of bores a step
        seed: seed of the weights and of how examples are varied
        device: where to fit; bores are always simulated on the CPU
        overwrite: replace the output if it exists
        progress: False displays none
    """

    output: Output
    _: KW_ONLY
    bores: int = 120
    steps: int = 3000
    batch: int = 12
    seed: int = 1
    device: Device = "cpu"
    overwrite: bool = False
    progress: Progress = True


@dataclass(frozen=True, eq=False)
class BenchRequest:
    """Which methods to run, and on what.

    Args:
        task: alignment, stitching, segmentation, oct, depth, wall, pose or a task of another package; without one, all
            tasks are listed
        conditions: ranges or choices to draw cases from, right after the task, such as cell_mm=0.2..1 or
            modality=depth|intensity
        output: folder for results.csv, bench.json and plots
        methods: names of methods, separated by commas; default: all, or none where there are programs
        program: a method that is a program, NAME=COMMAND; it is called with two folders, what is given and the answer
        container: image of Podman or Docker in which each --program runs
        seeds: a range as 1000-1009, or numbers separated by commas; 0-99 are reserved for tuning
        count: cases per seed
        sweep: vary only this condition; the others stay at the middle of their range
        against: print differences from this method too, case by case
        data: folders of your own data with truth, or folders of such folders, instead of simulated cases
        workers: processes that share the cases; with more than one, timings are those of a busy machine
        overwrite: replace the output if it exists
        progress: False displays none
    """

    task: Positional[str]
    conditions: Positional[Conditions] = ()
    output: Annotated[AnyPath | None, arg(aliases=["-o"]), UNSET] = None
    _: KW_ONLY
    methods: Names = ""
    program: tuple[str, ...] = ()
    container: Annotated[str | None, arg(metavar="IMAGE"), UNSET] = None
    seeds: str = "1000-1009"
    count: int = 1
    sweep: Annotated[str | None, arg(metavar="CONDITION"), UNSET] = None
    against: Annotated[str | None, arg(metavar="NAME"), UNSET] = None
    data: Paths = ()
    workers: int = 1
    overwrite: bool = False
    progress: Progress = True


class ByRequest(Protocol[P, Asked, Out]):
    """A function that takes a request, or what one is made of."""

    @overload
    def __call__(self, request: Asked, /) -> Out: ...

    @overload
    def __call__(self, *given: P.args, **options: P.kwargs) -> Out: ...


def by_request(kind: Callable[P, Request]) -> Callable[[Callable[[Request], Out]], ByRequest[P, Request, Out]]:
    """Let a function of a request be called with what that ``kind`` of request is made of, too."""

    def decorate(function: Callable[[Request], Out]) -> ByRequest[P, Request, Out]:
        @wraps(function)
        def called(*given: Any, **options: Any) -> Out:
            ready = len(given) == 1 and not options and isinstance(given[0], kind)  # type: ignore[arg-type]
            return function(given[0] if ready else kind(*given, **options))

        returned = inspect.signature(function).return_annotation
        called.__signature__ = inspect.signature(kind).replace(return_annotation=returned)  # type: ignore[attr-defined]
        return called

    return decorate
