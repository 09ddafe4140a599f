"""What a plan tells its readers: plan.json as typed rows, the unit in the name or beside the joint."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from testbench.bench.error_places import ErrorPlaces
from testbench.bench.plan_settings import PlanSettings, pull_words
from testbench.bench.plan_unshown import Unshown
from testbench.design.observability import Observability
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import Spread

Way = Literal["start", "clear", "via"]
"""How a pose is reached: the first one, straight, or not straight as that would collide."""
HIDDEN = 0.5  #: Share of the expected error that no hung weight reduces, above which that is said aloud.
TIGHT = 0.8  #: Efficiency from which on a certificate says most of what there is to say.


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
class RandomPlans:
    """Errors at the tasks of the plan and of so many random ones of as many poses; None: no bound.

    Each is what the planned model promises of itself, were it all there is to the arm.
    """

    plans: int
    planned_mm: float
    median_mm: float | None
    best_tenth_mm: float | None


@dataclass(frozen=True)
class Certificate:
    """What no plan of as many of the examined poses exceeds.

    Phi of the plan is at least the share `efficiency` of phi_bound; its standard deviations are at most
    excess_percent above the least possible. By the test-pose criterion that is an error at the tasks, which
    the plan has reached and no plan has less of; other criteria have no length. A candidate is a pose, or a
    pose and one of several loads.
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
    """A pose with what is to be expected there; the error is that of predicting its deflection.

    q_shown are its joints in the report's units, deg or mm.
    """

    q_shown: list[float]
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
    """A pose to measure; q are its joints in rad or m.

    It is loaded by a hung mass, or by a pull, and then load_kg is 0; None where nothing pulls.
    Travel is that of the hinge that turns, or slide that moves, farthest from the run before.
    """

    run: int
    q: list[float]
    load_kg: float
    travel_deg: float
    travel_mm: float
    way: Way
    pull_N: list[float] | None = None

    @property
    def load(self) -> str:
        """What hangs or pulls."""
        return f"{self.load_kg:g} kg" if self.pull_N is None else pull_words(self.pull_N)


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

    The candidates can show some of them, as many poses can see `at_most` of those; in those `outweighed` the
    readings say more than the prior. hidden_mm is the error at the tasks in directions that no hung weight
    shows, prior_share_percent the share of the mean square error that the prior leaves open.
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

    The fewest that reach the target; and from how many on so many `more` always bring less than a little.
    None where no plan of the examined sizes does.
    """

    target_mm: float
    fewest: int | None
    examined_up_to: int
    more: int
    little_percent: float
    enough: int | None


@dataclass(frozen=True, kw_only=True)
class PlanReport(PlanSettings):
    """A plan, what it promises, and what stands beside it; the fields are the keys of plan.json.

    Whether the model has every link and joint; the prior is said by its name, None without one; the arm
    stands at base_m, whether beside anything that it could hit; margins are the least distances of the
    plan's joints from their limits, in their units. Expected errors are root mean
    squares over arms of which every link and joint gives, within so many per cent of the folder, identified
    by the planned model; their intervals hold 90 % of the arms, the half width 95 % of the errors of a
    deflection at the tasks along one axis. Joints alone are identified by least squares. The map has errors
    over the workspace under the first load, by least squares of links, joints alone and the planned model.
    """

    arm: str
    whole_arm: bool
    base_m: list[float]
    joints: list[str]
    units: list[str]
    margins: list[float]
    surrounded: bool
    prior: str | None
    within_percent: float
    error_mm: Expected
    half_width_95_mm: float
    joints_alone_mm: float
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
    map: ErrorPlaces
    unshown: Unshown | None = None

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
    def gain(self) -> Gain:
        """The promise at the tasks beside what joints alone would leave."""
        return gained(self.model, "joints alone", [self.error_mm.expected], [self.joints_alone_mm])

    @property
    def gain_random(self) -> Gain | None:
        """The plan beside random poses, were the arm the model; None where these have no bound."""
        random = self.random_plans
        if random.planned_mm is None or random.median_mm is None:
            return None
        return gained("planned", "random", [random.planned_mm], [random.median_mm])

    @property
    def refusals(self) -> list[tuple[str, int]]:
        """Why poses were refused and how many, the most frequent reason first."""
        counts = [(reason, count) for reason, count in self.candidates.rejected.items() if count]
        return sorted(counts, key=lambda entry: -entry[1])
