"""Where the panoramas of a simulated specimen truly lie, and how far a comparison of them is from that."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.json_values import number, read_object
from endoct.base.numeric.circle import wrap_rad
from endoct.base.zarr.zarr_store import read_arrays, read_attributes
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment
from endoct.fusion.sides import Comparison
from endoct.stitching.panorama import Panorama

MOST_RECORDING_BYTES = 16_000_000
FARTHEST = 1e6
"""No place in mm and no angle in rad is farther."""


@dataclass(frozen=True)
class Truth:
    """The truth of one specimen: ``wall``, the arrays of ``truth/wall.zarr``, and ``truth/recording.json``."""

    wall: Mapping[str, NDArray[Any]]
    recording: Mapping[str, Any]


@dataclass(frozen=True)
class TruePose:
    """Where a panorama truly lies: θ_bore = theta0_rad + sense · θ, z_bore by interpolation over its frames."""

    theta0_rad: float
    sense: int
    z_panorama_mm: Coordinates
    z_bore_mm: Coordinates

    def z_bore(self, z_mm: Coordinates) -> Coordinates:
        """Return the place in the bore of rows at ``z_mm``, continued beyond the first and last frame."""
        inner = np.interp(z_mm, self.z_panorama_mm, self.z_bore_mm)
        slope = np.sign(self.z_bore_mm[-1] - self.z_bore_mm[0]) if len(self.z_bore_mm) > 1 else 1.0
        return np.asarray(inner + slope * (z_mm - np.clip(z_mm, self.z_panorama_mm[0], self.z_panorama_mm[-1])))

    def theta_bore(self, theta_rad: Coordinates) -> Coordinates:
        """Return the angle in the bore frame of columns at ``theta_rad``."""
        return self.theta0_rad + self.sense * theta_rad


@dataclass(frozen=True, eq=False)
class TrueMap:
    """Where wall points of panorama B truly lie in panorama A's frame, the faults of both panoramas included.

    ``z_a_mm`` are the rows of A; the two poses say where each panorama lies in the bore.
    """

    z_a_mm: Coordinates
    pose_a: TruePose
    pose_b: TruePose

    @property
    def mirrored(self) -> bool:
        """Whether θ runs the other way in B."""
        return self.pose_a.sense != self.pose_b.sense

    def z_reversed(self, z_b_mm: Coordinates) -> bool:
        """Return whether B, with rows at ``z_b_mm``, runs along the bore the other way."""
        z_a, z_b = self.pose_a.z_bore(self.z_a_mm), self.pose_b.z_bore(z_b_mm)
        return bool((z_b[-1] - z_b[0]) * (z_a[-1] - z_a[0]) < 0)

    def z_to_a(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return z in A's frame, mm; NaN where A does not reach."""
        in_bore = self.pose_a.z_bore(self.z_a_mm)
        order = np.argsort(in_bore)
        wanted = self.pose_b.z_bore(np.asarray(z_b_mm, dtype=np.float64))
        return np.asarray(np.interp(wanted, in_bore[order], self.z_a_mm[order], left=np.nan, right=np.nan))

    def theta_to_a(self, theta_b_rad: ArrayLike) -> Coordinates:
        """Return θ in A's frame, rad."""
        in_bore = self.pose_b.theta_bore(np.asarray(theta_b_rad, dtype=np.float64))
        return np.asarray((in_bore - self.pose_a.theta0_rad) * self.pose_a.sense)

    def alignment(self, z_b_mm: Coordinates) -> Alignment:
        """Return the alignment of B, with rows at ``z_b_mm``, that is nearest to where these lie."""
        z_a_mm = self.z_to_a(z_b_mm)
        known = np.isfinite(z_a_mm)
        slope, shift_mm = np.polyfit(z_b_mm[known], z_a_mm[known], 1)
        turn_rad = float(np.mod(self.theta_to_a(0.0), 2 * np.pi))
        return Alignment(turn_rad, float(shift_mm), abs(float(slope)), self.mirrored, bool(slope < 0))


def load_truth(specimen: Path) -> Truth:
    """Read the truth of a simulated specimen. Raises :class:`EndoctError` where it has none, or it is damaged."""
    recording, wall = specimen / "truth" / "recording.json", specimen / "truth" / "wall.zarr"
    if not recording.is_file() or not wall.is_dir():
        raise EndoctError(f"{specimen} has no truth", expected="truth/recording.json and truth/wall.zarr in it")
    read_attributes(wall)
    arrays = read_arrays(wall)
    z_mm, theta_rad, cell = (arrays.get(name, np.empty(0)) for name in ("z", "theta", "cell"))
    if z_mm.ndim != 1 or theta_rad.ndim != 1 or z_mm.size < 2 or cell.shape != (z_mm.size, theta_rad.size):
        raise EndoctError(f"{wall} holds no wall", found=f"cells {cell.shape}", expected="cell, z and theta that fit")
    steps = np.diff(z_mm)
    if z_mm.dtype.kind != "f" or not np.isfinite(steps).all() or not (steps > 0).all() or cell.dtype.kind not in "biu":
        raise EndoctError(f"{wall} holds no wall", found="places or cells that cannot be", expected="ascending z")
    return Truth(arrays, read_object(recording, MOST_RECORDING_BYTES))


def true_pose(panorama: Panorama, truth: Truth) -> TruePose:
    """Return the pose of ``panorama``, made from one of the specimen's recordings, frame by frame.

    Raises :class:`EndoctError` where it was made of something else, or the truth is damaged.
    """
    of, frames = truth.recording.get(panorama.modality), panorama.per_frame.get(f"{panorama.frame_dim}_index")
    index = None if frames is None else frames.values
    if of is None or index is None or not _tells_of(of, index):
        raise EndoctError(
            f"the truth of a simulated specimen says nothing of this {panorama.modality} panorama",
            expected=f"one made of its recordings: {', '.join(sorted(map(str, truth.recording)))[:200]}",
            remedy="compare the specimen's own recordings",
        )
    with refusing("the truth of a simulated specimen cannot be used", remedy="simulate it again"):
        pose = _pose(panorama, of, index)
    whole = np.isfinite([pose.theta0_rad]).all() and all(
        np.isfinite(places).all() and places.shape == index.shape for places in (pose.z_panorama_mm, pose.z_bore_mm)
    )
    if not whole:
        raise EndoctError("the truth of a simulated specimen cannot be used", found="places that are not finite")
    return pose


def _tells_of(of: object, index: NDArray[Any]) -> bool:
    """Say whether ``of``, what the truth says of a recording, has the frames of ``index``."""
    frames = of.get("z_mm") if isinstance(of, dict) else None
    whole = index.ndim == 1 and index.size > 0 and index.dtype.kind in "iu"
    return isinstance(frames, list) and whole and bool(index.min() >= 0 and index.max() < len(frames))


def _pose(panorama: Panorama, of: Mapping[str, Any], index: NDArray[Any]) -> TruePose:
    z_panorama = panorama.per_frame[f"{panorama.frame_dim}_z_mm"].values
    # a helical turn advances while it is recorded: the truth refers to its first A-scan, the panorama to its middle
    advance_mm = number({"z_advance_mm": 0.0, **of}, "z_advance_mm", -1e3, 1e3, "the truth")
    z_bore = _numbers(of["z_mm"])[index] + advance_mm / 2
    if "roll_rad" in of:  # the panorama's angle of a frame is image angle + estimated roll
        turn = _numbers(of["roll_rad"])[index] - panorama.per_frame["roll_rad"].values
        return TruePose(float(turn[0] + np.median(wrap_rad(turn - turn[0]))), 1, z_panorama, z_bore)
    # a common angle of all turns is nothing a recording can know: the middle of theirs against what was found
    late = _numbers(of["start_angle_rad"]) + np.pi * (_numbers(of["turn_length"]) - 1)
    corrected = panorama.per_frame.get("start_angle_rad")
    late = late[index] - (0.0 if corrected is None else corrected.values)
    common = float(np.angle(np.sum(np.exp(1j * late))))
    stated_mirrored = panorama.provenance["acquisition"]["handedness"] == "mirrored"
    sense = -1 if number(of, "theta_sense", -1, 1, "the truth") < 0 else 1
    return TruePose(
        number(of, "theta_origin_rad", -1e3, 1e3, "the truth") + sense * common,
        sense * (-1 if stated_mirrored else 1),
        z_panorama,
        z_bore,
    )


def _numbers(stored: object) -> Coordinates:
    """Return a list of the truth as float64 (n,). Raises :class:`EndoctError` where it is none of finite numbers."""
    values = np.asarray(stored if isinstance(stored, list) else [], dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all() or np.abs(values).max(initial=0) > FARTHEST:
        raise EndoctError("the truth of a simulated specimen cannot be used", expected="lists of finite numbers")
    return values


def true_cells(truth: Truth, pose: TruePose, panorama: Panorama) -> Mask:
    """Return the true cells at the centres of the panorama's samples, bool (n_z, n_theta)."""
    return np.asarray(truth.wall["cell"][_nearest(truth, pose, panorama)], dtype=np.bool_)


def true_relief(truth: Truth, pose: TruePose, panorama: Panorama) -> Image:
    """Return wall radius minus bore radius at the centres of the panorama's samples, mm, float32 (n_z, n_theta)."""
    return np.asarray(truth.wall["relief_mm"][_nearest(truth, pose, panorama)], dtype=np.float32)


def _nearest(truth: Truth, pose: TruePose, panorama: Panorama) -> tuple[NDArray[np.intp], ...]:
    """Return rows (n_z, 1) and columns (1, n_theta) of the true wall that lie nearest the panorama's."""
    z_mm, n_theta = truth.wall["z"], truth.wall["theta"].size
    rows = np.clip(np.rint((pose.z_bore(panorama.z_mm) - z_mm[0]) / (z_mm[1] - z_mm[0])), 0, z_mm.size - 1)
    columns = np.rint(pose.theta_bore(panorama.grid.theta_rad) / (2 * np.pi) * n_theta).astype(int) % n_theta
    return np.ix_(rows.astype(int), columns)


def held_against(
    truth: Truth, sides: tuple[Side, Side], comparison: Comparison, parameters: SegmentParameters
) -> dict[str, float]:
    """Return how close a comparison of a specimen's endoscope (A) and OCT (B), the ``sides``, is to the truth.

    - ``aligned``: 1 or 0.
    - ``oct_truth``: Jaccard index of the OCT cells against the true cells, over the samples the OCT calls valid. The
      OCT's own rows and columns are placed in the bore by the true pose of every slice.
    - ``endo_truth``: the same for the endoscope.
    - ``oct_valid``: share of the OCT's samples that are valid, within the z range both instruments covered.

    and, where the two were aligned,

    - ``pair_native``, ``pair_grid``: endoscope against OCT, on the OCT's rows and on the comparison's grid.
    - ``theta_deg``, ``z_mm``: error of the alignment, median over the overlap.
    - ``landmark_mm``: distance between where a wall point of the OCT panorama is mapped to and where it is, stitching
      included, 95th percentile.
    - ``right``: 1 where handedness and direction of travel were found, else 0.
    - ``confidence``: as the alignment states it.
    """
    endoscope, oct_ = (side.panorama for side in sides)
    pose_e, pose_o = true_pose(endoscope, truth), true_pose(oct_, truth)
    true = TrueMap(endoscope.z_mm, pose_e, pose_o)
    z_true = true.z_to_a(oct_.z_mm)
    shared = np.isfinite(z_true)
    figures = {
        "aligned": float(comparison.alignment is not None),
        "oct_truth": _known(jaccard(segment(sides[1], parameters), true_cells(truth, pose_o, oct_), oct_.valid)),
        "oct_valid": float(oct_.valid[shared].mean()),
        "endo_truth": _known(
            jaccard(segment(sides[0], parameters), true_cells(truth, pose_e, endoscope), endoscope.valid)
        ),
    }
    if (alignment := comparison.alignment) is None:
        return figures
    # where each OCT sample of the overlap truly lies in the endoscope's frame, and where the alignment puts it
    theta_rad, z_mm = oct_.grid.theta_rad[np.newaxis], oct_.z_mm[shared][:, np.newaxis]
    d_theta = wrap_rad(alignment.theta_to_a(theta_rad, z_mm) - true.theta_to_a(theta_rad))
    d_z = alignment.z_to_a(oct_.z_mm[shared]) - z_true[shared]
    distance = np.hypot(d_theta * oct_.grid.radius_mm, d_z[:, np.newaxis])
    right = alignment.mirrored == true.mirrored and alignment.z_reversed == true.z_reversed(oct_.z_mm)
    return figures | {
        "pair_native": _known(comparison.result.own_rows_jaccard),
        "pair_grid": _known(comparison.result.jaccard),
        "theta_deg": float(np.rad2deg(np.median(d_theta))),
        "z_mm": float(np.median(d_z)),
        "landmark_mm": float(np.percentile(distance, 95)),
        "right": float(right),
        "confidence": float(alignment.confidence),
    }


def _known(score: float | None) -> float:
    """Return a Jaccard index, 0 where neither side shows a cell: of specimens that have cells, both missed them."""
    return 0.0 if score is None else float(score)
