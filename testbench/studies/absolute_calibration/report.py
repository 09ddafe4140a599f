"""What the study of absolute calibration reports: types of report.json."""

from dataclasses import dataclass

from testbench.trials.gain import Gain
from testbench.trials.spread import Spread


@dataclass(frozen=True)
class DatasetRow:
    """What the dataset holds that is written beside the report."""

    runs: int
    points: int
    sigma_um: float


@dataclass(frozen=True)
class Shares:
    """How many numbers lie in their 95 % intervals, over all trials [1]; None where the model has none."""

    positions: float
    geometry: float | None
    joint_errors: float | None
    joints: float | None
    entries: float | None


@dataclass(frozen=True)
class ModelRow:
    """One model by one number of poses, own weight alone, true arms as real ones are."""

    name: str  #: Of the model.
    arm: str
    poses: int
    trials: int
    error_mm: Spread
    loaded_mm: Spread
    optimum_mm: Spread
    over_optimum: float  #: RMS over all trials of the error over that of the optimum [1].
    inside: Shares


@dataclass(frozen=True)
class HidingRow:
    """What a model makes of true arms that have an error which it lacks, or lack one which it has."""

    arm: str
    true_arm: str  #: One of TRUE_ARMS.
    model: str
    error_mm: Spread
    bias_2: float  #: Median of joint 2's compliance over the true one, less one [1].
    off_2: float  #: Root mean square of that [1].
    bias_3: float
    off_3: float
    geometry_off: Spread  #: RMS error of geometry where the fit of everything knows it [mm, mrad].
    inside: Shares
    gears_kept: float | None  #: Share in which cross-validation kept joint errors, where it chose [1].
    links_kept: float | None


@dataclass(frozen=True)
class CampaignRow:
    """What a campaign of as many readings leaves."""

    arm: str
    campaign: str  #: One of CAMPAIGNS.
    poses: int
    readings: int
    model: str
    error_mm: Spread  #: Under own weight.
    loaded_mm: Spread  #: Under the payload.
    off_2: float  #: Root mean square error of joint 2's compliance over the true one [1].
    off_3: float


@dataclass(frozen=True)
class Gains:
    """What cross-validation chooses on one arm from the featured poses, trial by trial."""

    arm: str
    springs: Gain  #: Beside joint springs alone.
    geometry: Gain  #: Beside geometry alone.


@dataclass(frozen=True)
class AbsoluteCalibrationReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    trials: int
    arms: tuple[str, ...]
    featured: int  #: Poses of everything but `models`.
    true_arms: dict[str, str]  #: What they are like, by name.
    gains: list[Gains]  #: By arm.
    models: list[ModelRow]  #: By arm, number of poses and model.
    hiding: list[HidingRow]
    campaigns: list[CampaignRow]
    dataset: DatasetRow

    def model(self, arm: str, poses: int, name: str) -> ModelRow:
        """One of the models."""
        return next(row for row in self.models if (row.arm, row.poses, row.name) == (arm, poses, name))

    def hidden(self, arm: str, true_arm: str, model: str) -> HidingRow:
        """One of what hides."""
        rows = self.hiding
        return next(row for row in rows if (row.arm, row.true_arm, row.model) == (arm, true_arm, model))

    def campaign(self, arm: str, campaign: str, model: str) -> CampaignRow:
        """One of the campaigns."""
        rows = self.campaigns
        return next(row for row in rows if (row.arm, row.campaign, row.model) == (arm, campaign, model))
