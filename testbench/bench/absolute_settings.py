"""What a campaign of absolute readings measures, as data: a manifest must hold it to run it again."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from testbench.bench.plan_input import Place
from testbench.errors import BenchError
from testbench.plant import TYPICAL, Disturbances, GearErrors, GeometryErrors

MOST_POSES = 20_000
Mass = Annotated[float, Field(ge=0, le=10_000)]

REAL_ARM = Disturbances(
    own_weight=True, geometry=TYPICAL.geometry, sensor_offset=TYPICAL.sensor_offset, gear=GearErrors()
)
"""What absolute readings show of an arm: own weight, typical errors of geometry and joint offsets, gears."""


class AbsoluteCampaign(BaseModel):
    """Series of absolute readings of one true arm; each has its own poses."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)

    series: int = Field(default=1, ge=1, le=50)  #: Set-ups.
    poses: int = Field(default=200, ge=1, le=MOST_POSES)  #: Of each series.
    #: What hangs in a pose, one after the other, a row each [kg]; 0 for own weight alone.
    masses: tuple[Mass, ...] = Field(default=(0.0,), min_length=1)
    #: How many poses of a series see all the masses, the first of them only the others; None for all.
    loaded_poses: int | None = Field(default=None, ge=0)
    targets: int = Field(default=1, ge=1)  #: So many of the arm's markers are read.
    orientations: bool = False  #: Whether the orientation of the mount is read too.
    sigma: float = Field(default=50e-6, ge=1e-9, le=0.01)  #: Of one position along one axis [m].
    sigma_rotation: float = Field(default=50e-6, ge=1e-9, le=0.1)  #: Of one orientation about an axis [rad].
    noise: bool = True  #: Whether readings are noisy.
    #: Where the trackers stand, a series each and then from the first again [m]; None for anywhere around.
    trackers: tuple[Place, ...] | None = Field(default=None, min_length=1)
    #: How far the mount of the targets is from where the arm's folder has it, standard deviations.
    mount: GeometryErrors = GeometryErrors(position=2e-3, angle=5e-3)
    #: Whether each mount is turned about the last axis by a random multiple of 90 degrees.
    quarter_turns: bool = False
    share_frame: bool = False  #: Whether all series have one tracker that stays where it is.
    share_target: bool = False  #: Whether all series have one mount that stays on the tool.
    #: Scatter of every joint's angle from one approach of a pose to the next, standard deviation [rad, m].
    repeatability: float = Field(default=0.0, ge=0, le=0.01)
    outliers: float = Field(default=0.0, ge=0, le=0.5)  #: Share of positions that are outliers [1].
    outlier_size: float = Field(default=2e-3, ge=0, le=1)  #: How far they are off, in any direction [m].
    disturbances: Disturbances = REAL_ARM  #: What the true arm does.

    @model_validator(mode="after")
    def _loads_differ(self) -> "AbsoluteCampaign":
        if len(set(self.masses)) < len(self.masses):
            raise BenchError(f"masses: expected different ones, got {self.masses}")
        return self
