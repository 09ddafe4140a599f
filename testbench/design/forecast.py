"""What a plan promises: deflections to expect and the error of predicting them after identification."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.design.rows import Problem
from testbench.errors import Array

DRAWS = 4000  #: Draws of the remaining error behind an interval.
OUTSIDE = 1e-6  #: Share of a prediction's rows outside what the candidates show that counts as unseen.


@dataclass(frozen=True)
class Forecast:
    """RMS distance of a predicted from a true target, pose by pose and over all, with an interval.

    The interval holds 90 % of the errors that noise and what the prior leaves open can make.
    """

    #: In every pose, (poses,) [m]; infinite where the loads of the plan cannot show what is asked.
    error: Array
    low: Array  #: 5th percentile, (poses,) [m].
    high: Array  #: 95th percentile, (poses,) [m].
    overall: float  #: Root mean square over all poses [m].
    overall_low: float  #: 5th percentile of that [m].
    overall_high: float  #: 95th percentile [m].


def open_to(problem: Problem, rows: Array) -> npt.NDArray[np.bool_]:
    """Predictions (poses, 3 m, n) that ask for what neither candidates show nor a prior bounds, (poses,)."""
    open_ = np.linalg.norm(rows @ problem.unseen, axis=(1, 2))
    return np.asarray(open_ > OUTSIDE * np.linalg.norm(rows, axis=(1, 2)))


def forecast(problem: Problem, M: Array, rows: Array) -> Forecast:
    """Errors to expect of a linear model and normal noise, information matrix M (r, r).

    Predictions are rows per unit of x, three axes a target, (poses, 3 m, n) [m].
    """
    targets = rows.shape[1] / 3
    half = np.linalg.solve(np.linalg.cholesky(M), problem.lift.T)
    C = half.T @ half + problem.hidden
    values, V = np.linalg.eigh(C)
    root = V * np.sqrt(np.maximum(values, 0))
    draws = root @ np.random.Generator(np.random.Philox(0)).standard_normal((len(C), DRAWS))
    square = np.stack([np.square(A @ draws).sum(axis=0) for A in rows]) / targets  # (poses, draws)
    mean = np.einsum("pkn,nl,pkl->p", rows, C, rows, optimize=True) / targets
    unbounded = open_to(problem, rows)
    mean[unbounded], square[unbounded] = np.inf, np.inf
    low, high = np.sqrt(np.percentile(square, [5, 95], axis=1, method="lower"))
    over = np.percentile(square.mean(axis=0), [5, 95], method="lower")
    return Forecast(np.sqrt(mean), low, high, *map(math.sqrt, (mean.mean(), *over)))
