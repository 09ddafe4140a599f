"""From a plan to its report: what it promises, its certificate, and the plans beside it."""

import math
from dataclasses import replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.bench import plan_report as r
from testbench.bench.campaign import Cell, stream
from testbench.bench.candidates import Candidates
from testbench.bench.plan_map import plan_map
from testbench.bench.plan_promise import fitted, half_width, joints_alone, within
from testbench.bench.plan_settings import PlanSettings
from testbench.bench.plan_unshown import unshown
from testbench.bench.rows import MM
from testbench.design.baselines import (
    RANDOM,
    Baselines,
    PriorInfluence,
    baselines,
    prior_influence,
)
from testbench.design.forecast import Forecast, widened
from testbench.design.observability import observability
from testbench.design.planning import Plan, promise, seen_at_most
from testbench.design.rows import deflection_rows
from testbench.design.specification import Specification, loads_of, task_rows
from testbench.design.whole_arm import Fitted, promise_on
from testbench.errors import Array
from testbench.identify.prior import cad_prior
from testbench.model.structure import all153
from testbench.model.vjm import Vjm, chain
from testbench.plant import has_surroundings

TARGET = 0.1  #: Error for which the fewest poses are told [mm].
MORE, LITTLE = 4, 0.10  #: So many more poses that bring less than this share are not worth their time.


def summary(
    cell: Cell, settings: PlanSettings, found: Candidates, plan: Plan, workspace: Forecast
) -> r.PlanReport:
    """The report of a plan."""
    spec, rows = plan.specification, task_rows(plan.specification)
    moved = rows @ spec.experiment.metric.expected
    influence = prior_influence(plan, rows)
    drawn, rng = len(found.q) * len(spec.loads), stream(settings.seed, 3)
    others = baselines(plan, rows, drawn=drawn, rng=rng)
    ahead, prior = spec.tasks, cad_prior(cell.arm)
    fit, joints = (fitted(own, prior, plan.q, plan.load) for own in (spec, joints_alone(spec, prior)))
    tasks = widened(promise_on(fit, ahead.q, ahead.load))
    indices = observability(plan.examined.problem, plan.chosen)
    own = others.random[settings.poses]
    return r.PlanReport(
        **vars(settings) | {"model": spec.experiment.metric.structure.name},
        whole_arm=spec.experiment.metric.structure.n == all153(cell.arm).n,
        arm=cell.arm.name,
        base_m=cell.vjm.base[:3, 3].tolist(),
        joints=[joint.name for joint in cell.arm.joints],
        units=[joint.shown_unit for joint in cell.arm.joints],
        margins=margins(cell.arm, plan.q),
        surrounded=has_surroundings(cell.room),
        prior=None if spec.uncertainty is None else spec.experiment.metric.prior,
        within_percent=100 * within(spec),
        error_mm=overall(tasks),
        half_width_95_mm=MM * half_width(tasks),
        joints_alone_mm=MM * promise_on(joints, ahead.q, ahead.load).overall,
        workspace_error_mm=overall(workspace) if math.isfinite(workspace.overall) else r.Unbounded(),
        error_if_prior_twice_as_uncertain_mm=_doubted(cell, plan),
        random_plans=r.RandomPlans(
            plans=RANDOM,
            planned_mm=MM * promise(plan, rows).overall,
            median_mm=_finite(MM * float(np.median(own))),
            best_tenth_mm=_percentile(own, 10),
        ),
        certificate=_certificate(plan, influence),
        plan=_poses(settings, plan, fit),
        tasks=_tasks(spec, tasks, _rms(moved)),
        candidates=r.Found(len(found.q), found.drawn, found.rejected),
        observability=indices,
        directions=_directions(plan, indices.seen, influence),
        curve=[_count(others, poses) for poses in others.random],
        greedy_mm=[_finite(MM * error) for error in others.greedy],
        advice=_advice(MM * others.greedy),
        map=plan_map(cell, plan, workspace),
        unshown=unshown(plan, math.sqrt(influence.hidden) / tasks.overall),
    )


def margins(arm: Arm, q: Array) -> list[float]:
    """Least distance of every joint from its limits over the poses (poses, n), [deg, mm]."""
    lower, upper = arm.limits
    nearest = np.minimum(q - lower, upper - q).min(axis=0)
    return [float(distance) for distance in arm.shown * nearest]


def travel(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Of the hinge [deg] and the slide [mm] that move farthest from the run before, (poses,) each."""
    slides = np.array([joint.prismatic for joint in arm.joints], dtype=bool)
    moved = np.abs(np.diff(q, axis=0, prepend=q[:1]))
    turned, slid = (moved[:, own].max(axis=1, initial=0.0) for own in (~slides, slides))
    return np.rad2deg(turned), MM * slid


def _doubted(cell: Cell, plan: Plan) -> r.Expected | None:
    """Were the prior twice as uncertain; None without one."""
    spec = plan.specification
    if spec.uncertainty is None:
        return None
    fit = fitted(replace(spec, uncertainty=2 * spec.uncertainty), cad_prior(cell.arm), plan.q, plan.load)
    return overall(widened(promise_on(fit, spec.tasks.q, spec.tasks.load)))


def overall(forecast: Forecast) -> r.Expected:
    """What a forecast says of all poses together."""
    return r.Expected(MM * forecast.overall, MM * forecast.overall_low, MM * forecast.overall_high)


def _certificate(plan: Plan, influence: PriorInfluence) -> r.Certificate:
    """By the test-pose criterion an error is 1 / sqrt(Phi), and what stays hidden from these loads."""
    share, in_metres = min(plan.efficiency, 1.0), plan.criterion.name == "test"
    hidden = influence.hidden if in_metres else 0.0
    reached, least = (math.sqrt(hidden + 1 / phi) for phi in (plan.value, plan.value / share))
    return r.Certificate(
        efficiency=share,
        phi=plan.value,
        phi_bound=plan.relaxed.bound,
        excess_percent=100 * (reached / least - 1),
        reached_mm=MM * reached if in_metres else None,
        least_mm=MM * least if in_metres else None,
        examined=len(plan.examined.q),
        poses_and_loads=len(plan.specification.loads) > 1,
    )


def _poses(settings: PlanSettings, plan: Plan, fit: Fitted) -> list[r.PoseRow]:
    spec = plan.specification
    load = loads_of(spec, plan.load)
    own = deflection_rows(spec.experiment, plan.q, load)
    deflection = _rms(own @ spec.experiment.metric.expected)
    ways: list[r.Way] = ["start", *("clear" if clear else "via" for clear in plan.clear)]
    pulls = plan.load >= len(settings.loads_kg)  # they come behind all that hangs
    turned, slid = travel(spec.experiment.vjm.arm, plan.q)
    expected = _expected(spec.experiment.vjm, plan.q, deflection, widened(promise_on(fit, plan.q, load)))
    return [
        r.PoseRow(
            **vars(row),
            run=k + 1,
            q=plan.q[k].tolist(),
            load_kg=0.0 if pulls[k] else float(settings.loads_kg[plan.load[k]]),
            pull_N=load.wrench[k, :3].tolist() if pulls[k] else None,
            travel_deg=float(turned[k]),
            travel_mm=float(slid[k]),
            way=way,
        )
        for k, (row, way) in enumerate(zip(expected, ways, strict=True))
    ]


def _tasks(spec: Specification, forecast: Forecast, deflection: Array) -> list[r.TaskRow]:
    tasks = spec.tasks
    wrench = np.broadcast_to(tasks.load.wrench, (len(tasks.q), 6))
    point = np.broadcast_to(tasks.load.point, (len(tasks.q), 3))
    return [
        r.TaskRow(
            **vars(row),
            task=k + 1,
            force_N=wrench[k, :3].tolist(),
            moment_Nm=wrench[k, 3:].tolist(),
            point_m=point[k].tolist(),
        )
        for k, row in enumerate(_expected(spec.experiment.vjm, tasks.q, deflection, forecast))
    ]


def _expected(vjm: Vjm, q: Array, deflection: Array, forecast: Forecast) -> list[r.Row]:
    """Poses with deflections [m] and errors to expect there."""
    return [
        r.Row(
            q_shown=(vjm.arm.shown * pose).tolist(),
            expected_deflection_mm=float(MM * deflection[k]),
            expected_error_mm=float(MM * forecast.error[k]),
            expected_error_p05_mm=float(MM * forecast.low[k]),
            expected_error_p95_mm=float(MM * forecast.high[k]),
            tool_m=tool.tolist(),
        )
        for k, (pose, tool) in enumerate(zip(q, chain(vjm, q).position, strict=True))
    ]


def _directions(plan: Plan, seen: int, influence: PriorInfluence) -> r.Directions:
    spec, problem = plan.specification, plan.examined.problem
    believed = spec.uncertainty is not None
    return r.Directions(
        unknowns=spec.experiment.metric.structure.n,
        shown=problem.r,
        at_most=seen_at_most(spec, problem),
        seen=seen,
        outweighed=influence.outweighed if believed else problem.r,
        hidden_mm=MM * math.sqrt(influence.hidden),
        prior_share_percent=100 * influence.prior_share if believed else 0.0,
    )


def _count(others: Baselines, count: int) -> r.CurveRow:
    low, middle, high = (_percentile(others.random[count], percent) for percent in (10, 50, 90))
    return r.CurveRow(count, _finite(MM * others.greedy[count - 1]), middle, low, high)


def _advice(greedy: Array) -> r.Advice:
    """Fewest poses that reach the target, and from where on more always bring little.

    Args:
        greedy: Errors at the tasks with 1, 2, ... poses, each the best next one, [mm].
    """
    reached = np.flatnonzero(greedy <= TARGET)
    ahead = np.r_[greedy[MORE:], np.full(MORE, np.inf)]
    with np.errstate(invalid="ignore"):
        pays = np.isinf(greedy) | (ahead <= (1 - LITTLE) * greedy)
    judged = len(greedy) - MORE
    last = np.flatnonzero(pays[:judged])
    enough = int(last[-1]) + 2 if len(last) else 1
    return r.Advice(
        target_mm=TARGET,
        fewest=int(reached[0]) + 1 if len(reached) else None,
        examined_up_to=len(greedy),
        more=MORE,
        little_percent=100 * LITTLE,
        enough=enough if enough <= judged else None,
    )


def _rms(deflection: Array) -> Array:
    """RMS over the targets of every pose, (poses,), of deflections (poses, 3 m)."""
    return np.asarray(np.sqrt((deflection**2).sum(axis=1) / (deflection.shape[1] / 3)))


def _percentile(errors: Array, percent: float) -> float | None:
    """A percentile of errors [m] of which some may be infinite, [mm]."""
    return _finite(MM * float(np.percentile(errors, percent, method="lower")))


def _finite(value: float) -> float | None:
    """The number, None where it has no bound: JSON knows no infinity."""
    return float(value) if math.isfinite(value) else None
