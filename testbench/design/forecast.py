"""What a plan promises: deflections to expect and the error of predicting them after identification."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.design.rows import Problem
from testbench.errors import Array, Mask

DRAWS = 4000  #: Draws of the remaining error behind an interval.
WIDER, BROAD = (0.7, 1.25), 1.2
"""Factors on the ends of a 90 % interval, and on a standard deviation: arms bend and priors are wrong [1].

Measured over the family of true arms and wrong priors, every pair twice (seeds 1 to 72; 8, 12 and 20 poses,
planned and random, on two grounds; all links and joints identified with a learnt prior). Of the RMS errors
3 % were below the lower end then and 4 % above the upper one; on cast links none and 17 %. Of the errors of a
deflection along an axis 97 % were within 1.2 times the normal interval of 95 %, on cast links 92 %.
"""
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
    deviation: Array  #: Root mean square of the error of every target along every axis, (poses, 3 m) [m].
    overall: float  #: Root mean square over all poses [m].
    overall_low: float  #: 5th percentile of that [m].
    overall_high: float  #: 95th percentile [m].


def widened(forecast: Forecast) -> Forecast:
    """The same with intervals that hold where the arm bends and the prior is wrong, see `WIDER`."""
    below, above = WIDER
    return replace(
        forecast,
        low=below * forecast.low,
        high=above * forecast.high,
        overall_low=below * forecast.overall_low,
        overall_high=above * forecast.overall_high,
    )


def open_to(problem: Problem, rows: Array) -> Mask:
    """Predictions (poses, 3 m, n) that ask for what neither candidates show nor a prior bounds, (poses,)."""
    open_ = np.linalg.norm(rows @ problem.unseen, axis=(1, 2))
    return np.asarray(open_ > OUTSIDE * np.linalg.norm(rows, axis=(1, 2)))


def forecast(problem: Problem, M: Array, rows: Array) -> Forecast:
    """Errors to expect of a linear model and normal noise, information matrix M (r, r).

    Predictions are rows per unit of x, three axes a target, (poses, 3 m, n) [m].
    """
    half = np.linalg.solve(np.linalg.cholesky(M), problem.lift.T)
    values, V = np.linalg.eigh(half.T @ half + problem.hidden)
    found = forecast_of(np.zeros(rows.shape[:2]), rows @ (V * np.sqrt(np.maximum(values, 0))))
    return without_bound(found, open_to(problem, rows))


def without_bound(forecast: Forecast, where: Mask) -> Forecast:
    """The same, the errors of some poses, (poses,), being infinite."""
    if not where.any():
        return forecast
    error, low, high = (np.where(where, np.inf, end) for end in (forecast.error, forecast.low, forecast.high))
    deviation = np.where(where[:, None], np.inf, forecast.deviation)
    return Forecast(error, low, high, deviation, math.inf, math.inf, math.inf)


def forecast_of(bias: Array, spread: Array) -> Forecast:
    """Errors of predictions that are bias + spread @ N(0, 1): (poses, 3 m) and (poses, 3 m, k) [m]."""
    targets = bias.shape[1] / 3
    draws = _draws(spread.shape[2])
    each = zip(bias, spread, strict=True)
    square = np.stack([np.square(b[:, None] + S @ draws).sum(axis=0) for b, S in each])  # (poses, draws)
    square /= targets
    variance = np.square(bias) + np.square(spread).sum(axis=2)
    mean = mean_square_of(bias, spread)
    low, high = np.sqrt(np.percentile(square, [5, 95], axis=1, method="lower"))
    over = np.percentile(square.mean(axis=0), [5, 95], method="lower")
    return Forecast(np.sqrt(mean), low, high, np.sqrt(variance), *map(math.sqrt, (mean.mean(), *over)))


def mean_square_of(bias: Array, spread: Array) -> Array:
    """Mean square distance of a target in every pose, of the same, (poses,) [m^2]."""
    variance = np.square(bias) + np.square(spread).sum(axis=2)
    return np.asarray(variance.sum(axis=1) / (bias.shape[1] / 3))


@lru_cache(maxsize=4)
def _draws(k: int) -> Array:
    """The same normal numbers for every forecast, (k, DRAWS); drawing them takes as long as using them."""
    return np.random.Generator(np.random.Philox(0)).standard_normal((k, DRAWS))
