"""Arms that a prior could have drawn: what a forecast holds for, on average over many of them."""

from dataclasses import replace

import numpy as np
from scipy.stats import wishart

from testbench.bench.campaign import stream
from testbench.bench.plan_summary import overall
from testbench.bench.wrong_prior import UNCERTAINTY, wrong_prior
from testbench.design.specification import promise_of, task_rows
from testbench.errors import Array
from testbench.identify.metric import Metric
from testbench.plant import Plant
from testbench.studies.pose_selection.measure import Bench, build_bench, measure
from testbench.studies.pose_selection.rows import Row
from testbench.studies.pose_selection.settings import ON_ARMS, RANDOM, Settings
from testbench.studies.pose_selection.ways import poses_of

DRAWN = 200  #: Stream of a seed for noise on a drawn arm, plus the number of poses.


def draw(own: Metric, uncertainty: float, rng: np.random.Generator) -> Array:
    """Compliances of an arm that the prior could have drawn, conservative, (n_theta, n_theta).

    X of every block is Wishart with 2 / u^2 degrees of freedom and mean one: x then has the mean and the
    covariance u^2 of the prior, u its relative uncertainty [1], and C = P^1/2 X P^1/2 is positive definite.
    """
    freedom, parts = 2 / uncertainty**2, []
    for n in own.sizes:
        X = np.reshape(wishart(freedom, np.eye(n) / freedom).rvs(random_state=rng), (n, n))
        column, row = np.tril_indices(n)
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return own.structure.matrix(own.L @ np.concatenate(parts))


def with_compliance(plant: Plant, C_theta: Array) -> Plant:
    """The plant with other springs, for its linear truth."""
    C = np.zeros_like(plant.C)
    C[np.ix_(plant.theta, plant.theta)] = C_theta
    return replace(plant, C=C)


def of_drawn_arm(bench: Bench, asked: Settings, seed: int) -> list[Row]:
    """Plans and random poses on an arm that the planner's prior could have drawn, linear truth.

    Of the first criterion and of random poses every number is tried, of the others the featured one.
    """
    scope, spec = asked.scope, bench.spec
    names = (*scope.criteria, RANDOM)
    own, ahead, prior = spec.experiment.metric, task_rows(spec), wrong_prior(bench.cell, asked.seed)
    plant = with_compliance(bench.cell.plant, draw(own, UNCERTAINTY, stream(seed, 11)))
    arm = build_bench(replace(bench.cell, truth=plant), asked, "linear")
    every = {
        name: scope.poses if name in (scope.criteria[0], RANDOM) else (scope.featured,) for name in names
    }
    levels = [(name, n, poses_of(asked, name, n, seed)) for name in names for n in every[name]]
    forecasts = [overall(promise_of(spec, own.q, own.load, ahead)) for *_, own in levels]
    read = [measure(arm, spec, own, stream(seed, DRAWN + n)) for _, n, own in levels]
    return [
        Row("drawn arm", name, n, fit.name, error, expected=forecast)
        for fit in ON_ARMS
        for (name, n, _), forecast, (error, _) in zip(
            levels, forecasts, arm.errors_mm(fit.each(arm.cell.vjm, prior, read)), strict=True
        )
    ]
