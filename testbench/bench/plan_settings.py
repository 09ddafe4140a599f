"""What an engineer asks of a plan, in SI units."""

from dataclasses import dataclass

from testbench.bench.campaign import MODELS, Cell, named_models
from testbench.data.csvfile import SIGMA_RANGE
from testbench.data.station import Station
from testbench.design.planning import CRITERIA
from testbench.design.specification import Tasks
from testbench.errors import BenchError
from testbench.identify.prior import RANGE
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure

LOAD_RANGE = (1e-3, 1e4)
"""Masses that can hang from an arm [kg], as in bench.Scenario."""
MOST_POSES, MOST_CANDIDATES = 200, 50_000


@dataclass(frozen=True)
class Settings:
    """What an engineer asks for.

    Attributes:
        structure: Unknowns of the model that is to be identified, in whole blocks.
        tasks: Where the robot works, and under which load.
        loads: Masses that may be hung [kg].
        poses: How many are to be measured.
        criterion: Key of planning.CRITERIA.
        sigma: Standard deviation of one reading along one axis [m].
        uncertainty: Relative uncertainty of the CAD prior [1]; None for an identification without a prior.
        station: Where the tracker stands; None leaves visibility unchecked.
        area: Where the tool may be while it is measured; None for anywhere.
        sling: From the load point to the weight [m].
        candidates: Feasible poses to choose from.
        seed: Root of all randomness.
    """

    structure: Structure
    tasks: Tasks
    loads: tuple[float, ...]
    poses: int = 12
    criterion: str = "test"
    sigma: float = 50e-6
    uncertainty: float | None = 0.3
    station: Station | None = None
    area: WorkArea | None = None
    sling: float = 0.5
    candidates: int = 5000
    seed: int = 1

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise BenchError(f"no criterion {self.criterion!r}; criteria are {', '.join(CRITERIA)}")
        if not self.loads or len(set(self.loads)) < len(self.loads):
            raise BenchError(f"loads [kg]: expected at least one, each once, got {list(self.loads)}")
        for load in self.loads:
            _check_range("load [kg]", load, *LOAD_RANGE)
        _check_range("poses", self.poses, 1, MOST_POSES)
        _check_range("candidates", self.candidates, self.poses, MOST_CANDIDATES)
        _check_range("sigma [m]", self.sigma, *SIGMA_RANGE)
        if self.uncertainty is not None:  # doubled for doubters
            _check_range("uncertainty of the prior [1]", self.uncertainty, RANGE[0], RANGE[1] / 2)


def _check_range(what: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # false for NaN
        raise BenchError(f"{what}: expected {low:g} to {high:g}, got {value:g}")


def structure(cell: Cell, name: str) -> Structure:
    """Unknowns of a model of `bench.MODELS`.

    Raises:
        BenchError: When there is no such model, the arm has too few links for it, or it lacks entries that a
            prior speaks of.
    """
    if name == "MLS32":
        whole = ", ".join(other for other in MODELS if other != name)
        raise BenchError(
            f"no plan for {name}: it leaves out entries by what one dataset shows; expected one of {whole}"
        )
    [model] = named_models(cell, [name])
    return model.structure
