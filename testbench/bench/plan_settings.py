"""What an engineer asks of a plan: plain data, the units in the names, as flags and plan.json have them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import Cell
from testbench.bench.candidates import Conditions
from testbench.bench.models import EVERY, named_models, own_names
from testbench.bench.rows import UM
from testbench.data.export import SIGMA_RANGE
from testbench.data.station import Station
from testbench.design.planning import check_criterion
from testbench.errors import BenchError
from testbench.identify.prior import RANGE
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure
from testbench.plant import Payload

Place = tuple[float, float, float]
LOAD_RANGE = (1e-3, 1e4)  #: Masses that can hang from an arm [kg], as in bench.Scenario.
PULL_RANGE = (GRAVITY * LOAD_RANGE[0], GRAVITY * LOAD_RANGE[1])  #: Sizes of forces that can pull [N].
HIGHEST = 1000.0  #: Height of a floor, up or down [m]; beyond it a unit is a slip.
MOST_POSES = 200
MOST_CANDIDATES = 50_000  #: Also times loads and pulls: memory grows with them.


class Site:
    """Where poses may be and what reads them: what settings of plans share."""

    tracker_m: Place | None  #: Where the tracker stands [m].
    acceptance_deg: float | None  #: Half angle in which a target returns the beam [deg].
    box_m: tuple[Place, Place] | None  #: Corners of the box that holds the tool [m].

    def check_site(self) -> None:
        """Refuse an acceptance without a tracker, and a box that is turned over, by BenchError."""
        if self.acceptance_deg is not None and self.tracker_m is None:
            raise BenchError("--acceptance-deg: expected --tracker with it")
        if self.box_m is not None and not all(a < b for a, b in zip(*self.box_m, strict=True)):
            raise BenchError(f"--box [m]: expected the lower corner first, got {self.box_m}")

    @property
    def station(self) -> Station | None:
        """The tracker."""
        if self.tracker_m is None:
            return None
        half = None if self.acceptance_deg is None else math.radians(self.acceptance_deg)
        return Station(self.tracker_m, acceptance=half)

    @property
    def area(self) -> WorkArea | None:
        """Where the tool may be."""
        return None if self.box_m is None else WorkArea(*self.box_m)


@dataclass(frozen=True, kw_only=True)
class PlanSettings(Site):
    """What is asked for."""

    #: Name of the model whose structure is to be identified; "ALL" for all links and joints.
    model: str = EVERY
    criterion: str = "test"  #: Key of planning.CRITERIA.
    poses: int = 12  #: How many are to be measured.
    loads_kg: tuple[float, ...]  #: Masses that may be hung.
    #: Forces that may pull at the load point instead, world axes; a plan chooses a load for every pose.
    pulls_n: tuple[Place, ...] = ()
    sigma_um: float = 50.0  #: Standard deviation of one reading along one axis.
    uncertainty_percent: float | None = 30.0  #: Of the CAD prior; None for an identification without a prior.
    tracker_m: Place | None = None  #: Where it stands; None leaves visibility unchecked.
    #: Half angle in which fixed targets return the beam; None for targets turned by hand.
    acceptance_deg: float | None = None
    #: Lower and upper corner of where the tool may be; None for anywhere.
    box_m: tuple[Place, Place] | None = None
    sling_m: float = 0.5  #: From the load point to the weight.
    candidates_wanted: int = 5000  #: Feasible poses to choose from.
    floor_z_m: float | None = None  #: Height of a floor that the arm's folder does not have.
    seed: int = 1  #: Root of all randomness.

    def __post_init__(self) -> None:
        check_criterion(self.criterion)
        if not self.loads_kg or len(set(self.loads_kg)) < len(self.loads_kg):
            raise BenchError(f"--load: expected at least one, each once, got {list(self.loads_kg)}")
        for load in self.loads_kg:
            check_range("--load [kg]", load, *LOAD_RANGE)
        if len(set(self.pulls_n)) < len(self.pulls_n):
            raise BenchError(f"--pull: expected each once, got {list(self.pulls_n)}")
        for pull in self.pulls_n:
            check_range("--pull [N], its size", math.hypot(*pull), *PULL_RANGE)
        check_range("--poses", self.poses, 1, MOST_POSES)
        check_range("--candidates", self.candidates_wanted, self.poses, MOST_CANDIDATES)
        loads = len(self.loads_kg) + len(self.pulls_n)
        check_range(
            "--load and --pull, times --candidates", loads * self.candidates_wanted, 1, MOST_CANDIDATES
        )
        check_range("--sigma-um", self.sigma_um, *(UM * end for end in SIGMA_RANGE))
        if self.uncertainty_percent is not None:  # doubled for doubters
            check_range("--uncertainty-percent", self.uncertainty_percent, 100 * RANGE[0], 50 * RANGE[1])
        if self.floor_z_m is not None:
            check_range("--floor-z [m]", self.floor_z_m, -HIGHEST, HIGHEST)
        self.check_site()

    @property
    def pulls(self) -> list[str]:
        """Its pulls by their names."""
        return [pull_words(pull) for pull in self.pulls_n]

    @property
    def conditions(self) -> Conditions:
        """What a pose must satisfy; under the largest load, as the others hang inside its outline."""
        return Conditions(self.area, self.station, Payload(max(self.loads_kg), self.sling_m))


def pull_words(pull: Sequence[float]) -> str:
    """A pull, world axes [N], as plans name it."""
    return f"pull {', '.join(f'{x:g}' for x in pull)} N"


def check_range(what: str, value: float, low: float, high: float) -> None:
    """Refuse by BenchError what is out of range."""
    if not low <= value <= high:  # false for NaN
        raise BenchError(f"{what}: expected {low:g} to {high:g}, got {value:g}")


def structure(cell: Cell, name: str) -> Structure:
    """Unknowns of a model of an arm; BenchError where it has no such model or no prior fits it."""
    [model] = named_models(cell, [name])
    if not model.structure.whole:
        others = ", ".join(other for other in own_names(cell.arm) if other != name)
        raise BenchError(
            f"no plan for {name}: it leaves out entries by what one dataset shows; expected one of {others}"
        )
    return model.structure
