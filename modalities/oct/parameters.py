"""Every free parameter of the OCT plug-in, with its unit."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class OctParameters(BaseModel):
    """How a pullback is processed. The defaults suit every geometry that a sidecar can describe."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    undistort: Literal["eccentric", "sine"] = Field(
        default="eccentric", description="map (r, θ) about the capillary's axis, or shift by the sine (Laves 2019)"
    )
    wall: Literal["edge", "maximum"] = Field(
        default="edge", description="the wall is the first real edge, or the index of the maximum (Laves 2019)"
    )
    n_theta: int | None = Field(
        default=None, ge=64, le=65536, description="columns of the panorama; default 2048, at most the A-scans"
    )

    # the outer face of the capillary
    start_amplitude_mm: float | None = Field(
        default=None, ge=0, le=100, description="start value A of the sine, all slices"
    )
    start_phase_rad: float | None = Field(
        default=None, ge=-1000, le=1000, description="start value φ of the sine, all slices"
    )
    start_offset_mm: float | None = Field(
        default=None, ge=-1000, le=1000, description="start value D of the sine, all slices"
    )
    face_tolerance_mm: float = Field(
        default=0.015, ge=1e-4, le=10, description="how far an inlier lies from the fitted face"
    )
    ransac_trials: int = Field(default=1500, ge=50, le=50_000, description="sines tried for each line of a slice")
    least_inlier_fraction: float = Field(
        default=0.2, gt=0, lt=1, description="of A-scans that show the face; slices with fewer are bridged"
    )
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="of the random choice of A-scans")

    # the rotation of the catheter
    correct_rotation: bool = Field(default=True, description="undo the smooth error of angle within every turn")
    correct_turn_length: bool = Field(default=True, description="undo turns that are longer or shorter than counted")
    correct_start_angle: bool = Field(default=True, description="undo turns that start at an angle of their own")
    correct_lost_ascans: bool = Field(default=True, description="undo jumps of angle where A-scans were lost")
    start: Literal["auto", "triggered", "free"] = Field(
        default="auto",
        description="turns start at one angle (triggered) or anywhere (free); auto: judged by the capillary",
    )

    # enhancement before the fit
    denoise_threshold: float = Field(default=1.0, ge=0, le=1000, description="soft threshold of wavelets, in noise σ")
    clahe_clip_limit: float = Field(
        default=2.0, ge=1e-3, le=1000, description="contrast limit of the histogram equalisation"
    )
    clahe_tile_mm: float = Field(default=0.6, ge=0.01, le=100, description="depth of one of its tiles")
    threshold_window_mm: float = Field(default=0.15, ge=1e-3, le=2, description="depth of the local threshold's window")

    # the wall
    fixed_lines: bool = Field(
        default=True, description="take out lines that the detector draws at one depth all around"
    )
    least_signal: float = Field(
        default=0.12,
        ge=1e-3,
        le=1000,
        description="power above the noise's, in multiples of it, from which a sample counts as wall",
    )
    wall_decay_mm: float = Field(
        default=0.25,
        ge=1e-3,
        le=100,
        description="depth over which samples behind an edge count ever less as evidence for it",
    )
    least_wall_sigmas: float = Field(
        default=7.0,
        ge=0,
        le=1e6,
        description="standard errors of noise over 0.1 × 0.1 mm; slices whose wall stands out by less are not valid",
    )
    slope_cost_per_mm: float = Field(
        default=100, ge=0, le=1e6, description="evidence lost by a change of depth along θ"
    )
    jump_cost: float = Field(
        default=10.0, ge=0, le=1e6, description="evidence lost at most by one jump of the wall along θ"
    )
    clearance_mm: float = Field(
        default=0.03, ge=1e-4, le=10, description="smallest distance from the outer face at which a wall is looked for"
    )
