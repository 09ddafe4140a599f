"""Choice of the model to take: a default, unless another predicts held-out poses better by more than chance.

Over the family of true arms and wrong priors (study `which_model`) one model predicts the workspace best with
8, 12 and 20 poses: GCO of all links and joints with a prior that is learnt from the readings. So it is the
default. It is averaged by evidence (`identify.average`) with joints alone, so that links which the readings
do not see add no noise, and with laws of the joints. Beside it stand joints alone without a prior, as a guard
against a prior that is wrong in ways which nobody thought of: where they predict poses held out clearly
better, they are taken.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, select
from testbench.errors import Array, Ids
from testbench.identify import Estimate, Estimator, Method, with_prior
from testbench.identify.fold import PartitionedRegression, reduce_parts
from testbench.identify.prior import Prior, Strength
from testbench.identify.regression import f_m
from testbench.identify.trace import Candidate, Duel, Fold, divide_poses, folds, unless_beaten
from testbench.model.laws import with_laws, with_ties
from testbench.progress import stepwise
from testbench.workflows.advice import of_average
from testbench.workflows.cell import Cell
from testbench.workflows.models import (
    ALL_UNKNOWNS,
    JOINTS,
    MODELS,
    Model,
    arm_model_name,
    canonical_name,
    fit_model,
    named_models,
)

FILLED = " + prior"
DEFAULT = f"ALL153{FILLED}"  #: Of an arm of six joints; of any arm `default_name`.
MODELS_WITHOUT_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68")
WITH_PRIOR = (JOINTS, "MGCO56", "MGCO68", "ALL153")
"""What is fitted to a user's runs where no model is named, without and with a prior."""
MIN_POSES = 4  #: Below it what is held out in turn is too little to overthrow a default.


@dataclass(frozen=True)
class Recommendation:
    """Say which model to take, and why."""

    name: str
    why: str  #: A sentence.
    candidates: tuple[Candidate, ...]  #: Errors of all models on what was held out; empty with one pose.


@dataclass(frozen=True)
class ChosenModel:
    """Hold the model that is taken by default."""

    name: str
    estimate: Estimate
    why: str  #: A sentence.


def default_models(cell: Cell, prior: Prior | None, strength: Strength | None = None) -> list[Model]:
    """List what is fitted where no model is named: some without a prior and, if there is one, with it.

    How firmly a prior is believed is learnt where no `strength` is given.

    Args:
        cell: The arm with its model and its truth.
        prior: The prior; None to fit without one.
        strength: How firmly the prior is believed; None to learn it.

    Returns:
        The models.
    """
    if prior is None:
        return named_models(cell, _possible(cell, tuple(MODELS)))
    plain, filled = (
        named_models(cell, _possible(cell, names)) for names in (MODELS_WITHOUT_PRIOR, WITH_PRIOR)
    )
    return [*plain, *with_priors(cell.arm, filled, prior, strength)]


def asked_models(
    cell: Cell,
    names: Sequence[str],
    prior: Prior | None,
    strength: Strength | None = None,
    *,
    loss: Callable[[Estimator], Estimator] | None = None,
) -> list[Model]:
    """Give the models to fit: those of some names, with the prior where it fits them, or the default.

    Args:
        cell: The arm.
        names: Of the models; none for the default.
        prior: None to fit without one.
        strength: How firmly the prior is believed; None to learn it.
        loss: Makes another estimator of each, such as `robust`.

    Returns:
        The models.

    Raises:
        BenchError: When the arm has no model of a name.
    """
    models = named_models(cell, names) if names else default_models(cell, prior, strength)
    if names and prior is not None:
        models = [
            with_priors(cell.arm, [m], prior, strength)[0] if m.structure.has_full_blocks else m
            for m in models
        ]
    return models if loss is None else [replace(m, estimator=loss(m.estimator)) for m in models]


def default_name(arm: Arm) -> str:
    """Name the default of an arm, such as ALL153 + prior."""
    return f"{canonical_name(arm, ALL_UNKNOWNS)}{FILLED}"


def _possible(cell: Cell, kinds: Sequence[str]) -> list[str]:
    """Names of those kinds of models that the arm has."""
    return list(dict.fromkeys(name for kind in kinds if (name := arm_model_name(cell, kind))))


def with_priors(
    arm: Arm, models: Sequence[Model], prior: Prior, strength: Strength | None = None
) -> list[Model]:
    """Give models of an arm a prior, and name them so.

    Args:
        arm: Description of the arm.
        models: The models.
        prior: The prior.
        strength: How firmly the prior is believed; None to learn it.

    Returns:
        The models.
    """
    return [_with_prior(arm, m, prior, strength) for m in models]


def _with_prior(arm: Arm, model: Model, prior: Prior, strength: Strength | None) -> Model:
    """With a prior; where it is learnt the model of all links and joints has the joints' laws beside."""
    method, s = with_prior(model.estimator, prior, strength), model.structure
    whole = s.has_full_blocks and len(s.blocks) == 2 * s.links - 1
    structure = with_ties(with_laws(s, arm)) if method.learns and whole else s
    return Model(f"{model.name}{FILLED}", structure, method)


def choose_model(cell: Cell, data: Dataset, prior: Prior) -> ChosenModel:
    """Choose the default, or joints alone where these predict what is held out clearly better.

    Args:
        cell: The arm with its model and its truth.
        data: Measured runs.
        prior: The prior.

    Returns:
        The model with its estimate.
    """
    models = [
        *named_models(cell, (JOINTS,)),
        *with_priors(cell.arm, named_models(cell, (ALL_UNKNOWNS,)), prior),
    ]
    recommendation = recommend(cell, models, data)
    [model] = [m for m in models if m.name == recommendation.name]
    estimate = fit_model(cell, model, data)
    return ChosenModel(model.name, estimate, reason_for(recommendation, estimate))


def reason_for(recommendation: Recommendation, estimate: Estimate) -> str:
    """Say why a model is taken, and how much other models count in it.

    Args:
        recommendation: The recommendation.
        estimate: The estimate.

    Returns:
        One sentence.
    """
    return "; ".join([*of_average(estimate.average), recommendation.why])


@dataclass(frozen=True)
class ReducedRuns:
    """Hold runs to fit, reduced once for all models, in parts of which some are held out in turn."""

    data: Dataset  #: Those that are held, for estimators of one's own.
    poses: int  #: All are in.
    part: Ids  #: Of every run, `crossval.divide_poses`.
    parts: Mapping[str, PartitionedRegression]  #: By the name of the structure.


def reduce_runs(cell: Cell, models: Sequence[Model], data: Dataset) -> ReducedRuns:
    """Reduce runs for the structures of models.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        data: Measured runs.

    Returns:
        The reduced runs.
    """
    structures = {m.structure.name: m.structure for m in models}
    part = divide_poses(data)
    parts = reduce_parts(cell.vjm, list(structures.values()), data, part)
    return ReducedRuns(data, len(np.unique(data.pose)), part, dict(zip(structures, parts, strict=True)))


def recommend(cell: Cell, models: Sequence[Model], runs: Dataset | ReducedRuns) -> Recommendation:
    """Recommend the default, or the smallest model if it is not there, unless beaten on what is held out.

    The default can be beaten by joints alone only; what else was fitted stands beside it to compare. Outliers
    stay in, as every model has to face the same readings.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        runs: The runs, reduced or not.

    Returns:
        The recommendation.
    """
    runs = runs if isinstance(runs, ReducedRuns) else reduce_runs(cell, models, runs)
    default = default_name(cell.arm)
    first = min(models, key=lambda m: (m.name != default, m.structure.n))
    if runs.poses < MIN_POSES or len(models) == 1:
        few = f"with fewer than {MIN_POSES} poses none is held out"
        why = few if runs.poses < MIN_POSES else "no other model was fitted"
        return Recommendation(first.name, why, ())
    every = tuple(Candidate(m.name, _errors(cell, m, runs)) for m in models)
    rivals = [c for c in every if first.name != default or c.name in (default, JOINTS)]
    duel = unless_beaten(rivals, first.name)
    return Recommendation(duel.name, _why(duel, first.name, default), every)


def _why(duel: Duel, first: str, default: str) -> str:
    """Why a model stays, or gives way."""
    taken = "the default" if first == default else "the model with fewest unknowns"
    if duel.name == first:
        return f"{taken}; in cross-validation no other model is significantly better"
    return (
        f"in cross-validation its F_M is {-duel.difference:.2g} +- {duel.standard_error:.2g} lower than "
        f"that of {taken}, {first}"
    )


def _errors(cell: Cell, model: Model, runs: ReducedRuns) -> Array:
    """F_M on what is held out, (folds,) [1]; an estimator of one's own sees the other runs as they are."""
    method = model.estimator

    def fit(fold: Fold) -> Array:
        if isinstance(method, Method):
            pi = method.fit_reduced(cell.vjm, fold.parts, widths=False).pi
            return np.pad(pi, (0, model.structure.n - len(pi)))  # laws are last
        return fit_model(cell, model, select(runs.data, np.isin(runs.part, fold.kept))).pi

    held = folds(runs.parts[model.structure.name])
    return np.array([f_m(fold.held_out, fit(fold)) for fold in stepwise(held, "cross-validating")])
