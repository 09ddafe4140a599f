"""A measurement plan: from candidates to the poses that pay, with certificate, promise and order."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.design.criteria import (
    Criterion,
    Linear,
    criterion_a,
    criterion_d,
    criterion_e,
    criterion_g,
    mean_square,
)
from testbench.design.exchange import select
from testbench.design.forecast import Forecast, forecast
from testbench.design.order import joint_travel, shortest_path
from testbench.design.refine import ascend, refine
from testbench.design.relaxation import Relaxed, relax, sensitivity
from testbench.design.rows import (
    Experiment,
    Ids,
    Load,
    Problem,
    build_problem,
    deflection_rows,
    information,
    more,
    reading_rows,
)
from testbench.errors import Array, BenchError

ASCENTS, CLIMBERS = 2, 60
"""Rounds in which the poses that carry the bound are improved, and how many of them."""
DETOUR = 10.0
"""What a leg that would collide adds to its travel [rad]: it is taken only where nothing else is left."""

Feasible = Callable[[Array], npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class Tasks:
    """Where the robot works, and under which load.

    Attributes:
        q: Actuated joint angles, (tasks, n) [rad].
        load: In each of them; a wrench of the process or a hung weight.
    """

    q: Array
    load: Load


@dataclass(frozen=True)
class Brief:
    """What a plan is for.

    Attributes:
        experiment: How poses are measured.
        loads: What may be hung; a plan chooses for every pose.
        tasks: Where predictions are wanted.
        workspace: Poses over which the criteria I and G judge, under the first load, (poses, n) [rad].
        uncertainty: Relative uncertainty of the prior [1]; None to plan for an identification without one.
        poses: How many may be measured.
    """

    experiment: Experiment
    loads: tuple[Load, ...]
    tasks: Tasks
    workspace: Array
    uncertainty: float | None
    poses: int


@dataclass(frozen=True)
class Stock:
    """Candidates: a pose and a load each.

    Attributes:
        q: Joint angles, (candidates, n) [rad].
        load: Index into the brief's loads, (candidates,).
        problem: What they tell.
    """

    q: Array
    load: Ids
    problem: Problem


@dataclass(frozen=True)
class Plan:
    """Poses to measure, in the order of measuring.

    Attributes:
        criterion: What was asked for.
        q: Joint angles, (poses, n) [rad].
        load: Index into the brief's loads, (poses,).
        stock: All poses examined, those of the plan among them.
        chosen: Where in the stock they are, (poses,).
        value: Phi of the plan.
        relaxed: The relaxed optimum over the stock: its bound is that of all plans of as many poses.
    """

    criterion: Criterion
    q: Array
    load: Ids
    stock: Stock
    chosen: Ids
    value: float
    relaxed: Relaxed

    @property
    def efficiency(self) -> float:
        """At least this share of the best Phi that as many of the examined poses reach [1]."""
        return self.value / self.relaxed.bound

    @property
    def information(self) -> Array:
        """Information matrix M, prior included, (r, r)."""
        return information(self.stock.problem, self.chosen)


CRITERIA: dict[str, Callable[[Brief, Problem], Criterion]] = {
    "D": lambda _brief, _problem: criterion_d(),
    "A": lambda _brief, problem: criterion_a(problem.r),
    "E": lambda _brief, _problem: criterion_e(),
    "G": lambda brief, problem: criterion_g(workspace_rows(brief) @ problem.lift),
    "I": lambda brief, problem: Linear("I", mean_square(workspace_rows(brief) @ problem.lift)),
    "test": lambda brief, problem: Linear("test", mean_square(task_rows(brief) @ problem.lift)),
}
"""Criteria by name."""


def task_rows(brief: Brief) -> Array:
    """Deflections in the tasks per unit of x, (tasks, 3 m, n) [m]."""
    return deflection_rows(brief.experiment, brief.tasks.q, brief.tasks.load)


def workspace_rows(brief: Brief) -> Array:
    """The same over the workspace under the first load, (poses, 3 m, n) [m]."""
    return deflection_rows(brief.experiment, brief.workspace, brief.loads[0])


def stock_up(brief: Brief, q: Array) -> Stock:
    """Every pose under every load.

    Args:
        brief: What the plan is for.
        q: Feasible poses, (poses, n) [rad].

    Raises:
        BenchError: When no load moves a target, or without a prior there are fewer poses than directions to
            see: says what is lost.
    """
    load = np.repeat(np.arange(len(brief.loads)), len(q))
    every = np.tile(q, (len(brief.loads), 1))
    stock = Stock(every, load, build_problem(brief.experiment, _rows(brief, every, load), brief.uncertainty))
    if brief.uncertainty is None:
        _check_enough(brief, stock.problem)
    return stock


def seen_by(brief: Brief, problem: Problem) -> tuple[int, int]:
    """Directions that the plan's poses can see at most, and that the candidates can show."""
    return min(problem.r, brief.poses * int(np.linalg.matrix_rank(problem.rows[0]))), problem.r


def _check_enough(brief: Brief, problem: Problem) -> None:
    seen, r = seen_by(brief, problem)
    if seen < r:
        each = int(np.linalg.matrix_rank(problem.rows[0]))
        raise BenchError(
            f"poses: {brief.poses} poses see at most {seen} of the {r} directions of "
            f"{brief.experiment.metric.structure.name} that these loads can show, {r - seen} would be lost; "
            f"expected at least {-(-r // each)} poses, or a prior that fills the rest"
        )


def _rows(brief: Brief, q: Array, load: Ids) -> Array:
    """Whitened rows of poses, each under its own load, (poses, k, n)."""
    wrench = np.stack([each.wrench for each in brief.loads])[load]
    point = np.stack([each.point for each in brief.loads])[load]
    return reading_rows(brief.experiment, q, Load(wrench, point))


def make_plan(
    brief: Brief,
    name: str,
    q: Array,
    feasible: Feasible,
    rng: np.random.Generator,
    *,
    clear_way: Callable[[Array, Array], bool] | None = None,
) -> Plan:
    """The best plan found, certified against all poses examined.

    Args:
        brief: What the plan is for.
        name: Key of CRITERIA.
        q: Feasible poses, (candidates, n) [rad].
        feasible: Which poses (poses, n) [rad] are feasible; asked for poses near the candidates.
        rng: Source of starts and steps.
        clear_way: Whether the arm can go straight from one pose (n,) to another [rad]; None for always.

    Raises:
        BenchError: When there is no such criterion, or too few poses without a prior.
    """
    if name not in CRITERIA:
        raise BenchError(f"no criterion {name!r}; criteria are {', '.join(CRITERIA)}")
    stock = stock_up(brief, q)
    criterion = CRITERIA[name](brief, stock.problem)
    relaxed = relax(stock.problem, criterion, brief.poses)
    for _ in range(ASCENTS):
        stock = _climb(brief, stock, relaxed, feasible, rng)
        relaxed = relax(stock.problem, criterion, brief.poses, relaxed)
    chosen = select(stock.problem, criterion, brief.poses, relaxed, rng)
    load = stock.load[chosen]
    better = refine(
        stock.q[chosen],
        prior=stock.problem.prior,
        criterion=criterion,
        rows=lambda trial, k: _rows(brief, trial, np.full(len(trial), load[k])) @ stock.problem.lift,
        feasible=feasible,
        limits=brief.experiment.vjm.arm.limits,
        rng=rng,
    )
    order = _order(better, load, clear_way)
    better, load = better[order], load[order]
    stock = _add(brief, stock, better, load)
    chosen = np.arange(len(stock.q) - len(better), len(stock.q))
    return Plan(
        criterion=criterion,
        q=better,
        load=load,
        stock=stock,
        chosen=chosen,
        value=criterion.information(information(stock.problem, chosen)),
        relaxed=relax(stock.problem, criterion, brief.poses, relaxed),
    )


def _climb(
    brief: Brief, stock: Stock, relaxed: Relaxed, feasible: Feasible, rng: np.random.Generator
) -> Stock:
    """The poses that carry the relaxed optimum, improved, as further candidates."""
    top = relaxed.support[np.argsort(-relaxed.weights, kind="stable")[:CLIMBERS]]
    load = stock.load[top]

    def usefulness(q: Array) -> Array:
        return sensitivity(_rows(brief, q, np.resize(load, len(q))) @ stock.problem.lift, relaxed.dual)

    limits = brief.experiment.vjm.arm.limits
    return _add(
        brief, stock, ascend(stock.q[top], usefulness, feasible=feasible, limits=limits, rng=rng), load
    )


def _add(brief: Brief, stock: Stock, q: Array, load: Ids) -> Stock:
    return Stock(np.vstack([stock.q, q]), np.r_[stock.load, load], more(stock.problem, _rows(brief, q, load)))


def _order(q: Array, load: Ids, clear_way: Callable[[Array, Array], bool] | None) -> Ids:
    """Order of measuring: one load after the other, each on the shortest way through its poses."""
    found: list[int] = []
    for kind in np.unique(load):
        own = np.flatnonzero(load == kind)
        cost = joint_travel(q[own])
        if clear_way is not None:
            for i in range(len(own)):
                for k in range(i):
                    if not clear_way(q[own[i]], q[own[k]]):
                        cost[i, k] = cost[k, i] = cost[i, k] + DETOUR
        found += own[shortest_path(cost)].tolist()
    return np.array(found)


def promise(plan: Plan, rows: Array) -> Forecast:
    """Errors to expect after the plan was measured and identified.

    Args:
        plan: The plan.
        rows: Predictions per unit of x, such as `task_rows`, (poses, 3 m, n) [m].
    """
    return forecast(plan.stock.problem, plan.information, rows)


def promise_of(brief: Brief, q: Array, load: Ids, rows: Array) -> Forecast:
    """The same of any poses, such as a plan made by hand.

    Args:
        brief: Loads, prior and experiment.
        q: Poses to measure, (poses, n) [rad].
        load: Index into the brief's loads, (poses,).
        rows: Predictions per unit of x, (poses, 3 m, n) [m].
    """
    problem = build_problem(brief.experiment, _rows(brief, q, load), brief.uncertainty)
    return forecast(problem, information(problem, np.arange(len(q))), rows)
