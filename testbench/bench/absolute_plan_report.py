"""What a plan of absolute readings tells: plan.json as typed rows, the unit in the name."""

import math
from dataclasses import dataclass

from testbench.bench.absolute_plan_settings import AbsolutePlanSettings
from testbench.bench.error_places import ErrorPlaces
from testbench.bench.plan_report import Expected, Found, Way
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import Spread


@dataclass(frozen=True)
class AbsolutePoseRow:
    """A pose to measure, and the error to expect there once the arm is calibrated."""

    run: int
    q: list[float]
    q_shown: list[float]
    tool_m: list[float]
    expected_sag_mm: float
    expected_error_mm: float
    expected_error_p05_mm: float
    expected_error_p95_mm: float
    travel_deg: float
    travel_mm: float
    way: Way

    @property
    def error_mm(self) -> Spread:
        """Error with its 90 % interval."""
        return Spread(self.expected_error_mm, self.expected_error_p05_mm, self.expected_error_p95_mm)


@dataclass(frozen=True)
class Counts:
    """How many unknowns there are of each kind, and how many directions so many poses can see."""

    frame: int
    mount: int
    geometry: int
    errors: int
    elastic: int
    seen: int

    @property
    def total(self) -> int:
        """All unknowns."""
        return self.frame + self.mount + self.geometry + self.errors + self.elastic


@dataclass(frozen=True)
class RandomErrors:
    """Errors over the workspace of so many random plans: median, and where eight in ten lie."""

    plans: int
    median_mm: float
    p10_mm: float
    p90_mm: float


@dataclass(frozen=True)
class AbsoluteCurveRow:
    """Errors over the workspace of other plans with so many poses."""

    poses: int
    greedy_mm: float
    random_median_mm: float
    random_p10_mm: float
    random_p90_mm: float

    @property
    def random(self) -> Spread:
        """Of random plans: the median, and where eight in ten lie."""
        return Spread(self.random_median_mm, self.random_p10_mm, self.random_p90_mm)


@dataclass(frozen=True, kw_only=True)
class AbsolutePlanReport(AbsolutePlanSettings):
    """A plan and what it promises; the fields are the keys of plan.json.

    Errors are of the targets' positions in the tracker's frame over the workspace, under own weight and every
    load, after a calibration of all unknowns. beyond_mm is what joints do beyond the identified orders, which
    comes on top unless the calibration finds it too. Random plans are of the same candidates.
    """

    arm: str
    base_m: list[float]
    joints: list[str]
    units: list[str]
    margins: list[float]
    surrounded: bool
    prior: str
    targets: list[str]
    unknowns: Counts
    error_mm: Expected
    beyond_mm: float
    random_mm: RandomErrors
    efficiency: float
    examined: int
    plan: list[AbsolutePoseRow]
    hidden: list[str]
    candidates: Found
    curve: list[AbsoluteCurveRow]
    map: ErrorPlaces  #: Errors over the workspace.

    @property
    def gain(self) -> Gain:
        """The plan beside the median of random plans."""
        return gained("planned", "random", [self.error_mm.expected], [self.random_mm.median_mm])

    @property
    def together_mm(self) -> float:
        """Expected error with what joints do beyond the identified orders, none of it found."""
        return math.hypot(self.error_mm.expected, self.beyond_mm)

    @property
    def random_together_mm(self) -> float:
        """The same of the median random plan."""
        return math.hypot(self.random_mm.median_mm, self.beyond_mm)

    @property
    def percent(self) -> int:
        """Efficiency, never rounded up."""
        return int(100 * self.efficiency)

    @property
    def blocked(self) -> list[int]:
        """Runs before which the straight way collides."""
        return [row.run for row in self.plan if row.way == "via"]

    @property
    def refusals(self) -> list[tuple[str, int]]:
        """Why poses were refused and how many, the most frequent reason first."""
        counts = [(reason, count) for reason, count in self.candidates.rejected.items() if count]
        return sorted(counts, key=lambda entry: -entry[1])
