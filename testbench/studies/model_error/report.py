"""What the study of model error reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.rows import DatasetRow
from testbench.studies.noise_sensitivity.by_arm import ByArm
from testbench.studies.noise_sensitivity.fits import FitRow
from testbench.studies.noise_sensitivity.report import ModelAt
from testbench.trials.gain import Gain
from testbench.trials.spread import Number, Spread


@dataclass(frozen=True)
class CaseErrors(FitRow):
    """A model in one case over all trials, and what the case adds to the same trial without it."""

    case: str  #: What the true arm does.
    noise_um: float  #: Of a reading along an axis.
    moved_um: Number  #: How far the disturbance moves the deflections to be predicted, RMS.
    added_um: Spread  #: RMS error minus that of the same trial without disturbance.


@dataclass(frozen=True)
class Claim:
    """Errors with a compensator over those without, less one."""

    case: str  #: Which reading of the compensator.
    model: str
    against_truth: Spread
    within_true: float  #: Share of trials in which that is as small as the paper says.
    against_readings: Spread  #: With the readings' noise added in quadrature, as the paper measures.
    within_claim: float  #: The same share of these.


@dataclass(frozen=True)
class Held:
    """The models for which the paper's claim holds in at least 95 % of the trials."""

    case: str
    featured: Claim  #: Of the featured model.
    against_truth: tuple[str, ...]
    against_readings: tuple[str, ...]


@dataclass(frozen=True)
class Beats:
    """Two models in the same trials, all disturbances together, with noise."""

    ours: str
    theirs: str
    cone: bool  #: Whether they differ in nothing but the cone.
    better: int  #: Trials in which ours has the smaller error.
    alike: int  #: Trials in which they differ by a solver's digits.
    ratio: Spread


@dataclass(frozen=True)
class Together:
    """A model with noise: without disturbance, and with all of them."""

    model: str
    none_um: Number
    all_um: Number


@dataclass(frozen=True)
class Gains:
    """The featured model with noise and all disturbances together, trial by trial."""

    least_squares: Gain  #: Beside the best of least squares without a prior.
    joints: Gain  #: Beside joints alone.


@dataclass(frozen=True)
class ModelErrorReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    truth: str
    true_arm: str  #: Its name, or "family".
    true_arms: Mapping[str, int]  #: Trials of each.
    sigma_um: float
    scale: float
    trials: int
    workspace_poses: int
    sizes: Mapping[str, Mapping[str, object]]  #: What every case switches on, SI.
    cells: list[CaseErrors]
    claim: list[Claim]
    claim_percent: float
    held: list[Held]
    featured: str
    ranking: list[CaseErrors]  #: Cases alone, the featured model, no noise; the costliest first.
    noise_adds_um: float  #: To its median error without disturbance.
    above_noise: tuple[str, ...]  #: Cases that alone, without noise, add more.
    together: list[Together]
    best_together: tuple[str, ...]  #: Several where they are alike.
    joints_together_um: Number  #: Of joints alone.
    gains: Gains
    beats: list[Beats]
    together_by_arm: list[ByArm]  #: Errors with all together that differ by true arm [um].
    claim_by_arm: list[ByArm]  #: True changes of the featured model that do [1].
    models: list[ModelAt]
    dataset: DatasetRow
