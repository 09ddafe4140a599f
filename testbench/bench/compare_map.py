"""Where a model errs in each of several runs: the error maps of their reports, and the worst places."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from testbench.errors import Array
from testbench.output.finished import Finished

MOST = 10_000  #: Places that are drawn.
FAR, HUGE = 1e3, 1e6  #: Tool positions [m] and errors [mm] beyond are no arm's.


class Places(BaseModel):
    """The map of a report, as much of it as is needed."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    position_m: list[tuple[float, float, float]]
    joints: list[str]
    error_mm: dict[str, list[float]]


@dataclass(frozen=True)
class WorstPlace:
    """Where a model errs most in a run."""

    letter: str  #: Of the run.
    error_mm: float
    position_m: tuple[float, ...]  #: x, y and z of the tool.
    joints: str  #: For people.

    @property
    def where(self) -> str:
        """The tool's place in words."""
        return ", ".join(f"{axis} {x:.2f}" for axis, x in zip("xyz", self.position_m, strict=True)) + " m"


@dataclass(frozen=True)
class RunMap:
    """Errors of a model over the workspace in a run."""

    position_m: Array  #: Of the tool, (n, 3).
    error_mm: Array  #: (n,).
    worst: WorstPlace

    @property
    def rms_mm(self) -> float:
        """Root mean square of the errors."""
        return float(np.sqrt(np.mean(self.error_mm**2)))

    @property
    def median_mm(self) -> float:
        """Median of the errors."""
        return float(np.median(self.error_mm))


def maps_of(runs: Sequence[Finished], letters: Sequence[str], model: str) -> list[RunMap]:
    """Maps of those runs that have one of the model; none where fewer than two have.

    Args:
        runs: All of them.
        letters: What they are called.
        model: Its name.
    """
    found = [_map(run, letter, model) for run, letter in zip(runs, letters, strict=True)]
    known = [own for own in found if own is not None]
    return known if len(known) > 1 else []


def _map(run: Finished, letter: str, model: str) -> RunMap | None:
    try:
        own = Places.model_validate(run.report.get("map"))
    except ValidationError:  # none, or of another kind
        return None
    position, error = np.array(own.position_m), np.array(own.error_mm.get(model, []))
    if not 0 < len(error) <= MOST or not len(error) == len(position) == len(own.joints):
        return None
    if np.abs(position).max() > FAR or error.min() < 0 or error.max() > HUGE:
        return None
    k = int(error.argmax())
    return RunMap(position, error, WorstPlace(letter, float(error[k]), own.position_m[k], own.joints[k]))
