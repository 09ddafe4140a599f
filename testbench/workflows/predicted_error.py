"""The errors that a plan promises: on arms of which every link and joint gives, whatever is identified."""

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from testbench.design.forecast import BROAD, Forecast
from testbench.design.planning import Plan
from testbench.design.rows import Specification, deflection_rows, loads_of
from testbench.design.whole_arm import LinearFit, error_on, fit_of
from testbench.errors import Array, Ids, Mask
from testbench.identify.metric import scale_by_prior
from testbench.identify.posterior import CONFIDENCE
from testbench.identify.prior import Prior, cad_prior
from testbench.model.load import Load, on_joints
from testbench.model.structure import Structure, all153, joints_only
from testbench.model.vjm import Vjm, chain, tool_pose
from testbench.workflows.cell import Cell
from testbench.workflows.model_selection import FILLED
from testbench.workflows.models import JOINTS, arm_model_name, named_models
from testbench.workflows.rows import MM
from testbench.workflows.workspace_errors import (
    ErrorPlaces,
    Meaning,
    bounded_mm,
    error_places,
    places_at,
    rms,
)

UNKNOWN = 0.3  #: How well an arm's compliances are known where no prior is given [1].
EXPECTED = Meaning(
    "expected error",
    "of the predicted deflection, RMS over the markers and over arms of which every link and joint gives",
    "RMS",
)
OTHERS = ("MLS56", JOINTS)  #: Kinds of models that stand beside: least squares of links, and joints alone.
OPEN_ERROR_SHARE = 0.1  #: Share of the expected error that has to stay open for such joints to be told [1].
ZERO_TORQUE = 1e-6  #: Share of the largest torque below which a joint is not turned [1].


@dataclass(frozen=True)
class Expected:
    """Root mean square error to expect over several poses, with its 90 % interval [mm]."""

    expected: float
    p05: float
    p95: float


def forecast_summary(forecast: Forecast) -> Expected:
    """What a forecast says of all poses together."""
    return Expected(MM * forecast.overall, MM * forecast.overall_low, MM * forecast.overall_high)


def prior_uncertainty(spec: Specification) -> float:
    """How well the arm's compliances are known, relative [1]."""
    return UNKNOWN if spec.uncertainty is None else spec.uncertainty


def linear_fit_after(spec: Specification, prior: Prior, q: Array, load: Ids) -> LinearFit:
    """A specification's model after poses (poses, n) [rad, m] were measured, each under its load (poses,)."""
    every = spec.experiment
    whole = replace(every, scaling=scale_by_prior(prior, every.vjm, all153(every.vjm.arm)))
    return fit_of(whole, prior_uncertainty(spec), spec, q, load)


def joints_alone(spec: Specification, prior: Prior) -> Specification:
    """The same measured to identify joint compliances alone, by least squares."""
    return least_squares(spec, prior, joints_only(spec.experiment.vjm.arm))


def least_squares(spec: Specification, prior: Prior, structure: Structure) -> Specification:
    """The same measured to identify a structure by least squares; the prior only sets its units."""
    every = spec.experiment
    scaling = scale_by_prior(prior, every.vjm, structure)
    return replace(spec, experiment=replace(every, scaling=scaling), uncertainty=None)


def half_widths(forecast: Forecast) -> Array:
    """Of the 95 % interval of every target's deflection along every axis, (poses, 3 m) [m]."""
    return np.asarray(NormalDist().inv_cdf((1 + CONFIDENCE) / 2) * BROAD * forecast.deviation)


def error_map(cell: Cell, plan: Plan, forecast: Forecast) -> ErrorPlaces:
    """Errors over the workspace under the first load, by the planned model its `forecast`, and by `OTHERS`.

    GCO without a prior is no linear fit: it is not foretold.
    """
    spec, prior = plan.specification, cad_prior(cell.arm)
    q, load = spec.workspace, spec.loads[0]
    name = spec.experiment.scaling.structure.name + (FILLED if spec.uncertainty is not None else "")
    found = {}
    for other in (arm_model_name(cell, kind) for kind in OTHERS):
        if other is None or other == name:
            continue
        [model] = named_models(cell, [other])
        fit = linear_fit_after(least_squares(spec, prior, model.structure), prior, plan.q, plan.load)
        found[other] = bounded_mm(error_on(fit, q, load))
    found[name] = bounded_mm(forecast.error)
    moved = rms(deflection_rows(spec.experiment, q, load) @ spec.experiment.scaling.expected)
    workspace_poses = places_at(cell.arm, q, tool_pose(cell.vjm, q)[0], moved)
    return error_places(workspace_poses, found, list(found), EXPECTED)


@dataclass(frozen=True)
class Unshown:
    """Joints that the tasks turn and no load of the plan does; the pull, if any, that turns some of them."""

    joints: list[str]
    turned_by_pull: list[str]
    pull_N: list[float] | None


def unobservable_joints(plan: Plan, share: float) -> Unshown | None:
    """Which joints' compliances no load of a plan can show though the tasks need them; None where all are.

    The pull is along the world's axis that turns them most in the plan's poses, about as strong as the first
    load. `share` of the expected error at the tasks stays open, whatever is measured [1].
    """
    if share <= OPEN_ERROR_SHARE:
        return None
    spec, examined = plan.specification, plan.examined
    vjm, tasks = spec.experiment.vjm, spec.tasks
    needed = _turned(_torques(vjm, tasks.q, tasks.load))
    shown = _turned(_torques(vjm, examined.q, loads_of(spec, examined.load)))
    closed = np.flatnonzero(needed & ~shown)
    if not len(closed):
        return None
    names, (able, best) = [joint.name for joint in vjm.arm.joints], _pull(plan, closed)
    force = None if best is None else best.wrench[:3].tolist()
    return Unshown([names[k] for k in closed], [names[k] for k in able], force)


@dataclass(frozen=True)
class Unloaded:
    """Joints that no load of a plan turns, a force that does, and how well its deflection is predicted."""

    joints: list[str]
    force_N: list[float] | None  #: About as strong as the first load; None where no force turns them.
    error_mm: float | None  #: Expected at the tasks under that force, RMS; None without a bound [mm].


def unloaded_joints(plan: Plan, prior: Prior) -> Unloaded | None:
    """Which joints no load turns in any pose of a plan, and what that costs; None where all are turned.

    Args:
        plan: Poses and loads, and the tasks.
        prior: Compliances of the arm's folder.
    """
    spec = plan.specification
    vjm, names = spec.experiment.vjm, [joint.name for joint in spec.experiment.vjm.arm.joints]
    closed = np.flatnonzero(~_turned(_torques(vjm, plan.q, loads_of(spec, plan.load))))
    if not len(closed):
        return None
    _, pull = _pull(plan, closed)
    if pull is None:
        return Unloaded([names[k] for k in closed], None, None)
    error = error_on(linear_fit_after(spec, prior, plan.q, plan.load), spec.tasks.q, pull)
    mm = float(MM * np.sqrt(np.square(error).mean()))
    return Unloaded([names[k] for k in closed], pull.wrench[:3].tolist(), mm if math.isfinite(mm) else None)


def _pull(plan: Plan, closed: Ids) -> tuple[Ids, Load | None]:
    """Which of some joints forces along the world's axes turn; the one that turns them most, if any."""
    spec = plan.specification
    vjm = spec.experiment.vjm
    size = first_digit(float(np.linalg.norm(spec.loads[0].wrench[:3])))
    pulls = [Load(np.append(force, np.zeros(3)), vjm.load) for force in size * np.eye(3)]
    torques = np.stack([_torques(vjm, plan.q, pull) for pull in pulls])  # (3, n, poses)
    able = closed[_turned(torques.transpose(1, 0, 2).reshape(vjm.arm.n_joints, -1))[closed]]
    if not len(able):
        return able, None
    return able, pulls[int((torques[:, able] ** 2).mean(axis=2).min(axis=1).argmax())]


def _torques(vjm: Vjm, q: Array, load: Load) -> Array:
    """Torques of the joints, forces of slides, under a load, (n, poses) [N m, N]."""
    u = on_joints(chain(vjm, q), [load.over(len(q))])
    return np.asarray(u[-vjm.arm.n_joints :])


def _turned(torques: Array) -> Mask:
    """Which joints are turned in any of the poses, (n,)."""
    most = np.abs(torques).max(axis=1)
    return np.asarray(most > ZERO_TORQUE * most.max())


def first_digit(value: float) -> float:
    """A number above 0, all but its first digit left out."""
    step: float = 10.0 ** math.floor(math.log10(value))
    return step * math.floor(value / step)
