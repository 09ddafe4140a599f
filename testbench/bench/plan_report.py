"""What a plan tells its readers: plan.json as typed rows, in millimetres, degrees and radians."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from testbench.design.observability import Observability
from testbench.trials.spread import Spread

Way = Literal["start", "clear", "via"]
"""How a pose is reached: the first one, straight, or not straight as that would collide."""
HIDDEN = 0.5
"""Share of the expected error that no hung weight reduces, above which that is said aloud."""
TIGHT = 0.8
"""Efficiency from which on a certificate says most of what there is to say."""


@dataclass(frozen=True)
class Expected:
    """Root mean square error to expect over several poses, with its 90 % interval [mm]."""

    expected: float
    p05: float
    p95: float


@dataclass(frozen=True)
class Unbounded:
    """The same where the plan's loads leave an error without a bound."""

    expected: None = None
    p05: None = None
    p95: None = None


@dataclass(frozen=True)
class Asked:
    """What was asked for.

    Attributes:
        arm: Its name.
        base_m: Where it stands, (3,).
        joints: Their names.
        model: Structure that is to be identified.
        criterion: Key of planning.CRITERIA.
        poses: How many are to be measured.
        loads_kg: Masses that may be hung.
        sigma_um: Standard deviation of one reading along one axis.
        prior: Where the prior comes from; None without one.
        uncertainty_percent: How firmly it is believed; None without one.
        tracker_m: Where it stands, (3,); None leaves visibility unchecked.
        acceptance_deg: Half angle of fixed targets; None where they are turned by hand.
        box_m: Lower and upper corner of the work area; None for anywhere.
        sling_m: From the load point to the weight.
        candidates_wanted: Feasible poses to choose from.
        seed: Root of all randomness.
    """

    arm: str
    base_m: list[float]
    joints: list[str]
    model: str
    criterion: str
    poses: int
    loads_kg: list[float]
    sigma_um: float
    prior: str | None
    uncertainty_percent: float | None
    tracker_m: list[float] | None
    acceptance_deg: float | None
    box_m: list[list[float]] | None
    sling_m: float
    candidates_wanted: int
    seed: int


@dataclass(frozen=True)
class RandomPlans:
    """Errors at the tasks of so many random plans of as many poses; None: no bound."""

    plans: int
    median_mm: float | None
    best_tenth_mm: float | None


@dataclass(frozen=True)
class Certificate:
    """What no plan of as many of the examined poses exceeds.

    Attributes:
        efficiency: At least this share of the best Phi [1].
        phi: Of the plan.
        phi_bound: No plan has more.
        excess_percent: Standard deviations are at most this far above the least possible.
        reached_mm: Error at the tasks of the plan, 1 / sqrt(Phi); None for criteria in other units.
        least_mm: No plan has less.
        examined: Candidates.
        poses_and_loads: Whether a candidate is a pose and one of several loads.
    """

    efficiency: float
    phi: float
    phi_bound: float
    excess_percent: float
    reached_mm: float | None
    least_mm: float | None
    examined: int
    poses_and_loads: bool

    @property
    def percent(self) -> int:
        """Efficiency, never rounded up."""
        return math.floor(100 * self.efficiency)

    @property
    def most_percent(self) -> float:
        """Excess, never rounded down."""
        return math.ceil(10 * self.excess_percent) / 10

    @property
    def tight(self) -> bool:
        """Whether it says most of what there is to say; else the bound itself may be loose."""
        return self.efficiency >= TIGHT


@dataclass(frozen=True)
class Row:
    """A pose with what is to be expected there; the error is that of predicting its deflection."""

    q_deg: list[float]
    expected_deflection_mm: float
    expected_error_mm: float
    expected_error_p05_mm: float
    expected_error_p95_mm: float
    tool_m: list[float]

    @property
    def error_mm(self) -> Spread:
        """Error with its 90 % interval."""
        return Spread(self.expected_error_mm, self.expected_error_p05_mm, self.expected_error_p95_mm)


@dataclass(frozen=True)
class PoseRow(Row):
    """A pose to measure; travel is that of the joint that turns farthest from the run before."""

    run: int
    q_rad: list[float]
    load_kg: float
    travel_deg: float
    way: Way


@dataclass(frozen=True)
class TaskRow(Row):
    """A pose where the robot works, and its load."""

    task: int
    force_N: list[float]
    moment_Nm: list[float]
    point_m: list[float]


@dataclass(frozen=True)
class Found:
    """How many feasible poses were found and drawn, and how many each reason refused."""

    found: int
    drawn: int
    rejected: Mapping[str, int]


@dataclass(frozen=True)
class Directions:
    """Directions of the unknowns, and what rests on the prior.

    Attributes:
        unknowns: Of the model.
        shown: Directions that the candidates can show.
        at_most: Those that as many poses can see.
        seen: Those that the plan sees.
        outweighed: Those in which the readings say more than the prior.
        hidden_mm: Error at the tasks in directions that no hung weight shows.
        prior_share_percent: Share of the mean square error at the tasks that the prior leaves open.
    """

    unknowns: int
    shown: int
    at_most: int
    seen: int
    outweighed: int
    hidden_mm: float
    prior_share_percent: float


@dataclass(frozen=True)
class CurveRow:
    """Errors at the tasks of other plans with so many poses; None: no bound."""

    poses: int
    greedy_mm: float | None
    random_median_mm: float | None
    random_p10_mm: float | None
    random_p90_mm: float | None

    @property
    def bounded(self) -> tuple[float, Spread] | None:
        """Error of the greedy plan, median and tenths of the random ones; None where one has no bound."""
        middle, low, high = self.random_median_mm, self.random_p10_mm, self.random_p90_mm
        if self.greedy_mm is None or middle is None or low is None or high is None:
            return None
        return self.greedy_mm, Spread(middle, low, high)


@dataclass(frozen=True)
class Advice:
    """How many poses to measure, judged by greedy plans.

    Attributes:
        target_mm: Error at the tasks that is wanted.
        fewest: Poses that reach it; None where none of the plans does.
        examined_up_to: Poses of the largest plan.
        more: So many more poses ...
        little_percent: ... that bring less than this are not worth their time.
        enough: From so many poses on they never are; None where they always are.
    """

    target_mm: float
    fewest: int | None
    examined_up_to: int
    more: int
    little_percent: float
    enough: int | None


@dataclass(frozen=True)
class PlanReport(Asked):
    """A plan, what it promises, and what stands beside it; the fields are the keys of plan.json."""

    error_mm: Expected
    workspace_error_mm: Expected | Unbounded
    error_if_prior_twice_as_uncertain_mm: Expected | None
    random_plans: RandomPlans
    certificate: Certificate
    plan: list[PoseRow]
    tasks: list[TaskRow]
    candidates: Found
    observability: Observability
    directions: Directions
    curve: list[CurveRow]
    greedy_mm: list[float | None]
    advice: Advice

    @property
    def blocked(self) -> list[int]:
        """Runs before which the straight way collides."""
        return [row.run for row in self.plan if row.way == "via"]

    @property
    def rests_on_prior(self) -> bool:
        """Whether much of the error at the tasks lies where no hung weight shows anything."""
        return self.directions.hidden_mm > HIDDEN * self.error_mm.expected

    @property
    def worst(self) -> list[TaskRow]:
        """The tasks, the largest error first."""
        return sorted(self.tasks, key=lambda row: -row.expected_error_mm)

    @property
    def refusals(self) -> list[tuple[str, int]]:
        """Why poses were refused and how many, the most frequent reason first."""
        counts = [(reason, count) for reason, count in self.candidates.rejected.items() if count]
        return sorted(counts, key=lambda entry: -entry[1])
