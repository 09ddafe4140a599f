"""What the study of model error reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.rows import DatasetRow
from testbench.identify import Constraint
from testbench.studies.noise_sensitivity.report import ModelAt
from testbench.trials.spread import Spread


@dataclass(frozen=True)
class CaseErrors:
    """Errors of a model in one case over all trials, and what the case adds to the same trial without it.

    Attributes:
        case: What the true arm does.
        model: Its name.
        structure: Name of its structure.
        constraint: What its method asks of the blocks.
        prior: Whether it has a prior.
        noise_um: Of a reading along an axis.
        rms_um: RMS error of predicted deflection.
        p95_um: 95 % of the errors are smaller.
        added_um: RMS error minus that of the same trial without disturbance.
        moved_um: How far the disturbance moves the deflections to be predicted, RMS.
        conservative: Share of trials in which every block is symmetric and positive semi-definite.
        solved: Share of trials in which the method found its solution.
    """

    case: str
    model: str
    structure: str
    constraint: Constraint
    prior: bool
    noise_um: float
    rms_um: Spread
    p95_um: Spread
    added_um: Spread
    moved_um: Spread
    conservative: float
    solved: float


@dataclass(frozen=True)
class Claim:
    """Errors with a compensator over those without, less one.

    Attributes:
        case: Which reading of the compensator.
        model: Its name.
        against_truth: Of errors against the truth [1].
        against_readings: The same with the readings' noise added in quadrature, as the paper measures [1].
        within_claim: Share of trials in which the second is as small as the paper says.
    """

    case: str
    model: str
    against_truth: Spread
    against_readings: Spread
    within_claim: float


@dataclass(frozen=True)
class Held:
    """The models for which the paper's claim holds in at least half of the trials."""

    case: str
    models: tuple[str, ...]


@dataclass(frozen=True)
class Together:
    """A model with noise: without disturbance, and with all of them."""

    model: str
    none_um: Spread
    all_um: Spread


@dataclass(frozen=True)
class ModelErrorReport:
    """report.json.

    Attributes, beside what was asked:
        sizes: What every case switches on, SI.
        cells: A case, a model and a level of noise each.
        ranking: Cases by what they add to the median error of `featured` without noise, the largest first.
        noise_adds_um: What noise alone adds to it.
        above_noise: Cases that alone, without noise, add more than that.
        together: Every model with noise.
        best_together: The models of least median error then; several where they are alike.
    """

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    truth: str
    sigma_um: float
    scale: float
    trials: int
    workspace_poses: int
    sizes: Mapping[str, Mapping[str, object]]
    cells: list[CaseErrors]
    claim: list[Claim]
    claim_percent: float
    held: list[Held]
    featured: str
    ranking: list[CaseErrors]
    noise_adds_um: float
    above_noise: tuple[str, ...]
    together: list[Together]
    best_together: tuple[str, ...]
    models: list[ModelAt]
    dataset: DatasetRow
