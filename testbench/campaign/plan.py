"""The composer of a plan: what an engineer asks for becomes candidates, poses, and what they promise."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell, stream
from testbench.campaign.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.campaign.plan_input import Place
from testbench.campaign.plan_settings import PlanSettings, structure
from testbench.campaign.predicted_error import fitted
from testbench.campaign.rows import UM
from testbench.data.columns import Columns, find_columns, joint_coordinates, vector
from testbench.data.mapping import read_map
from testbench.data.station import Station
from testbench.data.table import read_table
from testbench.design.forecast import Forecast, open_to, widened, without_bound
from testbench.design.observability import observability
from testbench.design.planning import Chosen, Plan, candidate_set, make_plan
from testbench.design.refine import Reach
from testbench.design.rows import Experiment
from testbench.design.specification import Specification, Tasks, loads_of, task_rows, workspace_rows
from testbench.design.whole_arm import promise_on
from testbench.errors import Array, BenchError, InputError, check_array
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.load import Load
from testbench.plant import build_site, collisions, contacts

WORKSPACE = 200  #: Poses that stand for the workspace.
STEP, SLIDE_STEP = math.radians(5), 0.02
"""Largest steps of a hinge [rad] and a slide [m] between collision checks on the way from pose to pose."""
NAMED = 5  #: Tasks that a message names; more are counted.
MAX_TASKS = 1000


@dataclass(frozen=True)
class Planned:
    """A plan and what it promises."""

    cell: Cell  #: The arm.
    settings: PlanSettings  #: What was asked for.
    found: Candidates  #: Feasible poses, and what it took to find them.
    plan: Chosen  #: The poses, in the order of measuring; `Plan` where they are for tasks.
    poses: Forecast  #: Errors to expect in them [m].
    forecast: Forecast  #: At the tasks; of absolute readings over the workspace [m].
    workspace: Forecast  #: Over the workspace, under the first load [m].


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
        The poses in the order of measuring, `.plan.q`, and the errors to expect at the tasks, `.forecast`.

    Raises:
        BenchError: When a number is out of range, or too little is measured without a prior.
        PoseError: When there are fewer feasible poses than the plan needs.
    """
    if settings.absolute:
        raise BenchError("absolute: expected a plan for tasks")
    q = check_array(q, (None, cell.arm.n_joints), "tasks q [rad, m]")
    return plan_for(cell, settings, Tasks(q, hung(cell, settings.loads_kg[0])))


def plan_for(cell: Cell, settings: PlanSettings, tasks: Tasks) -> Planned:
    """The same of tasks with loads of their own."""
    found = search(cell, settings)
    best = choose(cell, settings, tasks, found)
    spec = best.specification
    indices = observability(best.examined.problem, best.chosen)
    if spec.uncertainty is None and indices.seen < indices.of:
        raise BenchError(
            f"poses: {settings.poses} poses see {indices.seen} of the {indices.of} directions that these "
            "loads can show; give more --poses, or leave out --no-prior"
        )
    fit = fitted(spec, cad_prior(cell.arm), best.q, best.load)
    poses, forecast, around = (
        widened(promise_on(fit, at, load))
        for at, load in (
            (best.q, loads_of(spec, best.load)),
            (tasks.q, tasks.load),
            (spec.workspace, spec.loads[0]),
        )
    )
    around = without_bound(around, open_to(best.examined.problem, workspace_rows(spec)))
    return Planned(cell, settings, found, best, poses, forecast, around)


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


def around(cell: Cell, settings: PlanSettings) -> Array:
    """Poses that stand for the workspace, (poses, n) [rad, m]; PoseError where the arm can be nowhere."""
    checks = build_checks(cell, Conditions(settings.area))
    return find(checks, WORKSPACE, stream(settings.seed, 2), least=1).q


def reach_of(cell: Cell, settings: PlanSettings) -> Reach:
    """Where the arm can go."""
    checks = build_checks(cell, settings.conditions)
    return Reach(lambda q: feasible(checks, q), straight_way(cell, settings.station))


def choose(cell: Cell, settings: PlanSettings, tasks: Tasks, found: Candidates) -> Plan:
    """The best plan found; BenchError where without a prior poses are too few or loads show too little."""
    own = metric(cad_prior(cell.arm), cell.vjm, structure(cell, settings.model))
    percent = settings.uncertainty_percent
    loads = [hung(cell, mass) for mass in settings.loads_kg]
    spec = Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, settings.sigma_um / UM),
        loads=(*loads, *(pulled(cell, force) for force in settings.pulls_n)),
        tasks=tasks,
        workspace=around(cell, settings),
        uncertainty=None if percent is None else percent / 100,
        poses=settings.poses,
    )
    if spec.uncertainty is None:
        _check_without_prior(spec, found.q)
    rng = stream(settings.seed, 1)
    return make_plan(spec, settings.criterion, found.q, reach_of(cell, settings), rng)


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


def read_tasks(path: Path, cell: Cell, hung: Load, mapping: Path | None = None) -> Tasks:
    """Read tasks, one pose a row, and check that the arm can take them.

    Columns: JOINT_rad or JOINT_deg of every joint, of a slide JOINT_m or JOINT_mm. force_*_N and moment_*_Nm
    (optional): load of the process, world axes. point_*_m (optional with them): where it acts, in the tool's
    frame; the arm's load point if not given.

    Tasks without such columns have the load `hung`. A map says how the file names the columns otherwise.

    Raises:
        InputError: Names line, joint or bodies, and what was expected.
    """
    names = read_map(mapping, cell.arm)
    table = read_table(path, lambda name: names.find(name) is not None, names.layout)
    columns = find_columns(table, names, cell.arm)
    q = joint_coordinates(columns, cell.arm)
    if not 1 <= table.rows <= MAX_TASKS:
        raise table.error(
            min(table.rows, MAX_TASKS), "", f"expected 1 to {MAX_TASKS} tasks, got {table.rows}"
        )
    for line, pair in zip(table.lines.tolist(), collisions(cell.room, q), strict=True):
        if pair:
            raise InputError(path, f"line {line}", f"{pair[0]} collides with {pair[1]} in this pose")
    return Tasks(q, _read_load(columns, hung))


def _read_load(columns: Columns, hung: Load) -> Load:
    """The load of every task."""
    table = columns.table
    force, moment, point = (vector(columns, what) for what in ("force", "moment", "point"))
    if force is None and moment is None:
        if point is None:
            return hung
        raise InputError(
            table.path,
            f"line {table.header}",
            "expected force_x_N, force_y_N, force_z_N where point_x_m, point_y_m, point_z_m are given",
        )
    none = np.zeros((table.rows, 3))
    wrench = np.hstack([none if part is None else part for part in (force, moment)])
    idle = np.flatnonzero(~wrench.any(axis=1))
    if len(idle):
        raise table.error(idle[0], "", "expected a load, got zero force and moment")
    return Load(wrench, np.tile(hung.point, (table.rows, 1)) if point is None else point)
