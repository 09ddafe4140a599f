"""Fits of a campaign with and without a prior, with two kinds of truth, and as prior and poses are varied.

All models of a campaign see the same runs. Errors over the workspace are those of the true deflections in
poses never measured.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from testbench.campaign.baselines import JOINTS, equal_fit
from testbench.campaign.campaign import Campaign, Cell, Scenario, draw_poses, simulate, simulate_at
from testbench.campaign.campaign_row import Measured, Runs, measured, runs_row
from testbench.campaign.evaluation import identify
from testbench.campaign.models import Model, named_models
from testbench.campaign.perturbed_prior import SCALE, wrong_prior
from testbench.campaign.rows import JudgedRow, fit_row, judged_row
from testbench.data.dataset import Dataset
from testbench.identify import Estimate, Estimator, gco, least_squares, reduce, with_prior
from testbench.identify.crossval import choose_strength, every_fold
from testbench.identify.metric import metric, rescaled
from testbench.identify.prior import Prior
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm
from testbench.studies.estimators.stein import gco_least_trace, gco_stein, stein_parameters
from testbench.studies.identifiability.coverage import Covered
from testbench.trials.spread import Number

PLAIN = (JOINTS, "MLS56", "MGCO56", "MGCO68")
"""Models without a prior; beside MLS56 stands what is conservative and fits as well."""
VARIED = ("MGCO56", "MGCO68")  #: Structures whose prior's scale and number of poses are varied.
LS, GCO = "LS + prior", "GCO + prior"

Part = Literal["linear", "nonlinear", "scale", "poses"]
"""Truth of the campaign; what is varied of the linear one."""
Filling = Literal["none", "least trace", "prior", "log-det prior"]
"""What fills the directions that the data do not see: nothing but the method, or a prior in its metric."""
FILLINGS: dict[str, Filling] = {
    "least trace": "least trace",
    LS: "prior",
    GCO: "prior",
    "GCO + log-det": "log-det prior",
}
"""By what a model is called behind its structure."""


@dataclass(frozen=True)
class Tried:
    """What is varied."""

    structures: tuple[str, ...] = ("MGCO56", "MGCO68", "ALL153")  #: With a prior.
    scales: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 5.0)  #: Factors by which the prior is wrong.
    poses: tuple[int, ...] = (5, 8, 12, 20, 40)  #: Numbers of identification poses.


@dataclass(frozen=True)
class ModelRow(JudgedRow):
    """A model judged."""

    filling: Filling  #: What fills what the data do not see.
    uncertainty_percent: Number = None  #: Of the prior, as the readings or cross-validation chose it.


@dataclass(frozen=True)
class TrialRow:
    """One fit of a campaign, or the intervals of one dataset."""

    part: Part | None = None  #: What is varied; None of intervals.
    fit: ModelRow | None = None  #: The model.
    x: float | None = None  #: Scale of the prior or number of poses, where that is varied.
    measured: Measured | None = None  #: What was measured, in the first row of all; the truth is MuJoCo's.
    runs: Runs | None = None  #: The runs themselves, beside it.
    intervals: Covered | None = None


def rows(cell: Cell, scenario: Scenario, tried: Tried, seed: int, *, first: bool) -> Iterator[TrialRow]:
    """All fits of one seed."""
    scenario, poses = scenario.model_copy(update={"truth": "linear"}), draw_poses(cell, scenario, seed)
    linear = simulate_at(cell, scenario, seed, poses)
    bent = simulate_at(cell, scenario.model_copy(update={"truth": "nonlinear"}), seed, poses)
    if first:
        yield TrialRow(measured=measured(bent), runs=runs_row(bent.measured))
    every = [*_plain(cell), *_filled(cell, seed, tried.structures, tuple(FILLINGS))]
    yield from _fits(cell, linear, every, "linear")
    yield from _fits(cell, bent, every, "nonlinear")
    for scale in tried.scales:
        yield from _fits(cell, linear, _filled(cell, seed, VARIED, (LS, GCO), scale)[1:], "scale", scale)
    known = [*_plain(cell), *_filled(cell, seed, VARIED, (GCO,))]
    for count in tried.poses:
        runs = round(count * scenario.identification_runs / scenario.identification_poses)
        more = scenario.model_copy(update={"identification_poses": count, "identification_runs": runs})
        yield from _fits(cell, simulate(cell, more, seed), known, "poses", count)


def _plain(cell: Cell) -> list[Model]:
    models = named_models(cell, PLAIN)
    return [*models[:2], equal_fit(cell), *models[2:]]


def _filled(
    cell: Cell, seed: int, structures: Sequence[str], methods: Sequence[str], scale: float = SCALE
) -> list[Model]:
    """Joints alone, then structures by these methods, all with the same wrong prior."""
    prior = wrong_prior(cell, seed, scale)
    makers: dict[str, Estimator] = {
        "least trace": _of(cell, prior, _least_trace),
        LS: with_prior(least_squares, prior),
        GCO: with_prior(gco, prior),
        "GCO + log-det": _of(cell, prior, _log_det),
    }
    joints, *own = named_models(cell, (JOINTS, *structures))
    incumbent = Model(f"{JOINTS}, {LS}", joints.structure, makers[LS])
    return [incumbent, *(Model(f"{m.name}, {k}", m.structure, makers[k]) for m in own for k in methods)]


Fill = Callable[[Vjm, Structure, Dataset, Prior], Estimate]


def _of(cell: Cell, prior: Prior, fill: Fill) -> Estimator:
    """A method of a prior that `with_prior` does not have."""
    return lambda _, structure, data: fill(cell.vjm, structure, data, prior)


def _least_trace(vjm: Vjm, structure: Structure, data: Dataset, prior: Prior) -> Estimate:
    """GCO of least trace in the metric of a prior, no compliance believed."""
    regression = reduce(vjm, structure, data)
    return gco_least_trace(regression, rescaled(metric(prior, vjm, structure), regression))


def _log_det(vjm: Vjm, structure: Structure, data: Dataset, prior: Prior) -> Estimate:
    """GCO with the log-determinant prior."""
    regression = reduce(vjm, structure, data)
    own = rescaled(metric(prior, vjm, structure), regression)
    return gco_stein(
        regression, own, choose_strength(every_fold(vjm, structure, data), own, stein_parameters)
    )


def _fits(
    cell: Cell, campaign: Campaign, models: Sequence[Model], part: Part, x: float | None = None
) -> Iterator[TrialRow]:
    for result in identify(cell, campaign, models, time.perf_counter):
        name, belief = result.model.name, result.estimate.belief
        filling = FILLINGS.get(name.rpartition(", ")[2], "none")
        fit = fit_row(name, result.estimate, result.seconds, prior="prior" in filling)
        uncertainty = 100 * belief.strength.uncertainty if belief else None
        own = ModelRow(**vars(judged_row(fit, result)), filling=filling, uncertainty_percent=uncertainty)
        yield TrialRow(part, own, x)
