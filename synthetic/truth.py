"""The truth about a specimen: its wall, how its recordings were made, and all that was drawn."""

import json
from pathlib import Path

import numpy as np

from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.modalities.ct.stored import SIGNS, Convention
from endoct.synthetic.bone.anatomy import target_mm
from endoct.synthetic.bone.field import world_of
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.endoscope.cone import band_centre_mm
from endoct.synthetic.sample.parameters import Sample

THETA_OF_ASCANS = (
    "turn = 2 pi (k + lost) / n_ascans * turn_length[i], where lost is the sum of count over lost_ascans with "
    "slice_index = i and ascan <= k; theta_beam = theta_origin_rad + theta_sense * (turn + start_angle_rad[i] + "
    "sum over h >= 1 of rotation_error_cos_rad[i][h-1] cos(h turn) + rotation_error_sin_rad[i][h-1] sin(h turn)); "
    "z_beam = z_mm[i] + z_advance_mm * turn / (2 pi); the beam leaves from offset_mm[i] in the direction "
    "offset_direction_rad[i] off the axis of the capillary, whose glass bends it"
)
THETA_OF_PIXELS = "theta_wall = atan2(row - centre_row, column - centre_column) + roll_rad[i]"


def write_truth(folder: Path, sample: Sample, wall: Wall) -> None:
    """Write ``wall.zarr``, ``recording.json`` and ``sample.json`` into ``folder``."""
    folder.mkdir()
    _write_wall(folder / "wall.zarr", wall)
    (folder / "recording.json").write_text(json.dumps(recording(sample), indent=1) + "\n", encoding="utf-8")
    (folder / "sample.json").write_text(sample.model_dump_json(indent=1) + "\n", encoding="utf-8")


def recording(sample: Sample) -> dict[str, object]:
    """Return per modality the transform to the bore frame, and what moved, per frame in the order recorded.

    ``z_mm``: place in the bore frame of every slice, and of the middle of the band every image shows.
    ``travel``, and for the OCT ``theta_sense`` (+1: A-scans run with θ, −1: against it) and ``theta_origin_rad``.

    So a panorama with θ = 2πk/n and z = 0 at the frame nearest the mouth lies at θ_bore = theta_origin_rad +
    theta_sense·θ, z_bore = z_origin_mm + z. For the endoscope θ_bore = θ_image + roll of the frame; its
    ``theta_origin_rad`` is the roll of the frame nearest the mouth. ``theta_formula`` says in full how beams and pixels
    lie. Catheter offset (mm) and its direction (rad) are those from the capillary's axis, in the directions of the bore
    frame. That axis lies at −``capillary_tilt_rad``·(z − length/2) in the direction ``capillary_tilt_direction_rad``.
    ``offset_mm`` of the endoscope is the (x, y) of the cone's apex.
    """
    oct_, camera = sample.oct, sample.endoscope
    oct_span = min(oct_.z_mm), max(oct_.z_mm)
    half = camera.visible_length_mm / 2
    image_span = min(camera.z_mm) - half, max(camera.z_mm) + half
    shared = min(oct_span[1], image_span[1]) - max(oct_span[0], image_span[0])
    return {
        "bore_radius_mm": sample.bore.diameter_mm / 2,
        **({"world": world(sample)} if sample.bore.volume or sample.bore.network else {}),
        "overlap_mm": shared,
        "overlap_fraction_of_shorter": shared / min(oct_span[1] - oct_span[0], image_span[1] - image_span[0]),
        "oct": {
            "theta_formula": THETA_OF_ASCANS,
            "theta_origin_rad": oct_.theta_origin_rad,
            "theta_sense": oct_.sense,
            "handedness": "same" if oct_.sense > 0 else "mirrored",
            "travel": oct_.travel,
            "z_origin_mm": oct_span[0],
            "first_sample_mm": oct_.first_sample_mm,
            "glass_mm": oct_.glass_mm,
            "glass_index": oct_.glass_index,
            "capillary_tilt_rad": sample.bore.tilt_rad,
            "capillary_tilt_direction_rad": sample.bore.tilt_direction_rad,
            "z_mm": oct_.z_mm,
            "z_advance_mm": oct_.z_advance_mm,
            "offset_mm": oct_.offset_mm,
            "offset_direction_rad": oct_.offset_direction_rad,
            "start_angle_rad": oct_.start_angle_rad,
            "turn_length": oct_.turn_length,
            "lost_ascans": [lost.model_dump() for lost in oct_.lost_ascans],
            "rotation_error_cos_rad": [[cos for cos, _ in harmonics] for harmonics in oct_.rotation_error_rad],
            "rotation_error_sin_rad": [[sin for _, sin in harmonics] for harmonics in oct_.rotation_error_rad],
        },
        "endoscope": {
            "theta_formula": THETA_OF_PIXELS,
            "theta_origin_rad": camera.roll_rad[int(np.argmin(camera.z_mm))],
            "theta_sense": 1,
            "travel": camera.travel,
            "z_origin_mm": min(camera.z_mm),
            "apex_to_band_centre_mm": band_centre_mm(camera, sample.bore.diameter_mm / 2),
            "z_mm": camera.z_mm,
            "roll_rad": camera.roll_rad,
            "centre_px": camera.centre_px,
            "inner_px": camera.inner_px,
            "outer_px": camera.outer_px,
            "offset_mm": camera.offset_mm,
            "tilt_rad": camera.probe_tilt_rad,
            "tilt_direction_rad": camera.probe_tilt_direction_rad,
        },
    }


def world(sample: Sample) -> dict[str, object]:
    """Return where the bore lies in the patient, and therefore in the CT.

    ``coordinates``: what x, y and z of the world mean, mm: "ras", to the right, the front and the head, as in
    ``ct.nii.gz``, or "lps". ``bore_to_world``: rows of a matrix (4, 4), world = matrix · (x, y, z, 1) of the bore
    frame. ``entry_mm`` is the mouth; ``target_mm`` what the drill aims at: the basal turn of a simulated cochlea, or
    what the user stated.
    """
    volume = sample.bore.volume
    coordinates: Convention = "ras" if volume is None else volume.coordinates
    to_world = np.diag([*SIGNS[coordinates], 1.0]) @ world_of(sample)
    target = to_world[:3, :3] @ target_mm(sample.bore) + to_world[:3, 3]
    return {
        "coordinates": coordinates,
        "formula": "(x, y, z, 1) of the world in mm = bore_to_world . (x, y, z, 1) of the bore frame",
        "bore_to_world": to_world.tolist(),
        "entry_mm": to_world[:3, 3].tolist(),
        "target_mm": target.tolist(),
    }


def _write_wall(path: Path, wall: Wall) -> None:
    surface = ("z", "theta")
    n_z, n_theta = wall.relief_mm.shape
    whole = (n_z, n_theta)
    ids = "the cell, as in ct_cells.nii.gz; of planted ones 1 + the index in sample.json; 0 where there is none"
    arrays = {
        "relief_mm": Named(
            surface, wall.relief_mm, {"units": "mm", "long_name": "wall radius minus bore radius"}, whole
        ),
        "cell": Named(surface, wall.cell, {"long_name": "the surface at the bore's radius is missing"}, whole),
        "cell_id": Named(surface, wall.cell_id, {"long_name": ids}, whole),
        "z": Named(("z",), wall.dz_mm * np.arange(n_z), {"units": "mm", "long_name": "along the bore, from its mouth"}),
        "theta": Named(("theta",), wall.dtheta_rad * np.arange(n_theta), {"units": "rad"}),
    }
    write_arrays(path, arrays, {"bore_radius_mm": wall.radius_mm})
