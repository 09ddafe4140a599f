"""Models by name: a structure with the method that identifies it.

Choice of the model to take: a default, unless another predicts held-out poses better by more than chance.

Over the family of true arms and wrong priors (study `which_model`) one model predicts the workspace best with
8, 12 and 20 poses: GCO of all links and joints with a prior that is learnt from the readings. So it is the
default. It is averaged by evidence (`identify.average`) with joints alone, so that links which the readings
do not see add no noise, and with laws of the joints. Beside it stand joints alone without a prior, as a guard
against a prior that is wrong in ways which nobody thought of: where they predict poses held out clearly
better, they are taken.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from testbench.arm.elastic import rotated_compliance
from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, select_runs
from testbench.display import Displayed
from testbench.errors import Array, BenchError, check_type
from testbench.identify.estimate import Estimate, Estimator, make_estimate
from testbench.identify.method import Method, completed_least_squares, gco, least_squares, with_prior
from testbench.identify.prior import Prior, PriorUncertainty, cad_prior, perturb_prior
from testbench.identify.regression import (
    GroupedRegression,
    f_m,
    non_redundant_structure,
    reduce,
    reduce_by_group,
)
from testbench.identify.trace import (
    Fold,
    HeldOutErrors,
    ModelComparison,
    cross_validation_groups,
    folds,
    keep_first_unless_beaten,
)
from testbench.model.laws import add_coupling_parameters, add_law_parameters
from testbench.model.structure import JOINTS_ONLY as JOINTS_ONLY
from testbench.model.structure import (
    Structure,
    all153,
    joints_only,
    mgco47,
    mgco68,
    mgco69,
    mgco147,
    template56,
)
from testbench.model.vjm import Vjm
from testbench.progress import stepwise
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import Cell
from testbench.workflows.model_names import EQUAL_FIT, FILLED
from testbench.workflows.rows import FAILED, FitRow

# --- Models by name: a structure with the method that identifies it -----------------------------------------


@dataclass(frozen=True, repr=False)
class Model(Displayed):
    """Hold a named structure with the method that identifies it."""

    name: str  #: Name as in the paper, such as MGCO68.
    structure: Structure  #: The unknowns.
    estimator: Estimator  #: A `Method`, or a function of your own.

    @property
    def filled(self) -> bool:
        """Tell whether its method, or a user's estimator, has a prior."""
        return getattr(self.estimator, "prior", None) is not None

    def summary(self) -> dict[str, object]:
        """Summarise name and number of unknowns."""
        return {"name": self.name, "unknowns": self.structure.n_parameters}


def _made(structure: Callable[[Arm], Structure], estimator: Estimator) -> Callable[[Cell], Model]:
    def make(cell: Cell) -> Model:
        check_type(cell, Cell, "cell")
        unknowns = structure(cell.arm)
        return Model(unknowns.name, unknowns, estimator)

    return make


def _mls32(cell: Cell) -> Model:
    check_type(cell, Cell, "cell")
    return Model(
        "MLS32", non_redundant_structure(cell.vjm, template56(cell.arm), name="MLS32"), least_squares
    )


class _Named(dict[str, Callable[[Cell], Model]]):
    """Models by name; a BenchError lists the names where there is no such model."""

    def __missing__(self, name: str) -> Callable[[Cell], Model]:
        raise BenchError(f"no model {name!r}; models are {', '.join(self)}")

    def __repr__(self) -> str:
        return f"models {', '.join(self)}"


MODELS = _Named(
    {
        JOINTS_ONLY: _made(joints_only, least_squares),
        "MLS32": _mls32,
        "MLS56": _made(partial(template56, name="MLS56"), least_squares),
        "MGCO47": _made(mgco47, gco),
        "MGCO56": _made(template56, gco),
        "MGCO68": _made(mgco68, gco),
        "MGCO69": _made(mgco69, gco),
        "MGCO147": _made(mgco147, gco),
        "ALL153": _made(all153, gco),
    }
)
"""Models by name, the paper's, "Joints" and "ALL153": MODELS["MGCO56"](cell) has structure and method.

The names count the unknowns of an arm of six joints; of another arm they are kinds, and the model's own name
has its own count.
"""

SECTION_6 = ("MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The models of section 6, in the paper's order."""
PAPERS_JOINTS = 6  #: Joints of the arms for which the paper chose links and parameters.
ANY_ARM = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO147", "ALL153")
"""Kinds of models that take all links or none, and so are of any arm."""
LEVEL = 1e-9  #: Of a direction's upward part: rounding.
ALL_UNKNOWNS = "ALL"  #: Of any arm the model of all links and joints, whatever its count.


def arm_model_names(cell: Cell) -> dict[str, str]:
    """Map the names of an arm's models to their kinds, keys of `MODELS`."""
    if cell.arm.n_joints == PAPERS_JOINTS:
        return {name: name for name in MODELS}
    kinds = [kind for kind in ANY_ARM if cell.arm.joints or kind != JOINTS_ONLY]
    return {MODELS[kind](cell).name: kind for kind in kinds}


def arm_model_name(cell: Cell, kind: str) -> str | None:
    """Return the name of an arm's model of a kind.

    MGCO68 leaves out joint 1 because gravity does not load it. If gravity does, MGCO69 replaces it.

    Args:
        cell: The arm.
        kind: Key of `MODELS`.

    Returns:
        The name; None if the arm has no such model.
    """
    kind = "MGCO69" if kind == "MGCO68" and _first_is_loaded(cell.vjm) else kind
    return next((name for name, own in arm_model_names(cell).items() if own == kind), None)


def plain_name(cell: Cell) -> str:
    """Return the default model for a fit without a prior."""
    return _possible(cell, ("MGCO68", "MGCO56"))[0]


def _first_is_loaded(vjm: Vjm) -> bool:
    """Whether gravity moves joint 1: a hinge that is not upright, a slide that is not level."""
    if not vjm.arm.joints:
        return False
    upward = abs(float(vjm.base_pose[2, :3] @ vjm.joint_placements[0, :3, :3] @ vjm.joint_axes[0]))
    return upward > LEVEL if vjm.arm.joints[0].prismatic else upward < 1 - LEVEL


def named_models(cell: Cell, names: Sequence[str] = SECTION_6) -> list[Model]:
    """Build models by the names that the arm gives them.

    Args:
        cell: The arm.
        names: Names in any case; "ALL" for all links and joints.

    Returns:
        The models.

    Raises:
        BenchError: If the arm has no such model.
    """
    return [MODELS[arm_model_names(cell)[canonical_name(cell, name)]](cell) for name in names]


def canonical_name(cell: Cell, name: str) -> str:
    """Find the exact name of an arm's model.

    Args:
        cell: The arm.
        name: The name in any case.

    Returns:
        The name.

    Raises:
        BenchError: If the arm has no such model.
    """
    names, arm = arm_model_names(cell), cell.arm
    every = {known.casefold(): known for known in names}
    every |= {ALL_UNKNOWNS.casefold(): next(known for known, kind in names.items() if kind == "ALL153")}
    if name.casefold() in every:
        return every[name.casefold()]
    of = "" if arm.n_joints == PAPERS_JOINTS else f" of {arm.name}, {arm.n_joints} joints"
    raise BenchError(f"no model {name!r}{of}; models are {', '.join(names)}")


def equal_fit(cell: Cell) -> Model:
    """Make the model of MLS56 with its free directions used to be conservative."""
    return Model(EQUAL_FIT, template56(cell.arm, name="MLS56"), completed_least_squares)


class EstimatorFailed(BenchError):
    """Signal that a user's estimator failed, or that its answer is none."""

    def __init__(self, model: Model, why: str) -> None:
        super().__init__(f"{model.name}: its estimator failed: {why}")
        self.model, self.why = model, why


def fit_model(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; a user's estimator does not see the folder's compliances.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate.
    """
    if isinstance(model.estimator, Method):
        return model.estimator(cell.vjm, model.structure, data)
    try:
        estimate = model.estimator(without_compliances(cell.vjm), model.structure, data)
    except Exception as err:
        why = str(err) if isinstance(err, BenchError) else f"{type(err).__name__}: {err}"
        raise EstimatorFailed(model, " ".join(why.split())) from err
    if not isinstance(estimate, Estimate):
        raise EstimatorFailed(model, f"expected an Estimate, got {type(estimate).__name__}")
    n = model.structure.n_parameters
    if estimate.pi.shape != (n,) or not (
        np.isfinite(estimate.pi).all() and np.isfinite(estimate.C_theta).all()
    ):
        raise EstimatorFailed(model, f"expected {n} finite parameters, got shape {estimate.pi.shape}")
    return estimate


def fit_or_rigid(cell: Cell, model: Model, data: Dataset) -> Estimate:
    """Fit a model to runs; of an estimator that fails return a rigid arm, whose status says why.

    Args:
        cell: The arm with its model and its truth.
        model: The model.
        data: Measured runs.

    Returns:
        The estimate; see `has_failed`.
    """
    try:
        return fit_model(cell, model, data)
    except EstimatorFailed as err:
        regression = reduce(cell.vjm, model.structure, data)
        rigid = make_estimate(regression, np.zeros(model.structure.n_parameters), method="own estimator")
        return replace(rigid, status=FAILED + err.why)


def has_failed(estimate: Estimate) -> bool:
    """Tell whether an estimate is of a user's estimator that failed: its numbers say nothing."""
    return estimate.status.startswith(FAILED)


def without_compliances(vjm: Vjm) -> Vjm:
    """Replace an arm's compliances by NaN: in simulations the folder's may be the true ones."""
    links = tuple(replace(link, compliance=np.full((6, 6), np.nan)) for link in vjm.arm.links)
    joints = tuple(replace(joint, compliance=np.nan) for joint in vjm.arm.joints)
    return replace(vjm, arm=replace(vjm.arm, links=links, joints=joints))


def failed_row(name: str, structure: Structure, status: str, *, prior: bool) -> FitRow:
    """Make the row of an estimator that failed.

    Args:
        name: Name of the model.
        structure: The unknowns.
        status: Says why it failed.
        prior: Whether it was given a prior.

    Returns:
        The row.
    """
    parameters = structure.n_parameters
    return FitRow(name=name, structure=structure.name, prior=prior, status=status, parameters=parameters)


# --- Choice of the model to take ----------------------------------------------------------------------------

DEFAULT = f"ALL153{FILLED}"  #: Of an arm of six joints; of any arm `default_name`.
MODELS_WITHOUT_PRIOR = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68")
WITH_PRIOR = (JOINTS_ONLY, "MGCO56", "MGCO68", "ALL153")
"""What is fitted to a user's runs where no model is named, without and with a prior."""
MIN_POSES = 4  #: Below it what is held out in turn is too little to overthrow a default.


@dataclass(frozen=True)
class Recommendation:
    """Say which model to take, and why."""

    name: str
    why: str  #: A sentence.
    candidates: tuple[HeldOutErrors, ...]  #: Errors of all models on what was held out; empty with one pose.


def default_models(
    cell: Cell, prior: Prior | None, uncertainty: PriorUncertainty | None = None
) -> list[Model]:
    """List what is fitted where no model is named: some without a prior and, if there is one, with it.

    The uncertainty of a prior is learnt if none is given.

    Args:
        cell: The arm with its model and its truth.
        prior: The prior; None to fit without one.
        uncertainty: Uncertainty of the prior; None to learn it.

    Returns:
        The models.
    """
    if prior is None:
        return named_models(cell, _possible(cell, tuple(MODELS)))
    plain, filled = (
        named_models(cell, _possible(cell, names)) for names in (MODELS_WITHOUT_PRIOR, WITH_PRIOR)
    )
    return [*plain, *with_priors(cell.arm, filled, prior, uncertainty)]


def asked_models(
    cell: Cell,
    names: Sequence[str],
    prior: Prior | None,
    uncertainty: PriorUncertainty | None = None,
    *,
    loss: Callable[[Estimator], Estimator] | None = None,
) -> list[Model]:
    """Give the models to fit: those of some names, with the prior where it fits them, or the default.

    Args:
        cell: The arm.
        names: Of the models; none for the default.
        prior: None to fit without one.
        uncertainty: Uncertainty of the prior; None to learn it.
        loss: Makes another estimator of each, such as `robust`.

    Returns:
        The models.

    Raises:
        BenchError: When the arm has no model of a name, or a name is given twice.
    """
    models = named_models(cell, names) if names else default_models(cell, prior, uncertainty)
    if len({m.name for m in models}) < len(models):
        raise BenchError(f"expected different models, got {', '.join(m.name for m in models)}")
    if names and prior is not None:
        models = [
            with_priors(cell.arm, [m], prior, uncertainty)[0] if m.structure.has_full_blocks else m
            for m in models
        ]
    return models if loss is None else [replace(m, estimator=loss(m.estimator)) for m in models]


def default_name(cell: Cell) -> str:
    """Name the default of an arm, such as ALL153 + prior."""
    return f"{canonical_name(cell, ALL_UNKNOWNS)}{FILLED}"


def _possible(cell: Cell, kinds: Sequence[str]) -> list[str]:
    """Names of those kinds of models that the arm has."""
    return list(dict.fromkeys(name for kind in kinds if (name := arm_model_name(cell, kind))))


def with_priors(
    arm: Arm, models: Sequence[Model], prior: Prior, uncertainty: PriorUncertainty | None = None
) -> list[Model]:
    """Give models of an arm a prior, and name them so.

    Where it is learnt, the model of all links and joints has the joints' laws beside.

    Args:
        arm: Description of the arm.
        models: The models.
        prior: The prior.
        uncertainty: Uncertainty of the prior; None to learn it.

    Returns:
        The models.
    """
    found = []
    for model in models:
        method, s = with_prior(model.estimator, prior, uncertainty), model.structure
        if method.learns_prior and s.has_full_blocks and len(s.blocks) == 2 * s.n_links - 1:
            s = add_coupling_parameters(add_law_parameters(s, arm))  # all links and joints
        found.append(Model(f"{model.name}{FILLED}", s, method))
    return found


def choose_model(cell: Cell, data: Dataset, prior: Prior) -> tuple[str, Estimate]:
    """Choose the default, or joints alone where these predict what is held out clearly better.

    Args:
        cell: The arm with its model and its truth.
        data: Measured runs.
        prior: The prior.

    Returns:
        Name of the model, and its estimate.
    """
    models = [
        *named_models(cell, (JOINTS_ONLY,)),
        *with_priors(cell.arm, named_models(cell, (ALL_UNKNOWNS,)), prior),
    ]
    name = recommend(cell, models, data, reduce_runs(cell, models, data)).name
    [model] = [m for m in models if m.name == name]
    return name, fit_model(cell, model, data)


def reduce_runs(cell: Cell, models: Sequence[Model], data: Dataset) -> dict[str, GroupedRegression]:
    """Reduce runs once for all models, in parts of which some are held out in turn.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        data: Measured runs.

    Returns:
        The reduced runs by the name of the structure.
    """
    structures = {m.structure.name: m.structure for m in models}
    parts = reduce_by_group(cell.vjm, list(structures.values()), data, cross_validation_groups(data))
    return dict(zip(structures, parts, strict=True))


def recommend(
    cell: Cell, models: Sequence[Model], data: Dataset, reduced: Mapping[str, GroupedRegression]
) -> Recommendation:
    """Recommend the default, or the smallest model if it is not there, unless beaten on what is held out.

    The default can be beaten by joints alone only; what else was fitted stands beside it to compare. Outliers
    stay in, as every model has to face the same readings.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        data: Measured runs.
        reduced: The same reduced, `reduce_runs`.

    Returns:
        The recommendation.
    """
    poses, default = len(np.unique(data.pose_id)), default_name(cell)
    first = min(models, key=lambda m: (m.name != default, m.structure.n_parameters))
    if poses < MIN_POSES or len(models) == 1:
        few = f"with fewer than {MIN_POSES} poses, no pose is held out to compare models"
        why = few if poses < MIN_POSES else "no other model was fitted"
        return Recommendation(first.name, why, ())
    every = tuple(HeldOutErrors(m.name, _errors(cell, m, data, reduced[m.structure.name])) for m in models)
    rivals = [c for c in every if first.name != default or c.model_name in (default, JOINTS_ONLY)]
    duel = keep_first_unless_beaten(rivals, first.name)
    return Recommendation(duel.selected_name, _why(duel, first.name, default), every)


def _why(duel: ModelComparison, first: str, default: str) -> str:
    """Why a model stays, or gives way."""
    taken = "the default" if first == default else "the model with fewest unknowns"
    if duel.selected_name == first:
        return f"it is {taken}; in cross-validation no other model is significantly better"
    return (
        f"in cross-validation its F_M is {-duel.difference:.2g} ± {duel.standard_error:.2g} lower than "
        f"that of {taken}, {first}"
    )


def _errors(cell: Cell, model: Model, data: Dataset, reduced: GroupedRegression) -> Array:
    """F_M on what is held out, (folds,) [1]; an estimator of one's own sees the other runs as they are."""
    method, part = model.estimator, cross_validation_groups(data)

    def fit(fold: Fold) -> Array:
        if isinstance(method, Method):
            pi = method.fit_reduced(cell.vjm, fold.fitted_equations, for_intervals=False).pi
            return np.pad(pi, (0, model.structure.n_parameters - len(pi)))  # laws are last
        return fit_model(cell, model, select_runs(data, np.isin(part, fold.fitted_equations.groups))).pi

    held = folds(reduced)
    return np.array([f_m(fold.held_out_regression, fit(fold)) for fold in stepwise(held, "cross-validating")])


# --- Priors that are wrong on purpose, and models that are fitted with them ---------------------------------

SCALE, SHAPE, UNCERTAINTY = 2.0, 0.3, 0.3
"""How wrong a prior is, by a common factor and axis by axis, and how firmly it is believed."""
WRONG_FACTOR, WRONG_ROTATION = 10.0, np.deg2rad(20)
"""How wrong one link or the joints are, as a factor, and by how much beam axes are turned [rad]."""

Spoil = Callable[[Array, int, np.random.Generator], Array]
"""What is done to C_theta, (n_theta, n_theta), of so many links."""


@dataclass(frozen=True)
class Wrong:
    """Describe what is wrong with a prior."""

    spoil: Spoil
    words: str
    #: What is WRONG_FACTOR too soft or too stiff: a link, or all joints.
    far: Literal["link", "joints"] | None = None


def wrong_prior(cell: Cell, seed: int, scale: float = SCALE) -> Prior:
    """Spoil the CAD prior: `scale` times too soft and SHAPE wrong axis by axis, another one for every seed.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.
        scale: Factor of all compliances [1].

    Returns:
        The prior.
    """
    return perturb_prior(cad_prior(cell.arm), scale=scale, shape=SHAPE, rng=trial_rng(seed, 5))


def prior_of(cell: Cell, name: str, seed: int) -> Prior:
    """Make a prior by the name of its error: right, or `wrong_prior` with something more.

    Args:
        cell: The arm with its model and its truth.
        name: One of PRIORS.
        seed: Seed of the trial.

    Returns:
        The prior.
    """
    if name not in PRIORS:
        raise BenchError(f"no prior {name!r}; priors are {', '.join(PRIORS)}")
    if name == UNPERTURBED:
        return cad_prior(cell.arm)
    wrong = wrong_prior(cell, seed)
    C = PRIORS[name].spoil(wrong.C_theta.copy(), len(cell.arm.links), trial_rng(seed, 9))
    return Prior(f"{wrong.name}; {name}", C)


def wrong_link(cell: Cell, seed: int) -> int:
    """Return which link `prior_of` has wrong by WRONG_FACTOR in the prior that has one so, from 0.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.

    Returns:
        Index of the link.
    """
    return int(trial_rng(seed, 9).integers(len(cell.arm.links)))


def with_wrong_prior(cell: Cell, models: Sequence[Model], names: Sequence[str], seed: int) -> list[Model]:
    """Add models with a prior that is wrong to those without.

    Args:
        cell: The arm with its model and its truth.
        models: The models.
        names: Models that are fitted with the prior too.
        seed: Seed of the prior's errors.

    Returns:
        All models.
    """
    chosen = [m for m in models if m.name in names]
    return [*models, *with_priors(cell.arm, chosen, wrong_prior(cell, seed), PriorUncertainty(UNCERTAINTY))]


def _one_link(C: Array, links: int, rng: np.random.Generator) -> Array:
    """One link WRONG_FACTOR too soft or too stiff."""
    k = 6 * int(rng.integers(links))
    C[k : k + 6, k : k + 6] *= _far(rng)
    return C


def _joints(C: Array, links: int, rng: np.random.Generator) -> Array:
    """All joints WRONG_FACTOR too soft, or all too stiff."""
    C[6 * links :, 6 * links :] *= _far(rng)
    return C


def _axes(C: Array, links: int, rng: np.random.Generator) -> Array:
    """The beam axes of every link turned by WRONG_ROTATION, each about a random axis."""
    for own in (slice(6 * k, 6 * k + 6) for k in range(links)):
        C[own, own] = rotated_compliance(C[own, own], rng.standard_normal(3), WRONG_ROTATION)
    return C


def _far(rng: np.random.Generator) -> float:
    return WRONG_FACTOR if rng.random() < 0.5 else 1 / WRONG_FACTOR


UNPERTURBED = "right"
PRIORS: Mapping[str, Wrong] = {
    UNPERTURBED: Wrong(lambda C, *_: C, "the folder's compliances"),
    "scaled": Wrong(
        lambda C, *_: C,
        f"compliances too large by a factor of {SCALE:g}, and their ratios between axes off by "
        f"{100 * SHAPE:.0f} %, like all priors below",
    ),
    "link": Wrong(_one_link, f"one link {WRONG_FACTOR:g} times too soft or too stiff", far="link"),
    "joints": Wrong(_joints, f"all joints {WRONG_FACTOR:g} times too soft or too stiff", far="joints"),
    "axes": Wrong(_axes, f"beam axes of every link turned by {np.rad2deg(WRONG_ROTATION):.0f} degrees"),
    "uncoupled": Wrong(lambda C, *_: np.diag(np.diag(C)), "no couplings inside a link"),
}
"""By name what is wrong with a prior; all but the right one are SCALE and SHAPE wrong before."""
