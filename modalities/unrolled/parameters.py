"""How unrolled images are processed."""

from pydantic import BaseModel, ConfigDict, Field


class UnrolledParameters(BaseModel):
    """How an unrolled image is processed: only depth that is not centred needs any of it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    tolerance_sigmas: float = Field(
        default=4.0, gt=0, le=100, description="beams within so many times the noise from beam to beam are the wall's"
    )
    least_inlier_fraction: float = Field(
        default=0.3, gt=0, le=1, description="a turn is bridged unless this part of its beams is the wall's"
    )
    ransac_trials: int = Field(default=500, ge=1, le=100_000, description="trials of the sine of a turn")
    seed: int = Field(default=0, ge=0, le=2**32, description="seed of these trials")
