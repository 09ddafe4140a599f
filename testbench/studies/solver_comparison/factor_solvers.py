"""Solvers over b: the paper's optimiser, and local solves from random starts."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.identify.factorised import Factorised, Observe, costs, descend, descents, random_start
from testbench.identify.search import Budget, explore

DIFFERENCE = math.sqrt(np.finfo(float).eps)
"""Step of the finite differences, where the entries of b are of order one; as MATLAB and scipy take it."""


@dataclass(frozen=True)
class Found:
    """What a solver over b found."""

    b: Array  #: The vectors, (size,).
    evaluations: int  #: Of F_M.
    solves: list[float]  #: F_M that its local solves ended with.


OverB = Callable[[Factorised, np.random.Generator, Observe], Found]
"""A solver over b: problem, source of its starts, who is told of every least F_M."""


def search(budget: Budget) -> OverB:
    """The paper's optimiser, run through its whole budget: no threshold stops it."""

    def solver(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
        found = explore(problem, budget, rng, observe)
        return Found(found.best, found.evaluations, found.descents)

    return solver


def local_solves(starts: int) -> OverB:
    """Local solves on the analytic gradient, from random starts."""

    def solver(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
        found = descents(problem, rng, starts=starts, observe=observe)
        best = min(found, key=lambda descent: descent.f_m)
        return Found(best.b, sum(d.evaluations for d in found), [d.f_m for d in found])

    return solver


def differences(problem: Factorised, rng: np.random.Generator, observe: Observe) -> Found:
    """One local solve that knows F_M alone and takes its gradient by finite differences."""
    end = descend(problem, random_start(problem, rng), evaluate=forward_differences, observe=observe)
    return Found(end.b, (problem.size + 1) * end.evaluations, [end.f_m])


def forward_differences(problem: Factorised, b: Array) -> tuple[float, Array]:
    """F_M(b) and its gradient by finite differences, all points at once, (size,)."""
    values = costs(problem, np.hstack([b[:, None], b[:, None] + DIFFERENCE * np.eye(problem.size)]))
    return float(values[0]), (values[1:] - values[0]) / DIFFERENCE
