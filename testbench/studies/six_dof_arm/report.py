"""report.json of section 5.2."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.bench.error_places import ErrorPlaces
from testbench.studies.paper import Claim
from testbench.studies.six_dof_arm.trial import Judged, Measured, Order
from testbench.trials.gain import Gain
from testbench.trials.spread import Number


@dataclass(frozen=True)
class ModelReport(Judged):
    """A model over all seeds, and the paper's known numbers for it."""

    #: 95 % error in the check runs, without noise, of the best least squares over its own, seed by seed.
    times_less: Number = None
    paper: Mapping[str, float] | None = None


@dataclass(frozen=True)
class TruthReport:
    """What was measured of one kind of truth, and what was found."""

    dataset: Measured
    models: list[ModelReport]


@dataclass(frozen=True)
class OrderReport:
    """Every order m of two models, and the seeds that they were studied in."""

    seeds: list[int]
    MGCO69: list[Order]
    MGCO56: list[Order]


@dataclass(frozen=True)
class Paired:
    """On the same data, by the 95 % error of the check runs without noise: in how many seeds."""

    seeds: int
    mgco56_best: int  #: MGCO56 is the best of the paper's models.
    mgco56_better_than_mls32: int
    mgco56_near_mls32: int  #: The two differ by at most `CLOSE`.
    mls32_better_than_mls56: int
    mgco56_better_than_joints: int
    linear_is_enough: int  #: MGCO56 is at most `CLOSE` worse with the non-linear truth.
    mgco56_over_mls32_p95_check_true: Number
    joints_over_mgco56_p95_check_true: Number


@dataclass(frozen=True)
class TieBreak:
    """MGCO56 beside least squares of the same unknowns, MLS56: in how many seeds."""

    truth: Truth
    seeds: int
    free: int  #: Directions that the data leave free, filled by minimum norm in MLS56.
    conservative: int  #: Another solution of MLS56's very fit is conservative.
    fits_as_well: int  #: F_M of MGCO56 exceeds that of MLS56 by at most `EQUAL` of it.


@dataclass(frozen=True)
class Enough:
    """The least order m that serves as well as the largest one."""

    model: str  #: Name of the model.
    m: int  #: The order.
    rows: list[Order]  #: The order before it, itself and the largest one.


@dataclass(frozen=True)
class Gains:
    """The best of GCO beside others, by the 95 % error of the check runs without noise."""

    least_squares: Gain  #: The best of least squares.
    joints: Gain  #: Joints alone.
    nonlinear: Gain  #: The best of least squares, with MuJoCo's non-linear truth.
    nonlinear_joints: Gain  #: Joints alone, with that truth.


@dataclass(frozen=True)
class SixDofReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    noise_per: str
    truth: Truth
    dataset: Measured
    models: list[ModelReport]
    nonlinear: TruthReport
    order: OrderReport
    paired: Paired
    ties: list[TieBreak]
    enough: list[Enough]
    which_m: str
    best: tuple[str, ...]
    gains: Gains
    claims: list[Claim]
    rule: str  #: How verdicts are made.
    map: ErrorPlaces  #: Errors in the check runs, without noise, in the first seed.
