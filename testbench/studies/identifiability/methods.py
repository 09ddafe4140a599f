"""Fits of a campaign with a prior: each is made once, from runs that are reduced once a structure."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from testbench.bench.baselines import JOINTS, equal_fit
from testbench.bench.campaign import Campaign, Cell
from testbench.bench.judged import Errors, identify, judge_all
from testbench.bench.models import Model, named_models
from testbench.bench.rows import JudgedRow, fit_row, judged_row
from testbench.bench.wrong_prior import wrong_prior
from testbench.errors import Array
from testbench.identify import Estimate, reduce
from testbench.identify.crossval import Fold, choose_strength, every_fold
from testbench.identify.estimate import Constraint
from testbench.identify.hierarchy import learn
from testbench.identify.metric import Belief, Case, Metric, metric, rescaled
from testbench.identify.regression import Regression
from testbench.identify.regularised import fit_reduced, gco_least_trace, parameters
from testbench.identify.stein import gco_stein, stein_parameters
from testbench.model.structure import Structure, all153, joints_only, mgco47, mgco68, mgco147, template56
from testbench.trials.spread import Number

BELIEVED = 1e-6  #: Relative uncertainty of a scale that is believed.
STRUCTURES: dict[str, Callable[[Cell], Structure]] = {
    JOINTS: lambda cell: joints_only(cell.arm),
    "MGCO47": lambda cell: mgco47(cell.arm),
    "MGCO56": lambda cell: template56(cell.arm),
    "MGCO68": lambda cell: mgco68(cell.arm),
    "MGCO147": lambda cell: mgco147(cell.arm),
    "ALL153": lambda cell: all153(cell.arm),
}
PLAIN = (JOINTS, "MLS56", "MGCO56", "MGCO68")
"""Models without a prior; beside MLS56 stands what is conservative and fits as well."""

Filling = Literal["none", "least trace", "prior", "log-det prior"]
"""What fills the directions that the data do not see: nothing but the method, or a prior in its metric."""


@dataclass(frozen=True)
class Seen:
    """What the runs of a campaign say of a structure."""

    regression: Regression  #: All runs to identify from.
    folds: Sequence[Fold]  #: The same with poses held out.


Filled = Callable[[Seen, Metric], Estimate]


def _least_trace(seen: Seen, own: Metric) -> Estimate:
    """GCO of least trace in the metric of a prior, no compliance believed."""
    return gco_least_trace(seen.regression, rescaled(own, seen.regression))


def _with_prior(constraint: Constraint, seen: Seen, own: Metric) -> Estimate:
    """Least squares or GCO with a prior that is learnt from the readings."""
    return fit_reduced(seen.regression, constraint, learn(seen.regression, own))


def _scale_believed(seen: Seen, own: Metric) -> Estimate:
    """GCO with a prior whose scale is believed."""

    def firm(belief: Belief) -> Belief:
        return replace(belief, strength=replace(belief.strength, scale_uncertainty=BELIEVED))

    def fits(cases: Sequence[Case]) -> Array:
        return parameters("psd", [replace(case, belief=firm(case.belief)) for case in cases])

    strength = choose_strength(seen.folds, own, fits)
    return fit_reduced(seen.regression, "psd", firm(Belief(own, strength)))


def _log_det(seen: Seen, own: Metric) -> Estimate:
    """GCO with the log-determinant prior."""
    own = rescaled(own, seen.regression)
    return gco_stein(seen.regression, own, choose_strength(seen.folds, own, stein_parameters))


WITH_PRIOR: dict[str, tuple[Filling, Filled]] = {
    "least trace": ("least trace", _least_trace),
    "LS + prior": ("prior", partial(_with_prior, "none")),
    "GCO + prior": ("prior", partial(_with_prior, "psd")),
    "GCO + log-det": ("log-det prior", _log_det),
}
SCALE_BELIEVED = "scale believed"
METHODS: dict[str, tuple[Filling, Filled]] = {**WITH_PRIOR, SCALE_BELIEVED: ("prior", _scale_believed)}


@dataclass(frozen=True)
class Asked:
    """A fit."""

    structure: str  #: One of `STRUCTURES`.
    method: str  #: One of `METHODS`.
    scale: float  #: Common factor by which the prior is wrong.


@dataclass(frozen=True)
class ModelRow(JudgedRow):
    """A model judged, and what fills what the data do not see."""

    filling: Filling  #: What fills what the data do not see.
    uncertainty_percent: Number = None  #: Of the prior, as the readings or cross-validation chose it.
    #: Of least squares with a prior: error over the workspace of GCO with the same prior, believed as firmly,
    #: over its own.
    gco_over_ls_at_this_strength: Number = None


@dataclass(frozen=True)
class Fitted:
    """A fit, and what it was made from."""

    row: ModelRow
    estimate: Estimate
    seen: Seen


def fit_each(cell: Cell, campaign: Campaign, asked: Iterable[Asked], seed: int) -> dict[Asked, Fitted]:
    """Every fit that is asked of a campaign, once; the seed is of the errors of its priors."""
    wanted = tuple(dict.fromkeys(asked))
    seen = {name: _seen(cell, campaign, STRUCTURES[name](cell)) for name in {own.structure for own in wanted}}
    estimates, seconds = [], []
    for own in wanted:
        start, runs = time.perf_counter(), seen[own.structure]
        prior = metric(wrong_prior(cell, seed, own.scale), cell.vjm, runs.regression.structure)
        estimates.append(METHODS[own.method][1](runs, prior))
        seconds.append(time.perf_counter() - start)
    fits = {}
    errors = judge_all(cell, campaign, estimates)
    for own, estimate, taken, off in zip(wanted, estimates, seconds, errors, strict=True):
        row = _row(f"{own.structure}, {own.method}", METHODS[own.method][0], estimate, taken, off)
        fits[own] = Fitted(row, estimate, seen[own.structure])
    return fits


def _seen(cell: Cell, campaign: Campaign, structure: Structure) -> Seen:
    args = cell.vjm, structure, campaign.identification
    return Seen(reduce(*args), every_fold(*args))


def _row(name: str, filling: Filling, estimate: Estimate, seconds: float, errors: Errors) -> ModelRow:
    belief, believed = estimate.belief, filling in ("prior", "log-det prior")
    return ModelRow(
        **vars(judged_row(fit_row(name, estimate, seconds, prior=believed), errors)),
        filling=filling,
        uncertainty_percent=100 * belief.strength.uncertainty if belief else None,
    )


def identified(
    cell: Cell, campaign: Campaign, models: Sequence[Model], filling: Filling
) -> list[tuple[ModelRow, Estimate]]:
    """Models identified and judged."""
    results = identify(cell, campaign, models, time.perf_counter)
    return [(_row(r.model.name, filling, r.estimate, r.seconds, r), r.estimate) for r in results]


def plain(cell: Cell, campaign: Campaign) -> list[ModelRow]:
    """Models without a prior."""
    models = named_models(cell, PLAIN)
    models.insert(PLAIN.index("MLS56") + 1, equal_fit(cell))
    return [row for row, _ in identified(cell, campaign, models, "none")]
