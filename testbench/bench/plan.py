"""The composer of a plan: what an engineer asks for becomes candidates, poses, and what they promise."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import Cell, stream
from testbench.bench.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.bench.plan_promise import fitted
from testbench.bench.plan_report import PlanReport
from testbench.bench.plan_settings import Place, PlanSettings, structure
from testbench.bench.plan_summary import summary
from testbench.bench.rows import UM
from testbench.data.station import Station
from testbench.design.forecast import Forecast, open_to, widened, without_bound
from testbench.design.planning import Plan, candidate_set, make_plan
from testbench.design.refine import Reach
from testbench.design.rows import Experiment
from testbench.design.specification import Specification, Tasks, task_rows, workspace_rows
from testbench.design.whole_arm import promise_on
from testbench.errors import Array, BenchError, check_array
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.load import Load
from testbench.plant import build_site, contacts

WORKSPACE = 200  #: Poses that stand for the workspace.
STEP, SLIDE_STEP = math.radians(5), 0.02
"""Largest steps of a hinge [rad] and a slide [m] between collision checks on the way from pose to pose."""
NAMED = 5  #: Tasks that a message names; more are counted.


@dataclass(frozen=True)
class Planned:
    """A plan and what it promises."""

    found: Candidates  #: Feasible poses, and what it took to find them.
    plan: Plan  #: The poses, in the order of measuring.
    workspace: Forecast  #: Errors over the specification's workspace, under the first load.
    report: PlanReport  #: What was asked for, and what readers see.


def hung(cell: Cell, mass: float) -> Load:
    """A mass that hangs from the arm's load point [kg]."""
    return Load(np.array([0, 0, -GRAVITY * mass, 0, 0, 0]), cell.vjm.load)


def pulled(cell: Cell, force: Place) -> Load:
    """A force that pulls at the arm's load point, world axes [N]."""
    return Load(np.array([*force, 0, 0, 0]), cell.vjm.load)


def plan(cell: Cell, q: Array, settings: PlanSettings) -> Planned:
    """Plan a calibration: the poses that tell most about the tasks, and what they promise.

    Args:
        cell: The arm.
        q: Poses in which the robot works under the first of the loads, (tasks, n) [rad, m].
        settings: What is asked for, such as PlanSettings(loads_kg=(460.3,), poses=12).

    Returns:
        The poses in the order of measuring, `.plan.q`, and what readers see, `.report`.

    Raises:
        BenchError: When a number is out of range, or too little is measured without a prior.
        PoseError: When there are fewer feasible poses than the plan needs.
    """
    q = check_array(q, (None, cell.arm.n_joints), "tasks q [rad, m]")
    tasks, found = Tasks(q, hung(cell, settings.loads_kg[0])), search(cell, settings)
    return judge(cell, settings, found, choose(cell, settings, tasks, found))


def search(cell: Cell, settings: PlanSettings) -> Candidates:
    """Feasible poses.

    Raises:
        PoseError: When there are fewer than the plan needs; says which condition refused them.
        BenchError: When the tracker stands inside the arm, or the sling is too short.
    """
    checks, rng = build_checks(cell, settings.conditions), stream(settings.seed, 0)
    found = find(checks, settings.candidates_wanted, rng, least=settings.poses)
    return replace(found, q=nearest_turn(found.q, cell.arm))


def nearest_turn(q: Array, arm: Arm) -> Array:
    """Poses (poses, n) [rad, m] with every hinge in the turn nearest to zero that its limits allow.

    A joint that can turn about itself more than once reaches a pose at several angles; nearest to zero the
    ways from pose to pose are short, and cables are not wound up.
    """
    near, hinge = q - 2 * np.pi * np.round(q / (2 * np.pi)), [not joint.prismatic for joint in arm.joints]
    lower, upper = arm.limits
    return np.where(hinge & (near >= lower) & (near <= upper), near, q)


def specify(cell: Cell, settings: PlanSettings, tasks: Tasks) -> Specification:
    """The settings as the design of experiments wants them; PoseError where the arm can be nowhere."""
    own = metric(cad_prior(cell.arm), cell.vjm, structure(cell, settings.model))
    percent = settings.uncertainty_percent
    checks = build_checks(cell, Conditions(settings.area))
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, settings.sigma_um / UM),
        loads=(
            *(hung(cell, mass) for mass in settings.loads_kg),
            *(pulled(cell, force) for force in settings.pulls_n),
        ),
        tasks=tasks,
        workspace=find(checks, WORKSPACE, stream(settings.seed, 2), least=1).q,
        uncertainty=None if percent is None else percent / 100,
        poses=settings.poses,
    )


def choose(cell: Cell, settings: PlanSettings, tasks: Tasks, found: Candidates) -> Plan:
    """The best plan found; BenchError where without a prior poses are too few or loads show too little."""
    spec = specify(cell, settings, tasks)
    if spec.uncertainty is None:
        _check_without_prior(spec, found.q)
    checks = build_checks(cell, settings.conditions)
    reach = Reach(lambda q: feasible(checks, q), straight_way(cell, settings.station))
    return make_plan(spec, settings.criterion, found.q, reach, stream(settings.seed, 1))


def judge(cell: Cell, settings: PlanSettings, found: Candidates, plan: Plan) -> Planned:
    """What a plan promises, beside others; BenchError where without a prior it leaves directions open."""
    workspace = _around(cell, plan)
    report = summary(cell, settings, found, plan, workspace)
    indices = report.observability
    if settings.uncertainty_percent is None and indices.seen < indices.of:
        raise BenchError(
            f"poses: {settings.poses} poses see {indices.seen} of the {indices.of} directions that these "
            "loads can show; give more --poses, or leave out --no-prior"
        )
    return Planned(found, plan, workspace, report)


def _around(cell: Cell, plan: Plan) -> Forecast:
    """Errors over the workspace under the first load; infinite where the plan's loads leave them open."""
    spec = plan.specification
    fit = fitted(spec, cad_prior(cell.arm), plan.q, plan.load)
    found = widened(promise_on(fit, spec.workspace, spec.loads[0]))
    return without_bound(found, open_to(plan.examined.problem, workspace_rows(spec)))


def straight_way(cell: Cell, station: Station | None) -> Callable[[Array, Array], bool]:
    """Tells whether all joints can go straight from pose to pose, nothing hung, the tracker in the way."""
    site = build_site(cell.arm, None, None if station is None else station.position, cell.floor)
    step = np.array([SLIDE_STEP if joint.prismatic else STEP for joint in cell.arm.joints])

    def clear(start: Array, end: Array) -> bool:
        steps = max(1, math.ceil(float((np.abs(end - start) / step).max(initial=0.0))))
        share = np.arange(1, steps)[:, None] / steps
        return all(contact is None for contact in contacts(site, start + share * (end - start)))

    return clear


def _check_without_prior(spec: Specification, q: Array) -> None:
    """Refuse what only a prior could fill, before the search begins."""
    try:
        problem = candidate_set(spec, q).problem
    except BenchError as err:
        raise BenchError(f"{err}: leave out --no-prior") from err
    rows = task_rows(spec)
    if numbers := (np.flatnonzero(open_to(problem, rows)) + 1).tolist():
        named = ", ".join(map(str, numbers[:NAMED])) + (", ..." if len(numbers) > NAMED else "")
        raise BenchError(
            f"tasks {named} ({len(numbers)} of {len(rows)}): their loads move the arm in directions that "
            "these loads cannot show, so that the error has no bound; needed is a prior (leave out "
            "--no-prior) or a load in another direction (--pull)"
        )
