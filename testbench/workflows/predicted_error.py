"""The errors that a plan promises: on arms of which every link and joint gives, whatever is identified.

Laws of joints that a plan's readings do not determine, and further readings that would.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from scipy.linalg import block_diag

from testbench.design.forecast import DEVIATION_INFLATION, Forecast, LinearFit, fit_error, linear_fit
from testbench.design.planning import Plan
from testbench.design.rows import SCALE_UNCERTAINTY, PlanSpecification, deflection_rows, select_loads
from testbench.errors import Array, Ids, Mask
from testbench.identify.posterior import CONFIDENCE
from testbench.identify.prior import Prior, PriorUncertainty, cad_prior, prior_rows, scale_by_prior
from testbench.model.laws import add_joint_laws, add_law_parameters, set_load_history
from testbench.model.load import Load, sum_generalised_loads
from testbench.model.structure import Structure, all153
from testbench.model.vjm import Vjm, evaluate_chain, tool_poses
from testbench.runs.rows import Row, finite
from testbench.workflows.cell import Cell
from testbench.workflows.error_places import (
    ErrorMeaning,
    ErrorPlaces,
    error_places,
    places_at,
    rms,
)
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import JOINTS_ONLY, arm_model_name, named_models
from testbench.workflows.plan_settings import pull_words
from testbench.workflows.rows import MM

DEFAULT_UNCERTAINTY = 0.3  #: How well an arm's compliances are known where no prior is given [1].
EXPECTED = ErrorMeaning(
    "expected error",
    "of the predicted deflection, RMS over the markers and over arms whose links and joints all bend",
    "RMS",
)
OTHER_MODELS = "MLS56", JOINTS_ONLY
"""Kinds of models that stand beside: least squares of links, and joints alone."""
OPEN_ERROR_SHARE = 0.1  #: Share of the expected error that has to stay open for such joints to be told [1].
ZERO_TORQUE = 1e-6  #: Share of the largest torque below which a joint is not turned [1].


@dataclass(frozen=True)
class Expected:
    """Hold the RMS error to expect over several poses, with its 90 % interval [mm]."""

    expected: float
    p05: float
    p95: float


def forecast_summary(forecast: Forecast) -> Expected:
    """Summarise what a forecast says of all poses together."""
    return Expected(
        MM * forecast.overall_rms_error,
        MM * forecast.overall_percentile_5,
        MM * forecast.overall_percentile_95,
    )


def prior_uncertainty(spec: PlanSpecification) -> float:
    """Return the relative uncertainty of the arm's compliances; a default without a prior [1]."""
    return DEFAULT_UNCERTAINTY if spec.prior_uncertainty is None else spec.prior_uncertainty


def linear_fit_after(
    spec: PlanSpecification, prior: Prior, whitened_rows: Callable[[PlanSpecification], Array]
) -> LinearFit:
    """Fit a plan's model, as a linear function of its readings, to an arm whose links and joints all yield.

    Args:
        spec: What the plan is made for.
        prior: The prior.
        whitened_rows: Function that gives whitened rows of the readings, such as `Plan.whitened_rows`.

    Returns:
        The fit.
    """
    every = spec.setup
    whole = replace(every, scaling=scale_by_prior(prior, every.vjm, all153(every.vjm.arm)))
    return linear_fit(whole, prior_uncertainty(spec), spec, whitened_rows)


def least_squares(spec: PlanSpecification, prior: Prior, structure: Structure) -> PlanSpecification:
    """Specify the same measurements to identify a structure by least squares.

    Args:
        spec: What the plan is made for.
        prior: Prior that only sets units.
        structure: The unknowns.

    Returns:
        The specification.
    """
    every = spec.setup
    scaling = scale_by_prior(prior, every.vjm, structure)
    return replace(spec, setup=replace(every, scaling=scaling), prior_uncertainty=None)


def half_widths(forecast: Forecast) -> Array:
    """Compute half widths of 95 % intervals of every target's deflection, (poses, 3 m) [m]."""
    return np.asarray(
        NormalDist().inv_cdf((1 + CONFIDENCE) / 2) * DEVIATION_INFLATION * forecast.axis_deviation
    )


def error_map(cell: Cell, plan: Plan, forecast: Forecast) -> ErrorPlaces:
    """Forecast the error of the planned model and of `OTHER_MODELS`, pose by pose over the workspace.

    GCO without a prior is no linear fit: it is not foretold.

    Args:
        cell: The arm with its model and its truth.
        plan: The plan.
        forecast: Forecast of the planned model.

    Returns:
        The errors by place.
    """
    spec, prior = plan.specification, cad_prior(cell.arm)
    q, load = spec.workspace_poses, spec.loads[0]
    name = spec.setup.scaling.structure.name + (FILLED if spec.prior_uncertainty is not None else "")
    found = {}
    for other in (arm_model_name(cell, kind) for kind in OTHER_MODELS):
        if other is None or other == name:
            continue
        [model] = named_models(cell, [other])
        fit = linear_fit_after(least_squares(spec, prior, model.structure), prior, plan.whitened_rows)
        found[other] = MM * fit_error(fit, q, load)
    found[name] = MM * forecast.rms_error
    moved = rms(deflection_rows(spec.setup, q, load) @ spec.setup.scaling.expected_x)
    workspace_poses = places_at(cell.arm, q, tool_poses(cell.vjm, q)[0], moved)
    return error_places(workspace_poses, found, list(found), EXPECTED)


def unobservable_joints(plan: Plan, share: float) -> Row | None:
    """Find joints whose compliances no load of a plan can show though the tasks need them.

    The pull is along the world's axis that turns them most in the plan's poses, about as strong as the first
    load. `share` of the expected error at the tasks stays open, whatever is measured [1].

    Args:
        plan: The plan.
        share: Share of the expected error at the tasks that stays open, whatever is measured [1].

    Returns:
        `joints` that only the tasks' loads turn, not the plan's, and a force `pull_N` that turns some of
        them, `turned_by_pull`; None where all are shown.
    """
    if share <= OPEN_ERROR_SHARE:
        return None
    spec, examined = plan.specification, plan.candidates
    vjm, tasks = spec.setup.vjm, spec.tasks
    needed = _turned(_torques(vjm, tasks.q, tasks.load))
    shown = _turned(_torques(vjm, examined.q, select_loads(spec, examined.load_index)))
    closed = np.flatnonzero(needed & ~shown)
    if not len(closed):
        return None
    names, (able, best) = [joint.name for joint in vjm.arm.joints], _pull(plan, closed)
    force = None if best is None else best.wrench[:3].tolist()
    return Row(joints=[names[k] for k in closed], turned_by_pull=[names[k] for k in able], pull_N=force)


def unloaded_joints(plan: Plan, prior: Prior) -> Row | None:
    """Find joints that no load turns in any pose of a plan, and what that costs.

    Args:
        plan: Poses and loads, and the tasks.
        prior: Compliances of the arm's folder.

    Returns:
        `joints` that no load turns; `force_N` that does, about as strong as the first load, None where no
        force turns them; `error_mm` to expect at the tasks under it, RMS, None without a bound. None where
        all are turned.
    """
    spec = plan.specification
    vjm, names = spec.setup.vjm, [joint.name for joint in spec.setup.vjm.arm.joints]
    closed = np.flatnonzero(~_turned(_torques(vjm, plan.q, select_loads(spec, plan.load_index))))
    if not len(closed):
        return None
    row = Row(joints=[names[k] for k in closed], force_N=None, error_mm=None)
    _, pull = _pull(plan, closed)
    if pull is None:
        return row
    error = fit_error(linear_fit_after(spec, prior, plan.whitened_rows), spec.tasks.q, pull)
    mm = finite(MM * np.sqrt(np.square(error).mean()))
    return Row(row, force_N=pull.wrench[:3].tolist(), error_mm=mm)


def _pull(plan: Plan, closed: Ids) -> tuple[Ids, Load | None]:
    """Which of some joints forces along the world's axes turn; the one that turns them most, if any."""
    spec = plan.specification
    vjm = spec.setup.vjm
    size = round_to_first_digit(float(np.linalg.norm(spec.loads[0].wrench[:3])))
    pulls = [Load(np.append(force, np.zeros(3)), vjm.load_point) for force in size * np.eye(3)]
    torques = np.stack([_torques(vjm, plan.q, pull) for pull in pulls])  # (3, n, poses)
    able = closed[_turned(torques.transpose(1, 0, 2).reshape(vjm.arm.n_joints, -1))[closed]]
    if not len(able):
        return able, None
    return able, pulls[int((torques[:, able] ** 2).mean(axis=2).min(axis=1).argmax())]


def _torques(vjm: Vjm, q: Array, load: Load) -> Array:
    """Torques of the joints, forces of slides, under a load, (n, poses) [N m, N]."""
    u = sum_generalised_loads(evaluate_chain(vjm, q), [load.for_poses(len(q))])
    return np.asarray(u[-vjm.arm.n_joints :])


def _turned(torques: Array) -> Mask:
    """Which joints are turned in any of the poses, (n,)."""
    most = np.abs(torques).max(axis=1)
    return np.asarray(most > ZERO_TORQUE * most.max())


def round_to_first_digit(value: float) -> float:
    """Round a number above 0 down to its first digit."""
    step: float = 10.0 ** math.floor(math.log10(value))
    return step * math.floor(value / step)


OPEN_VARIANCE_SHARE = 0.5  #: Share of the variance of a law's size beyond which readings do not tell it [1].
SECOND_LOAD_SHARE = 0.4  #: Weight of a second load over the first [1].
UNLOADED_AFTER = "an unloaded reading after the load was taken off (a row with loading off)"


def open_laws(plan: Plan, prior: Prior) -> list[Row]:
    """List the joint laws (backlash, friction, stiffening) that a plan's readings do not determine.

    A law counts as undetermined if more than `OPEN_VARIANCE_SHARE` of its variance remains.

    Sizes are uncertain by one before, compliances as the plan has them. None where links are not all
    identified with a prior: then joints are linear.

    Args:
        plan: The plan.
        prior: The prior.

    Returns:
        A row for each law: its `kind`, the `joints` of which it is open, a reading that would help, `by`, in
        words or None, the joints of which that reading tells it, `told`, and those of which none does,
        `never`.
    """
    spec, vjm = plan.specification, plan.specification.setup.vjm
    plain = all153(vjm.arm)
    linear = spec.setup.scaling.structure.n_parameters < plain.n_parameters or not vjm.arm.joints
    if spec.prior_uncertainty is None or linear:
        return []
    whole = scale_by_prior(prior, add_joint_laws(vjm), add_law_parameters(plain, vjm.arm))
    B, _ = prior_rows(
        scale_by_prior(prior, vjm, plain), PriorUncertainty(prior_uncertainty(spec), SCALE_UNCERTAINTY)
    )
    specification = replace(spec, setup=replace(spec.setup, vjm=add_joint_laws(vjm), scaling=whole))
    M = block_diag(B.T @ B, np.eye(whole.structure.n_laws)) + _information(specification, plan)
    stays = _open(M, plain.n_parameters)
    tells = {
        words: stays & ~_open(M + _information(s, plan), plain.n_parameters)
        for words, s in further_readings(specification, plan).items()
    }
    kinds: dict[str, dict[str, int]] = {}
    for k in np.flatnonzero(stays).tolist():
        joint, _, kind = whole.structure.row_labels[whole.structure.n_compliance_rows + k].rpartition(" ")
        kinds.setdefault(kind, {})[joint] = k
    return [_open_law(kind, places, tells) for kind, places in kinds.items()]


def _open_law(kind: str, places: dict[str, int], tells: dict[str, Mask]) -> Row:
    """A law that is open of some joints, by their places among all laws, and what tells it."""
    told = {words: [joint for joint, k in places.items() if some[k]] for words, some in tells.items()}
    by = max(told, key=lambda words: len(told[words]))
    never = [joint for joint in places if not any(joint in some for some in told.values())]
    words = by if told[by] else None
    return Row(kind=kind, joints=list(places), by=words, told=told[by], never=never)


def further_readings(spec: PlanSpecification, plan: Plan) -> dict[str, PlanSpecification]:
    """List what may be read once more in every pose, the easiest first.

    Args:
        spec: What the plan is made for.
        plan: The plan.

    Returns:
        Specifications by their words.
    """
    vjm = spec.setup.vjm
    at = spec.setup.vjm.load_point
    every = len(spec.loads)
    back = replace(spec.setup, vjm=set_load_history(vjm, np.ones(len(plan.q), dtype=bool)))
    lighter = tuple(Load(SECOND_LOAD_SHARE * load.wrench, load.point) for load in spec.loads)
    pulls = round_to_first_digit(float(np.linalg.norm(spec.loads[0].wrench[:3]))) * np.eye(3)
    return {
        "the same readings again": spec,
        UNLOADED_AFTER: replace(spec, setup=back),
        f"a second load ({SECOND_LOAD_SHARE:g} of the first)": replace(spec, loads=lighter),
        **{
            f"a {pull_words(own)}": replace(spec, loads=(Load(np.append(own, np.zeros(3)), at),) * every)
            for own in pulls.tolist()
        },
    }


def _information(spec: PlanSpecification, plan: Plan) -> Array:
    """What the plan's poses tell of all unknowns, (n, n)."""
    A = plan.whitened_rows(spec).reshape(-1, spec.setup.scaling.structure.n_parameters)
    return np.asarray(A.T @ A)


def _open(M: Array, plain: int) -> Mask:
    """Which laws information leaves open, those behind so many plain unknowns, (laws,)."""
    return np.asarray(np.diag(np.linalg.inv(M))[plain:] > OPEN_VARIANCE_SHARE)
