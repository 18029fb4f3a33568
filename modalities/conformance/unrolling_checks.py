"""Checks of a plug-in's survey, of the strips it makes, and of the panorama they become."""

import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, cast
from unittest.mock import patch

import numpy as np
import xarray as xr

from endoct.modalities.assembly import assemble
from endoct.modalities.conformance.subject import (
    NotConforming,
    Replaced,
    Subject,
    demand,
    only_endoct_errors,
    pickled,
    refusal_allowed,
    same,
    same_strip,
)
from endoct.modalities.contract import LocatingModality, ReadingOnce, VolumetricModality
from endoct.modalities.illustration import places_of
from endoct.stitching.blend import blend
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama


def calibration_is_complete(subject: Subject) -> None:
    """The calibration can be pickled and has a row for every z and a value for every frame."""
    calibration = subject.calibration
    pickled(calibration, "the calibration")
    rows = np.asarray(calibration.row_z_mm)
    demand(rows.shape == (calibration.grid.n_z,), f"row_z_mm is {rows.shape} for {calibration.grid.n_z} rows")
    demand(np.isfinite(rows).all() and (np.diff(rows) > 0).all(), "row_z_mm does not ascend")
    demand("z_mm" in calibration.per_frame, "per_frame lacks 'z_mm'")
    for key, values in calibration.per_frame.items():
        demand(np.shape(values)[:1] == (len(subject.stream),), f"per_frame['{key}'] is not one value a frame")
    demand(np.isfinite(calibration.per_frame["z_mm"]).all(), "per_frame['z_mm'] is not finite")
    for note in calibration.notes:
        demand(re.fullmatch(r"[A-Z0-9].*\.", note, re.DOTALL), f"the note {note!r} is no full sentence")


def survey_does_not_depend_on_workers(subject: Subject) -> None:
    """The survey's answer is the same to the last bit, whatever the number of processors."""
    for processors in (1, 3):
        with patch("os.cpu_count", return_value=processors):
            other = subject.survey(subject.open())
        demand(other.grid == subject.calibration.grid, f"the grid is another with {processors} processors")
        demand(other.notes == subject.calibration.notes, f"the notes are others with {processors} processors")
        for key, values in subject.calibration.per_frame.items():
            unchanged = key in other.per_frame and same(values, other.per_frame[key])
            demand(unchanged, f"per_frame['{key}'] is another with {processors} processors")
        for index, strip in subject.strips.items():
            again = subject.modality.unroll(subject.stream[index], other)
            demand(same_strip(strip, again), f"frame {index} unrolls otherwise with {processors} processors")


def unrolling_is_pure(subject: Subject) -> None:
    """A frame unrolls to the same bytes every time, and stays as it was."""
    calibration = pickled(subject.calibration, "the calibration")
    for index, strip in subject.strips.items():
        frame = subject.stream[index]
        before = frame.samples.copy()
        demand(same_strip(strip, subject.modality.unroll(frame, calibration)), f"frame {index} unrolls otherwise again")
        demand(same(before, frame.samples), f"unrolling changes frame {index}")


def reading_once_changes_nothing(subject: Subject) -> None:
    """What a plug-in keeps of the frames, if it does, is surveyed and unrolled as they are, to the last bit."""
    if not hasattr(subject.modality, "reading_once"):
        return
    modality = cast(ReadingOnce[Any, Any], subject.modality)
    with modality.reading_once(subject.open(), modality.parameters()) as kept:
        other = subject.survey(kept)
        for key, values in subject.calibration.per_frame.items():
            demand(same(values, other.per_frame[key]), f"per_frame['{key}'] is another where frames are kept")
        for index, strip in subject.strips.items():
            again = modality.unroll(kept[index], other)
            demand(same_strip(strip, again), f"frame {index} unrolls otherwise where it was kept")


def strips_lie_on_the_grid(subject: Subject) -> None:
    """Every strip has all columns and consecutive rows of the panorama."""
    for strip in subject.strips.values():
        blend([strip], subject.calibration.grid, subject.calibration.row_z_mm)


def strips_are_sound(subject: Subject) -> None:
    """What is valid is finite, weights are not negative, depth is there where promised, and something was seen."""
    promised = "depth" in getattr(subject.stream, "provides", subject.manifest.provides)
    for index, strip in subject.strips.items():
        demand(
            (strip.depth_mm is not None) == promised, f"frame {index}: depth is {'' if promised else 'not '}promised"
        )
        demand(np.isfinite(strip.weight).all() and (strip.weight >= 0).all(), f"frame {index} has impossible weights")
        demand(
            np.isfinite(strip.intensity[strip.valid]).all(), f"frame {index} has a valid intensity that is not finite"
        )
        if strip.depth_mm is not None:
            demand(
                np.isfinite(strip.depth_mm[strip.valid]).all(), f"frame {index} has a valid depth that is not finite"
            )
    demand(any(strip.valid.any() for strip in subject.strips.values()), "no strip has a valid sample")


def theta_is_a_circle(subject: Subject) -> None:
    """Turning the recording's θ origin by a quarter turns the panorama by a quarter, over the seam too."""
    grid = subject.calibration.grid
    quarter = grid.n_theta // 4
    origin_rad = subject.stream.acquisition.theta_origin_rad + quarter * grid.dtheta_rad
    stream = subject.open(theta_origin_rad=origin_rad)
    calibration = subject.survey(stream)
    demand(calibration.grid.n_theta == grid.n_theta, "another θ origin changes the number of columns")
    columns = quarter - round((calibration.grid.theta0_rad - grid.theta0_rad) / grid.dtheta_rad)
    for index, strip in subject.strips.items():
        turned = subject.modality.unroll(stream[index], calibration)
        expected = np.roll(strip.intensity, columns, axis=1)
        seen = np.roll(strip.valid, columns, axis=1)
        if turned.valid.shape != seen.shape:
            raise NotConforming(f"frame {index} has other rows with another θ origin")
        both = turned.valid & seen
        demand(np.mean(turned.valid == seen) > 0.95, f"frame {index}: other samples are valid with another θ origin")
        if both.any():
            error = np.median(np.abs(turned.intensity - expected)[both])
            spread = np.std(expected[both])
            demand(
                error <= 0.05 * spread, f"frame {index} is not the same wall, turned: differs by {error / spread:.0%}"
            )


def settling_keeps_the_grid(subject: Subject) -> None:
    """The finished panorama has the grid of the assembled one, and is finite where valid."""
    assembled = _assembled(subject)
    settled = subject.modality.settle(assembled, subject.calibration)
    demand(settled.grid == assembled.grid and same(settled.z_mm, assembled.z_mm), "settling changes the grid")
    demand(settled.modality == subject.manifest.name, "settling changes the modality's name")
    for name in ("intensity", "depth_mm"):
        image = getattr(settled, name)
        demand(image is None or np.isfinite(image[settled.valid]).all(), f"{name} is not finite where it is valid")


def volumes_are_written(subject: Subject) -> None:
    """Where a volume is promised, it is written into the panorama's store, on the panorama's rows and columns."""
    if "volume" not in subject.manifest.provides:
        return
    demand(hasattr(subject.modality, "write_volume"), "a volume is promised, but there is no write_volume")
    volumetric = cast(VolumetricModality[Any, Any], subject.modality)
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "panorama.zarr"
        save_panorama(_assembled(subject), store)
        volumetric.write_volume(subject.stream, subject.calibration, store)
        with xr.open_zarr(store, group="volume", chunks=None) as volume:
            dims = {str(name): variable.dims for name, variable in volume.data_vars.items()}
            demand(("z", "theta", "depth") in dims.values(), f"no variable of the volume has z, theta, depth: {dims}")
            demand(
                (volume.sizes["z"], volume.sizes["theta"]) == subject.calibration.grid.shape,
                "the volume is not on the grid",
            )


def _assembled(subject: Subject) -> Panorama:
    strips = (
        subject.modality.unroll(subject.stream[index], subject.calibration) for index in range(len(subject.stream))
    )
    return assemble(strips, subject.calibration, subject.manifest)


def illustrations_can_be_drawn(subject: Subject) -> None:
    """The pictures for a report have names of their own, labels with units, and places on their axes."""
    frame = subject.stream[len(subject.stream) // 2]
    pictures = subject.modality.illustrate(frame, subject.calibration)
    names = [picture.name for picture in pictures]
    demand(len(set(names)) == len(names), f"two pictures have one name: {names}")
    for picture in pictures:
        demand(re.fullmatch(r"[A-Za-z0-9_-]+", picture.name), f"the picture name {picture.name!r} fits no file name")
        shape = np.shape(picture.image)
        demand(len(shape) == 2 or (len(shape) == 3 and shape[2] == 3), f"the picture {picture.name} is {shape}")
        demand(picture.x_label and picture.y_label, f"the picture {picture.name} has an axis without a label")
        demand(np.isfinite([*picture.x_extent, *picture.y_extent]).all(), f"the picture {picture.name} has no place")
        for label, curve in picture.curves.items():
            demand(
                np.ndim(curve) == 2 and np.shape(curve)[1] == 2, f"the curve {label} of {picture.name} is not (n, 2)"
            )


def places_are_located(subject: Subject) -> None:
    """Where places of the wall are located, they lie in the plug-in's own pictures, and those far away nowhere."""
    if getattr(subject.modality, "locate", None) is None:
        return
    modality = cast(LocatingModality[Any, Any], subject.modality)
    frame = subject.stream[len(subject.stream) // 2]
    pictures = {picture.name: picture for picture in modality.illustrate(frame, subject.calibration)}
    _, places = places_of(modality.unroll(frame, subject.calibration))
    found = modality.locate(frame.index, places, subject.calibration)
    demand(found.keys() <= pictures.keys(), f"places are located in {sorted(found)}, pictures are {sorted(pictures)}")
    turned = replace(places, theta_rad=places.theta_rad + 2 * np.pi)
    again = modality.locate(frame.index, turned, subject.calibration)
    away = replace(places, z_mm=places.z_mm + 10 * max(1.0, float(np.ptp(subject.calibration.row_z_mm))))
    nowhere = modality.locate(frame.index, away, subject.calibration)
    for name, xy in found.items():
        demand(xy.shape == (places.theta_rad.size, 2), f"places in {name} are {xy.shape}, not (n, 2)")
        known = np.isfinite(xy[:, 0])
        demand(known.any(), f"no place of frame {frame.index} is seen in {name}")
        demand(not np.isfinite(nowhere[name]).any(), f"places far away are seen in {name}")
        demand(np.allclose(again[name], xy, atol=1e-6, equal_nan=True), f"a turn further on, {name} sees other places")
        low, high = sorted(pictures[name].x_extent)
        inside = np.mean((xy[known, 0] > low - 0.1 * (high - low)) & (xy[known, 0] < high + 0.1 * (high - low)))
        demand(inside > 0.5, f"most places lie beside {name}")


def one_frame_is_a_recording(subject: Subject) -> None:
    """A recording of a single frame can be surveyed and unrolled."""
    one = Replaced(subject.stream, (len(subject.stream) // 2,))
    calibration = subject.survey(one)
    blend([subject.modality.unroll(one[0], calibration)], calibration.grid, calibration.row_z_mm)


def bad_frames_raise_endoct_errors(subject: Subject) -> None:
    """A black, a saturated and a noise-only recording is refused with an EndoctError, or unrolled; nothing else."""
    for what, make in (("black", np.zeros_like), ("constant", _constant), ("noise", _shuffled)):
        changed = Replaced(subject.stream, tuple(range(min(4, len(subject.stream)))), make)
        with only_endoct_errors(f"a recording that is {what}"), refusal_allowed():
            subject.modality.unroll(changed[0], subject.survey(changed))


def _constant(samples: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.full_like(samples, samples.max())


def _shuffled(samples: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).permuted(samples.ravel()).reshape(samples.shape)
