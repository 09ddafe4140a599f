"""Models of a campaign, with a prior or without, identified from the same runs and judged."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from testbench.bench.campaign import Campaign, Cell, Model, identify, named_models
from testbench.bench.rows import JudgedRow, judged_row
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import Estimate, Estimator, gco, least_squares, reduce, with_prior
from testbench.identify.crossval import choose_strength, every_fold
from testbench.identify.metric import Case, Metric, metric, rescaled
from testbench.identify.prior import Prior, Strength
from testbench.identify.regression import Regression
from testbench.identify.regularised import gco_least_trace, gco_with
from testbench.identify.stein import gco_steins
from testbench.model.structure import Structure, all153, mgco47, mgco68, mgco147, template56
from testbench.model.vjm import Vjm
from testbench.trials.spread import Number

BELIEVED = 1e-6  #: Relative uncertainty of a scale that is believed.
STRUCTURES: dict[str, Callable[[Cell], Structure]] = {
    "joints": lambda cell: Structure.of(cell.arm, joints=[j.name for j in cell.arm.joints], name="joints"),
    "MGCO47": lambda cell: mgco47(cell.arm),
    "MGCO56": lambda cell: template56(cell.arm),
    "MGCO68": lambda cell: mgco68(cell.arm),
    "MGCO147": lambda cell: mgco147(cell.arm),
    "ALL153": lambda cell: all153(cell.arm),
}
PLAIN = ("MLS56", "MGCO56", "MGCO68")  #: Models without a prior.

Family = Callable[[Sequence[tuple[Regression, Strength]], Metric], list[Estimate]]
"""Estimates of several datasets and strengths in one metric."""
Filling = Literal["none", "least trace", "prior", "log-det prior"]
"""What fills the directions that the data do not see: nothing but the method, or a prior in its metric."""


def least_trace(prior: Prior) -> Estimator:
    """GCO of least trace in the metric of a prior, no compliance believed."""

    def fit(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        regression = reduce(vjm, structure, data)
        return gco_least_trace(regression, rescaled(metric(prior, vjm, structure), regression))

    return fit


def cross_validated(prior: Prior, family: Family, *, scaled: bool = True) -> Estimator:
    """A method with a prior, as firm as cross-validation over poses chooses; scaled to the data or not."""

    def fit(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        regression, own = reduce(vjm, structure, data), metric(prior, vjm, structure)
        own = rescaled(own, regression) if scaled else own

        def each(cases: Sequence[Case]) -> Array:
            return np.array([e.pi for e in family([(c.regression, c.belief.strength) for c in cases], own)])

        strength = choose_strength(every_fold(vjm, structure, data), own, each)
        return family([(regression, strength)], own)[0]

    return fit


def log_det(prior: Prior) -> Estimator:
    """GCO with the log-determinant prior."""
    return cross_validated(prior, gco_steins)


def fixed_scale(prior: Prior) -> Estimator:
    """GCO with a prior whose scale is believed."""
    return cross_validated(prior, _believed, scaled=False)


def _believed(fits: Sequence[tuple[Regression, Strength]], own: Metric) -> list[Estimate]:
    return [gco_with(regression, own, Strength(u.uncertainty, BELIEVED)) for regression, u in fits]


WITH_PRIOR: dict[str, tuple[Filling, Callable[[Prior], Estimator]]] = {
    "least trace": ("least trace", least_trace),
    "LS + prior": ("prior", partial(with_prior, least_squares)),
    "GCO + prior": ("prior", partial(with_prior, gco)),
    "GCO + log-det": ("log-det prior", log_det),
}


@dataclass(frozen=True)
class ModelRow(JudgedRow):
    """A model judged, and what fills what the data do not see."""

    filling: Filling  #: What fills what the data do not see.
    uncertainty_percent: Number = None  #: Of the prior, as cross-validation chose it.
    #: Of least squares with a prior: error over the workspace of GCO with the same prior, believed as firmly,
    #: over its own.
    gco_over_ls_at_this_strength: Number = None


def judge(cell: Cell, campaign: Campaign, model: Model, filling: Filling) -> tuple[ModelRow, Estimate]:
    """Identify a model and judge it."""
    [result] = identify(cell, campaign, [model], time.perf_counter)
    belief = result.estimate.belief
    row = ModelRow(
        **vars(judged_row(result, prior=filling in ("prior", "log-det prior"))),
        filling=filling,
        uncertainty_percent=100 * belief.strength.uncertainty if belief else None,
    )
    return row, result.estimate


def plain(cell: Cell, campaign: Campaign) -> Iterator[ModelRow]:
    """Models without a prior."""
    for model in named_models(cell, PLAIN):
        yield judge(cell, campaign, model, "none")[0]


def filled(cell: Cell, campaign: Campaign, name: str, method: str, prior: Prior) -> ModelRow:
    """One of `STRUCTURES`, what the data do not see filled by one of `WITH_PRIOR`."""
    filling, make = WITH_PRIOR[method]
    model = Model(f"{name}, {method}", STRUCTURES[name](cell), make(prior))
    return judge(cell, campaign, model, filling)[0]
