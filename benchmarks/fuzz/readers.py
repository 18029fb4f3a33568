"""Everything of endoct that reads what somebody gives it, each as a function of a path, with its sound files."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path

from benchmarks.fuzz import try_inputs, try_outputs
from benchmarks.fuzz.trees import Seed


@dataclass(frozen=True)
class Reader:
    """``read`` is called with the path of a case; of many files ``share`` are its, relative to the others'.

    ``seconds``: what it may take at most.
    """

    name: str
    read: Callable[[Path], object]
    seeds: Callable[[], Iterable[Seed]]
    share: float
    seconds: float = 5.0


def _seeds(module: str, *names: str) -> Callable[[], Iterator[Seed]]:
    """Return what yields the seeds of functions by name; modules that make seeds are loaded when they are asked."""

    def seeds() -> Iterator[Seed]:
        for name in names:
            yield from getattr(import_module(f"benchmarks.fuzz.{module}"), name)()

    return seeds


_ALL = (
    Reader("tiff", try_inputs.try_frames, _seeds("seed_recordings", "tiff_seeds"), 18),
    Reader("npy", try_inputs.try_frames, _seeds("seed_recordings", "npy_seeds"), 9),
    Reader("images", try_inputs.try_frames, _seeds("seed_recordings", "image_seeds"), 9),
    Reader("video", try_inputs.try_frames, _seeds("seed_recordings", "video_seeds"), 8),
    Reader("dicom", try_inputs.try_stated, _seeds("seed_formats", "dicom_seeds"), 8),
    Reader("microscopes", try_inputs.try_stated, _seeds("seed_formats", "microscope_seeds"), 8),
    Reader("sidecar", try_inputs.try_sidecar, _seeds("seed_recordings", "sidecar_seeds"), 7),
    Reader("recording", try_inputs.try_recording, _seeds("seed_recordings", "recording_seeds"), 5),
    Reader("thorlabs", try_inputs.try_opened, _seeds("seed_recordings", "thorlabs_seeds"), 8),
    Reader("settings", try_inputs.try_settings, _seeds("seed_recordings", "setting_seeds"), 3),
    Reader("drawings", try_inputs.try_drawing, _seeds("seed_drawings", "drawing_seeds"), 12),
    Reader("masks", try_inputs.try_mask, _seeds("seed_drawings", "mask_seeds"), 4),
    Reader("labels", try_inputs.try_drawing, _seeds("seed_drawings", "label_seeds"), 6),
    Reader("pictures", try_outputs.try_pictures, _seeds("seed_drawings", "picture_seeds"), 3),
    Reader("panorama", try_outputs.try_panorama, _seeds("seed_results", "panorama_seeds"), 3),
    Reader("comparison", try_outputs.try_comparison, _seeds("seed_results", "comparison_store_seeds"), 3),
    Reader("report", try_outputs.try_report, _seeds("seed_results", "comparison_seeds"), 3),
    Reader("figures", try_outputs.try_figures, _seeds("seed_results", "comparison_seeds"), 0.5, 120.0),
    Reader(
        "exports",
        try_outputs.try_exports,
        _seeds("seed_results", "comparison_store_seeds", "comparison_seeds", "panorama_seeds"),
        0.5,
        30.0,
    ),
    Reader("eye", try_outputs.try_eye, _seeds("seed_outputs", "eye_seeds"), 2),
    Reader("submissions", try_outputs.try_submissions, _seeds("seed_outputs", "submission_seeds"), 2),
    Reader("describe", try_outputs.try_describe, _seeds("seed_results", "result_seeds", "panorama_seeds"), 2),
    Reader("summary", try_outputs.try_summary, _seeds("seed_results", "summary_seeds"), 2),
    Reader("session", try_outputs.try_session, _seeds("seed_results", "session_seeds"), 2),
    Reader("drawn", try_outputs.try_drawn, _seeds("seed_results", "drawn_seeds"), 1),
    Reader("truth", try_outputs.try_truth, _seeds("seed_results", "truth_seeds"), 1.5),
    Reader("specimens", try_outputs.try_specimens, _seeds("seed_sets", "set_seeds"), 2),
    Reader("records", try_outputs.try_records, _seeds("seed_sets", "record_seeds"), 2),
    Reader("sample", try_inputs.try_sample, _seeds("seed_sets", "sample_seeds"), 3),
    Reader("volumes", try_inputs.try_volume, _seeds("seed_volumes", "volume_seeds"), 12),
    Reader("plans", try_inputs.try_plan, _seeds("seed_volumes", "plan_seeds"), 2),
    Reader("label-names", try_inputs.try_label_names, _seeds("seed_volumes", "label_table_seeds"), 1),
    Reader("outputs", try_outputs.try_output, _seeds("seed_outputs", "output_seeds"), 2),
    Reader("unfinished", try_outputs.try_unfinished, _seeds("seed_outputs", "unfinished_seeds"), 0.5),
)
READERS = {reader.name: reader for reader in _ALL}


@cache
def seeds_of(name: str) -> tuple[Seed, ...]:
    """Return the sound cases of a reader."""
    return tuple(READERS[name].seeds())
