"""What a measurement plan is for: how poses are measured, under which loads, where predictions are wanted."""

from dataclasses import dataclass

import numpy as np

from testbench.design.forecast import Forecast, forecast
from testbench.design.rows import (
    Experiment,
    Ids,
    Problem,
    build_problem,
    deflection_rows,
    information,
    reading_rows,
)
from testbench.errors import Array
from testbench.model.load import Load


@dataclass(frozen=True)
class Tasks:
    """Where the robot works, and under which load."""

    q: Array  #: Actuated joints, (tasks, n) [rad, m].
    load: Load  #: In each of them; a wrench of the process or a hung weight.


@dataclass(frozen=True)
class Specification:
    """What a plan is for."""

    experiment: Experiment  #: How poses are measured.
    loads: tuple[Load, ...]  #: What may be hung; a plan chooses for every pose.
    tasks: Tasks  #: Where predictions are wanted.
    workspace: (
        Array  #: Poses over which the criteria I and G judge, under the first load, (poses, n) [rad, m].
    )
    #: Relative uncertainty of the prior [1]; None to plan for an identification without one.
    uncertainty: float | None
    poses: int  #: How many may be measured.


def task_rows(spec: Specification) -> Array:
    """Deflections in the tasks per unit of x, (tasks, 3 m, n) [m]."""
    return deflection_rows(spec.experiment, spec.tasks.q, spec.tasks.load)


def workspace_rows(spec: Specification) -> Array:
    """The same over the workspace under the first load, (poses, 3 m, n) [m]."""
    return deflection_rows(spec.experiment, spec.workspace, spec.loads[0])


def loads_of(spec: Specification, load: Ids) -> Load:
    """The load of every pose, from its index into the specification's loads, (poses,)."""
    wrench, point = (np.stack([getattr(each, part) for each in spec.loads]) for part in ("wrench", "point"))
    return Load(wrench[load], point[load])


def measured_rows(spec: Specification, q: Array, load: Ids) -> Array:
    """Whitened rows of poses (poses, n) [rad, m], each under its own load (poses,), (poses, k, n) [1]."""
    return reading_rows(spec.experiment, q, loads_of(spec, load))


def problem_of(spec: Specification, q: Array, load: Ids) -> Problem:
    """Poses (poses, n) [rad, m] as candidates, each under its own load (poses,)."""
    return build_problem(spec.experiment, measured_rows(spec, q, load), spec.uncertainty)


def promise_of(spec: Specification, q: Array, load: Ids, rows: Array) -> Forecast:
    """Errors to expect after any poses were measured and identified, such as those of a plan made by hand.

    Poses are (poses, n) [rad, m], each under its own load (poses,); rows are predictions, as `task_rows`.
    """
    problem = problem_of(spec, q, load)
    return forecast(problem, information(problem, np.arange(len(q))), rows)
