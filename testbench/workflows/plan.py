"""The composer of a plan: what an engineer asks for becomes candidates, poses, and what they promise.

For tasks under loads, or for absolute readings: then geometry, joint errors and the set-up are unknown too.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Series, select_rows
from testbench.design import absolute
from testbench.design.absolute import AbsoluteSetup
from testbench.design.criteria import criterion_by_name
from testbench.design.exchange import Feasibility, Gauges, PoseSearch, greedy_plan
from testbench.design.forecast import (
    Forecast,
    forecast_fit,
    inflate_intervals,
    unbounded_predictions,
    with_infinite_errors,
)
from testbench.design.planning import (
    ChosenPoses,
    Plan,
    candidate_set,
    choose_greedily,
    forecast_errors,
    make_plan,
    observability,
    plan_with_gauges,
    prediction_error_function,
)
from testbench.design.planning import choose_poses as search_best
from testbench.design.rows import (
    MeasurementSetup,
    PlanSpecification,
    Tasks,
    select_loads,
    task_rows,
    workspace_rows,
)
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, PoseError, check_type
from testbench.identify.absolute.align import stated_frame, unknowns_of
from testbench.identify.absolute.posterior import further_information
from testbench.identify.absolute.state import Mount, nominal_state, with_error_terms
from testbench.identify.posterior import ArmModel
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.identify.registration import MIN_REGISTRATION_POSES, Frame
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import Load, read_body_masses, weight
from testbench.model.vjm import Vjm, marker_positions, tool_points
from testbench.plant.rigid_cell import build_rigid_cell, collision_free
from testbench.plant.tracker import DistanceMeter, PlaneProbe, Station
from testbench.progress import stepwise
from testbench.runs.rows import Row, trial_rng
from testbench.workflows.absolute import FREE_DEVIATION, FURTHER, Calibrated, unobservable
from testbench.workflows.cell import Cell
from testbench.workflows.instruments import Mounted, blocks_of, check_markers, distances_of, names_of, touch
from testbench.workflows.plan_input import (
    REASONS,
    Candidates,
    PoseConditions,
    build_checks,
    feasible,
    find_feasible_poses,
    refusal_reasons,
)
from testbench.workflows.plan_settings import HIGHEST_ORDER, PlanSettings, structure
from testbench.workflows.predicted_error import linear_fit_after
from testbench.workflows.rows import MM, UM

WORKSPACE = 200  #: Poses that stand for the workspace.
STEP, SLIDE_STEP = math.radians(5), 0.02
"""Largest steps of a hinge [rad] and a slide [m] between collision checks on the way from pose to pose."""
NAMED = 5  #: Tasks that a message names; more are counted.
FURTHER_CANDIDATES = 120  #: Candidates for further poses of a calibration.
FRAME, MOUNT = "tracker", "target"  #: Names of what is unknown of the set-up of absolute readings.


@dataclass(frozen=True, repr=False)
class Planned(Displayed):
    """Hold a plan and the errors to expect from it."""

    cell: Cell  #: The arm.
    settings: PlanSettings  #: Settings of the plan.
    found: Candidates  #: Feasible poses, and how many were rejected.
    plan: ChosenPoses  #: Poses in the order of measuring; a `Plan` if they are for tasks.
    poses: Forecast  #: Errors to expect in these poses [m].
    forecast: Forecast  #: Errors to expect at the tasks; for absolute readings over the workspace [m].
    workspace: Forecast  #: Errors to expect over the workspace, under the first load [m].

    def summary(self) -> dict[str, object]:
        """Summarise the plan: arm, poses, criterion, and the error to expect at the tasks."""
        return {
            "arm": self.cell.arm.name,
            "poses": len(self.plan.q),
            "criterion": self.settings.criterion,
            "model": self.settings.model,
            "expected_rms_mm": f"{1e3 * self.forecast.overall_rms_error:.3g}",
        }


@dataclass(frozen=True, repr=False)
class AbsolutePlanned(Planned):
    """Hold a plan of absolute readings and the errors to expect from it."""

    union: AbsoluteSetup  #: The unknowns.
    q: Array  #: Poses in which the plan is judged, (poses, n) [rad, m].
    wanted: Array  #: Predictions there, `absolute.position_rows`.
    given: Calibrated | None  #: Earlier calibration; None without one.


def plan(cell: Cell, q: Array, settings: PlanSettings) -> Planned:
    """Plan a calibration: the poses whose readings reduce the error at the tasks most.

    Args:
        cell: The arm.
        q: Poses in which the robot works under the first of the loads, (tasks, n) [rad, m].
        settings: Settings of the plan, such as PlanSettings(loads_kg=(460.3,), poses=12).

    Returns:
        The poses in the order of measuring, `.plan.q`, and the errors to expect at the tasks, `.forecast`.

    Raises:
        BenchError: When an argument has another type, a number is out of range, joints are not in radians, or
            too little is measured without a prior.
        PoseError: When there are fewer feasible poses than the plan needs.
    """
    check_type(cell, Cell, "cell")
    check_type(settings, PlanSettings, "settings")
    if settings.absolute:
        raise BenchError("settings.absolute: expected False; plan_absolute plans absolute readings")
    q = cell.arm.check_joint_positions(q, "tasks q [rad, m]")
    return plan_for(cell, settings, Tasks(q, weight(cell.vjm, settings.loads_kg[0])))


def plan_for(cell: Cell, settings: PlanSettings, tasks: Tasks) -> Planned:
    """Plan a calibration for tasks with loads of their own.

    Args:
        cell: The arm.
        settings: Settings of the plan.
        tasks: Poses and loads of the robot's work.

    Returns:
        The plan.

    Raises:
        BenchError: When a number is out of range, or too little is measured without a prior.
        PoseError: When there are fewer feasible poses than the plan needs.
    """
    candidates = search(cell, settings)
    best = choose(cell, settings, tasks, candidates)
    spec = best.specification
    indices = observability(best.candidates.problem, best.chosen_indices)
    if spec.prior_uncertainty is None and indices.seen < indices.of:
        raise BenchError(
            f"poses: {settings.poses} of them determine {indices.seen} of the {indices.of} directions that "
            "these loads can determine; give more poses, or plan with a prior"
        )
    fit = linear_fit_after(spec, cad_prior(cell.arm), best.whitened_rows)
    poses, forecast, around = (
        inflate_intervals(forecast_fit(fit, at, load))
        for at, load in (
            (best.q, select_loads(spec, best.load_index)),
            (tasks.q, tasks.load),
            (spec.workspace_poses, spec.loads[0]),
        )
    )
    around = with_infinite_errors(
        around, unbounded_predictions(best.candidates.problem, workspace_rows(spec))
    )
    return Planned(cell, settings, candidates, best, poses, forecast, around)


def search(cell: Cell, settings: PlanSettings) -> Candidates:
    """Draw feasible poses from which a plan is chosen; PoseError if they are fewer than the plan needs.

    Args:
        cell: The arm with its model and its truth.
        settings: The settings.

    Returns:
        The candidates.
    """
    checks, rng = build_checks(cell, settings.conditions), trial_rng(settings.seed, 0)
    candidates = find_feasible_poses(checks, settings.candidates_wanted, rng, least=settings.poses)
    return replace(candidates, q=nearest_turn(candidates.q, cell.arm))


def nearest_turn(q: Array, arm: Arm) -> Array:
    """Turn every hinge to the angle nearest to zero that its limits allow.

    A joint that can turn about itself more than once reaches a pose at several angles; nearest to zero the
    ways from pose to pose are short, and cables are not wound up.

    Args:
        q: Poses, (poses, n) [rad, m].
        arm: Description of the arm.

    Returns:
        The poses, (poses, n) [rad, m].
    """
    near, (lower, upper) = q - 2 * np.pi * np.round(q / (2 * np.pi)), arm.limits
    return np.where(arm.full_turn_joints & (near >= lower) & (near <= upper), near, q)


def workspace_poses(cell: Cell, settings: PlanSettings) -> Array:
    """Draw `WORKSPACE` collision-free poses all over the workspace; PoseError if there are none.

    Args:
        cell: The arm with its model and its truth.
        settings: The settings.

    Returns:
        Poses, (poses, n) [rad, m].
    """
    checks = build_checks(cell, PoseConditions(settings.area))
    return find_feasible_poses(checks, WORKSPACE, trial_rng(settings.seed, 2), least=1).q


def build_feasibility(cell: Cell, settings: PlanSettings) -> Feasibility:
    """Build the checks of poses, and of paths between two poses, that a search for a plan asks.

    Args:
        cell: The arm with its model and its truth.
        settings: The settings.

    Returns:
        The checks.
    """
    checks = build_checks(cell, settings.conditions)
    return Feasibility(lambda q: feasible(checks, q), build_path_check(cell, settings.station))


def choose(cell: Cell, settings: PlanSettings, tasks: Tasks, candidates: Candidates) -> Plan:
    """Choose the best plan; BenchError where without a prior poses are too few or loads show too little.

    Args:
        cell: The arm with its model and its truth.
        settings: The settings.
        tasks: Where predictions are wanted.
        candidates: Feasible poses.

    Returns:
        The plan.
    """
    scaling = scale_by_prior(cad_prior(cell.arm), cell.vjm, structure(cell, settings.model))
    percent = settings.uncertainty_percent
    spec = PlanSpecification(
        setup=MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, settings.sigma_um / UM),
        loads=(
            *(weight(cell.vjm, mass) for mass in settings.loads_kg),
            *(Load(np.array([*force, 0, 0, 0]), cell.vjm.load_point) for force in settings.pulls_n),
        ),
        tasks=tasks,
        workspace_poses=workspace_poses(cell, settings),
        prior_uncertainty=None if percent is None else percent / 100,
        n_poses=settings.poses,
    )
    if spec.prior_uncertainty is None:
        _check_without_prior(spec, candidates.q)
    rng, reach = trial_rng(settings.seed, 1), build_feasibility(cell, settings)
    best = make_plan(spec, settings.criterion, candidates.q, reach, rng)
    if not settings.gauges:
        return best
    gauges = Gauges(settings.gauges, settings.gauge_um / UM, math.radians(settings.tilt_deg))
    return plan_with_gauges(best, gauges, reach, rng)


def build_path_check(cell: Cell, station: Station | None) -> Callable[[Array, Array], bool]:
    """Build a check of straight paths in joint space for collisions, without a hung weight.

    Args:
        cell: The arm with its model and its truth.
        station: Where the tracker stands; None for no tracker.

    Returns:
        A function that tells whether the way between two poses is clear.
    """
    site = build_rigid_cell(cell.arm, None, None if station is None else station.position, cell.floor)
    step = np.array([SLIDE_STEP if joint.prismatic else STEP for joint in cell.arm.joints])

    def clear(start: Array, end: Array) -> bool:
        steps = max(1, math.ceil(float((np.abs(end - start) / step).max(initial=0.0))))
        share = np.arange(1, steps)[:, None] / steps
        return bool(collision_free(site, start + share * (end - start)).all())

    return clear


def _check_without_prior(spec: PlanSpecification, q: Array) -> None:
    """Refuse what only a prior could fill, before the search begins."""
    problem = candidate_set(spec, q).problem
    rows = task_rows(spec)
    if numbers := (np.flatnonzero(unbounded_predictions(problem, rows)) + 1).tolist():
        named = ", ".join(map(str, numbers[:NAMED])) + (", ..." if len(numbers) > NAMED else "")
        raise BenchError(
            f"tasks {named} ({len(numbers)} of {len(rows)}): the planned loads cannot determine all "
            "deflections under the loads of these tasks, so their error has no bound; "
            "add a prior, or a load or pull in another direction"
        )


def plan_absolute(cell: Cell, settings: PlanSettings, given: Calibrated | None = None) -> AbsolutePlanned:
    """Choose the poses whose absolute readings calibrate an arm best.

    Args:
        cell: The arm.
        settings: What is asked for.
        given: The arm by readings that were taken before; None where there are none.

    Returns:
        The poses, and what they promise.

    Raises:
        BenchError: When the arm has no joints.
    """
    if not cell.arm.joints:
        raise BenchError(f"{cell.arm.name}: expected an arm with joints")
    known = given and given.calibration.model()
    check_markers(cell, settings.mounted)
    blocks_of(settings.mounted)
    union = absolute_setup_after_readings(known, settings) if known else absolute_setup(cell, settings)
    instruments, q = settings.mounted, workspace_poses(cell, settings)
    planes = [own for own in instruments if isinstance(own.instrument, PlaneProbe)]
    reach = build_feasibility(cell, settings)
    if settings.poses < MIN_REGISTRATION_POSES * len(planes):
        raise BenchError(
            f"--poses: expected at least {MIN_REGISTRATION_POSES * len(planes)}, "
            f"{MIN_REGISTRATION_POSES} for each plane"
        )
    if planes:
        candidates, kind = _touching(cell, settings, planes)
    else:
        candidates = search(cell, settings)
        kind = np.zeros(len(candidates.q), dtype=int)
    if len(planes) < len(instruments):
        in_range, feasible_pose = _ranges(cell, instruments, candidates.q), reach.poses_are_feasible
        reach = replace(reach, poses_are_feasible=lambda q: feasible_pose(q) & in_range(q))
        candidates, kind = _within(candidates, kind, in_range(candidates.q), settings.poses)
    wanted = absolute.position_rows(union, q)
    examined = absolute.candidate_set(union, candidates.q, settings.poses, kind)
    asked = PoseSearch(
        whitened_rows=lambda q, kind, lift: absolute.whitened_rows(union, q, lift, kind),
        n_poses=settings.poses,
        joint_limits=cell.arm.limits,
        feasibility=reach,
        rng=trial_rng(settings.seed, 1),
        with_dependent_joints=cell.arm.with_dependent_joints,
    )
    criterion = criterion_by_name(settings.criterion, examined.problem, wanted)
    if planes:  # a pose that touches a plane would leave it by a step of its joints
        best = choose_greedily(asked, criterion, examined, MIN_REGISTRATION_POSES)
    else:
        best_of = search_best if given is None else choose_greedily
        best = best_of(asked, criterion, examined)
    there, over = (forecast_errors(best, rows) for rows in (absolute.position_rows(union, best.q), wanted))
    return AbsolutePlanned(cell, settings, candidates, best, there, over, over, union, q, wanted, given)


def _touching(cell: Cell, settings: PlanSettings, planes: Sequence[Mounted]) -> tuple[Candidates, Ids]:
    """Find feasible poses that touch planes, and which plane each of them touches, (poses,)."""
    rng, count = trial_rng(settings.seed, 0), -(-settings.candidates_wanted // len(planes))
    parts = [
        touch(cell, own, count, rng, MIN_REGISTRATION_POSES) for own in stepwise(planes, "finding touches")
    ]
    q, kind = np.concatenate(parts), np.repeat(np.arange(len(planes)), [*map(len, parts)])
    why, names = refusal_reasons(build_checks(cell, settings.conditions), q), names_of(settings.mounted)
    names = [name for own, name in zip(settings.mounted, names, strict=True) if own.direction is not None]
    clear = np.array([reason is None for reason in why], dtype=bool)
    for k, count in enumerate(np.bincount(kind[clear], minlength=len(planes)).tolist()):
        if count < MIN_REGISTRATION_POSES:
            reasons = Counter(reason for reason, own in zip(why, kind, strict=True) if reason and own == k)
            most = next((f": {name}" for name, _ in reasons.most_common(1)), "")
            raise PoseError(
                f"--instrument: {count} candidate poses touch {names[k]}, "
                f"expected at least {MIN_REGISTRATION_POSES}{most}; move the face, or draw more candidates"
            )
    found = Candidates(nearest_turn(q, cell.arm), len(q), {name: why.count(name) for name in REASONS})
    return _within(found, kind, clear, settings.poses)


def _within(candidates: Candidates, kind: Ids, allowed: Mask, poses: int) -> tuple[Candidates, Ids]:
    """Keep the candidates that are allowed, and their kinds; PoseError if they are too few."""
    if allowed.sum() < poses:
        raise PoseError(
            f"--instrument: {allowed.sum()} of {len(allowed)} candidate poses can be read; expected at least "
            f"{poses}: move the faces or fixed points, lighten the load, or draw more candidates"
        )
    return replace(candidates, q=candidates.q[allowed]), kind[allowed]


def _ranges(cell: Cell, instruments: Sequence[Mounted], q: Array) -> Callable[[Array], Mask]:
    """Tell in which poses all distances are in range: the middle of a range is the median of candidates."""
    meters = [own for own in instruments if own.direction is None]

    def lengths(q: Array) -> Array:
        at = tool_points(cell.vjm, q, marker_positions(cell.vjm, tuple(own.marker for own in meters)))
        return np.asarray(np.linalg.norm(at - np.array([own.fixed for own in meters]), axis=2))

    middle = np.median(lengths(q), axis=0)
    travel = [own.instrument.max_change for own in meters if isinstance(own.instrument, DistanceMeter)]
    return lambda q: np.asarray((np.abs(lengths(q) - middle) <= travel).all(axis=1))


def gain_of_further_poses(cell: Cell, given: ArmModel, sigma: float) -> tuple[float, float]:
    """Compute RMS position errors over the workspace after a calibration, and after `FURTHER` more poses.

    Args:
        cell: The arm.
        given: What is known of it.
        sigma: Standard deviation of a reading along an axis [m].

    Returns:
        Both errors [m], each after frame and mount were fitted to the predicted positions.

    Raises:
        BenchError: When the arm can be nowhere.
    """
    settings = PlanSettings(
        absolute=True, criterion="I", poses=FURTHER, sigma_um=UM * sigma, candidates_wanted=FURTHER_CANDIDATES
    )
    union = absolute_setup_after_readings(given, settings)
    wanted = absolute.position_rows(union, workspace_poses(cell, settings)[:FURTHER_CANDIDATES])
    left = absolute.without_frame_and_mount(union, wanted)
    _, after = choose_further_poses(union, search(cell, settings).q, left)
    return absolute.prior_error_after_alignment(union, wanted), after


def choose_further_poses(union: AbsoluteSetup, q: Array, wanted: Array) -> tuple[list[int], float]:
    """Choose `FURTHER` of some poses greedily, and compute the RMS error of predictions after them.

    Args:
        union: All unknowns.
        q: Poses, (poses, n) [rad, m].
        wanted: Rows of the predictions.

    Returns:
        Indices of the poses, and the error [m].
    """
    problem = absolute.candidate_set(union, q, FURTHER).problem
    chosen = greedy_plan(problem, criterion_by_name("I", problem, wanted), problem.rows, FURTHER)
    return chosen.tolist(), prediction_error_function(problem, wanted)(chosen)


def absolute_setup(cell: Cell, settings: PlanSettings) -> AbsoluteSetup:
    """Build the unknowns and readings of a calibration by absolute positions, with their prior.

    Args:
        cell: The arm with its model and its truth.
        settings: The settings.

    Returns:
        The unknowns.
    """
    pose, vjm = _one_pose(cell.vjm, settings), cell.vjm
    kinds = _kinds_of_poses(settings, pose)
    every = tuple({one.name: one for own in kinds for one in own}.values()) or (pose,)
    pose = replace(pose, frame=every[0].frame)
    unknowns = unknowns_of(
        vjm, every, JointErrorTerms(tuple(range(1, settings.orders + 1))), structure(cell, settings.model)
    )
    prior = cad_prior(cell.arm)
    nominal = nominal_state(vjm, read_body_masses(cell.arm), np.ones(cell.arm.n_joints))
    state = replace(
        with_error_terms(nominal, unknowns.error_terms),
        C_theta=prior.C_theta,
        frames={one.frame: stated_frame(one) for one in every},
        mounts={MOUNT: Mount(marker_positions(vjm, pose.markers), np.eye(3), pose.markers)},
    )
    assert settings.uncertainty_percent is not None
    L = absolute.prior_covariance_root(
        unknowns,
        scale_by_prior(prior, vjm, unknowns.structure),
        settings.uncertainty_percent / 100,
        geometry_deviation=settings.geometry_mm / MM,
        joint_error_deviation=settings.gear_urad / UM,
    )
    beyond = settings.gear_urad * math.sqrt(HIGHEST_ORDER - settings.orders)  # orders that are noise
    return AbsoluteSetup(
        unknowns, state, L, pose, np.where(cell.arm.hinges, beyond / UM, 0.0), readings_by_kind=kinds
    )


def _kinds_of_poses(settings: PlanSettings, pose: Series) -> tuple[tuple[Series, ...], ...]:
    """What instruments read in every kind of pose: all distances, and the height over one plane if any."""
    instruments = settings.mounted
    every = [
        distances_of(
            own,
            replace(pose, name=name, frame=own.block or name),
            np.full(pose.n_rows, 1.0 if own.direction is None else 0.0),
        )
        for own, name in zip(instruments, names_of(instruments), strict=True)
    ]
    points = tuple(one for one in every if one.plane_normal is None)
    planes = [one for one in every if one.plane_normal is not None]
    return tuple((plane, *points) for plane in planes) or ((points,) if points else ())


def absolute_setup_after_readings(given: ArmModel, settings: PlanSettings) -> AbsoluteSetup:
    """Build the unknowns and readings of further poses after a calibration, with its posterior as prior.

    The tracker's frame and the targets' mount are unknown anew.

    Args:
        given: The calibrated arm.
        settings: The settings.

    Returns:
        The unknowns.
    """
    if given.noise is None or not given.state.mounts:
        raise BenchError("given: expected a model of absolute readings")
    mount, noise = next(iter(given.state.mounts.values())), given.noise
    pose = _one_pose(given.vjm, settings, mount.markers)
    open_ = (noise.position_model_error, noise.rotation_model_error)
    sigma, turn = (
        float(f * math.hypot(settings.sigma_um / UM, s)) for f, s in zip(noise.factor, open_, strict=False)
    )
    pose = replace(pose, sigma=sigma, sigma_rotation=turn if settings.orientations else None)
    unknowns = unknowns_of(given.vjm, (pose,), given.state.error_terms, given.structure)
    state = replace(given.state, frames={FRAME: Frame(np.eye(3), np.zeros(3))}, mounts={MOUNT: mount})
    first, root = unknowns.first_columns["geometry"], given.posterior.covariance_root
    L = np.zeros((unknowns.size, first + len(root)))
    L[:first, :first] = absolute.FRAME_DEVIATION * np.eye(first)
    L[first + given.uncertain_columns, first:] = root.T
    return AbsoluteSetup(
        unknowns, state, L, pose, np.zeros(given.arm.n_joints), absolute.MIN_FOLLOW_UP_INFORMATION_OVER_PRIOR
    )


def _one_pose(vjm: Vjm, settings: PlanSettings, targets: tuple[str, ...] | None = None) -> Series:
    """How a pose is read: under own weight, then under one load after the other."""
    load = weight(vjm, np.array([0.0, *settings.loads_kg]))
    rows, sigma = len(load.wrench), settings.sigma_um / UM
    markers = targets or (vjm.arm.markers[:1] if settings.orientations else vjm.arm.markers)
    if settings.instruments:
        used = {own.marker for own in settings.mounted}
        markers = tuple(name for name in vjm.arm.markers if name in used)
    return Series(
        name="plan",
        markers=markers,
        frame=FRAME,
        mount=MOUNT,
        row_id=np.arange(rows),
        pose_id=np.zeros(rows, dtype=int),
        q=np.zeros((rows, vjm.arm.n_joints)),
        wrench=load.wrench,
        point=load.point,
        position=np.zeros((rows, len(markers), 3)),
        sigma=sigma,
        rotation=np.tile(np.eye(3), (rows, 1, 1)) if settings.orientations else None,
        sigma_rotation=sigma if settings.orientations else None,
    )


def undetermined_by(union: AbsoluteSetup, q: Array) -> tuple[str, ...]:
    """List the quantities that positions read in some poses do not determine, as sentences.

    Args:
        union: All unknowns.
        q: Poses, (poses, n) [rad, m].

    Returns:
        Sentences.
    """
    once = absolute.series_in_poses(select_rows(union.pose_readings, np.arange(1)), q)
    further = further_information(
        union.unknowns, union.state, (once,), lambda series: absolute.position_information(union, series.q)
    )
    tells, prior = absolute.position_information(union, q), union.L @ union.L.T
    set_up = union.unknowns.first_columns["geometry"]
    prior[:set_up, :set_up] = FREE_DEVIATION**2 * np.eye(set_up)
    return unobservable(union.unknowns, tells, prior, further)


def scale_forecast(made: AbsolutePlanned) -> Row:
    """Forecast how well the scale of an arm is known: by how much all distances are wrong in proportion.

    Args:
        made: The plan.

    Returns:
        Standard deviations by the prior of the geometry alone, `before_mm_per_m`, and after the plan,
        `after_mm_per_m`; RMS error of positions over the workspace by the scale alone after it, `error_mm`.
    """
    problem = made.plan.candidates.problem
    h, far = absolute.position_scale_jacobian(made.union, made.wanted, made.q)
    known = h @ problem.lift @ np.linalg.solve(made.plan.information, problem.lift.T @ h)
    after = math.sqrt(known + float(h @ problem.remaining_covariance @ h))
    geometry = h[made.union.unknowns.columns("geometry")]
    before = float(np.linalg.norm(geometry))
    return Row(before_mm_per_m=MM * before, after_mm_per_m=MM * after, error_mm=MM * (after * far))
