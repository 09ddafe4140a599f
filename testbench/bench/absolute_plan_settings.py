"""What an engineer asks of a plan of absolute readings: plain data, the units in the names."""

import math
from dataclasses import dataclass

from testbench.bench.candidates import Conditions
from testbench.bench.models import EVERY
from testbench.bench.plan_settings import (
    HIGHEST,
    LOAD_RANGE,
    MOST_CANDIDATES,
    MOST_POSES,
    Place,
    Site,
    check_range,
)
from testbench.bench.rows import UM
from testbench.data.export import SIGMA_RANGE
from testbench.design.absolute import CRITERIA
from testbench.errors import BenchError
from testbench.identify.prior import RANGE
from testbench.plant import Payload

HIGHEST_ORDER = 30  #: Of the periodic errors that joints have, as true arms of the bench.
MOST_ORDERS = 12  #: Of those that are unknowns of a plan.


@dataclass(frozen=True, kw_only=True)
class AbsolutePlanSettings(Site):
    """What is asked for."""

    model: str = EVERY  #: Name of the model of the compliances.
    criterion: str = "I"  #: One of design.absolute.CRITERIA.
    poses: int = 50  #: How many are to be measured.
    loads_kg: tuple[float, ...] = ()  #: What hangs in every pose after its unloaded reading, one by one.
    orientations: bool = False  #: Whether one target is read, and how it is turned.
    sigma_um: float = 50.0  #: Standard deviation of a reading along an axis, and in urad about one.
    uncertainty_percent: float = 30.0  #: Of the CAD prior of the compliances.
    geometry_mm: float = 1.0  #: Expected error of geometry along an axis, and in mrad about one.
    gear_urad: float = 30.0  #: Expected coefficient of a joint's periodic error, up to order 30.
    orders: int = 3  #: Orders of those that are identified; the others are noise of a pose.
    tracker_m: Place | None = None  #: Where it stands; None leaves visibility unchecked.
    acceptance_deg: float | None = None  #: Half angle of fixed targets; None where turned by hand.
    box_m: tuple[Place, Place] | None = None  #: Corners of where the tool may be; None for anywhere.
    sling_m: float = 0.5  #: From the load point to the weight.
    candidates_wanted: int = 1000  #: Feasible poses to choose from.
    floor_z_m: float | None = None  #: Height of a floor that the arm's folder does not have.
    seed: int = 1  #: Root of all randomness.

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise BenchError(
                f"no criterion {self.criterion!r} of absolute readings; criteria are {', '.join(CRITERIA)}"
            )
        if len(set(self.loads_kg)) < len(self.loads_kg):
            raise BenchError(f"--load: expected each once, got {list(self.loads_kg)}")
        for load in self.loads_kg:
            check_range("--load [kg]", load, *LOAD_RANGE)
        check_range("--poses", self.poses, 1, MOST_POSES)
        check_range("--candidates", self.candidates_wanted, self.poses, MOST_CANDIDATES)
        check_range("--sigma-um", self.sigma_um, *(UM * end for end in SIGMA_RANGE))
        check_range("--uncertainty-percent", self.uncertainty_percent, 100 * RANGE[0], 100 * RANGE[1])
        check_range("--geometry-mm", self.geometry_mm, 1e-6, 100)
        check_range("--gear-urad", self.gear_urad, 1e-6, 1e5)
        check_range("--orders", self.orders, 0, MOST_ORDERS)
        if self.floor_z_m is not None:
            check_range("--floor-z [m]", self.floor_z_m, -HIGHEST, HIGHEST)
        self.check_site()

    @property
    def rest_urad(self) -> float:
        """Standard deviation of what a joint does beyond the orders that are identified."""
        return self.gear_urad * math.sqrt(HIGHEST_ORDER - self.orders)

    @property
    def conditions(self) -> Conditions:
        """What a pose must satisfy; under the largest load, if any."""
        payload = Payload(max(self.loads_kg), self.sling_m) if self.loads_kg else None
        return Conditions(self.area, self.station, payload)
