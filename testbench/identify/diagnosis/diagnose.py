"""Diagnosis of runs: certain mistakes, then frame and kinematics, then loads, deflections and moves in time.

Mistakes that are certain without a fit are, for example, equal or repeated readings. A pair of readings shows
a move of the tracker, or of the targets on the tool, only if it happened between the two readings. All other
moves are found from the order of the readings in time.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Series, select_evenly, select_rows, select_runs, series_from_runs
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import with_targets
from testbench.identify.absolute.evidence import fit_geometry_and_springs
from testbench.identify.absolute.state import ArmState, Mount, nominal_state, torque_scale
from testbench.identify.base_frame import RegisteredDataset
from testbench.identify.diagnosis.deflections import LoadedRuns, deflection_scale, find_load_issues
from testbench.identify.diagnosis.gravity import (
    DOWN,
    MIN_REVERSED_ANGLE,
    angle_between,
    bends_like_hanging_arm,
    gravity_by_tracker,
    mounting_issue,
    suspected_gravity,
)
from testbench.identify.diagnosis.hypotheses import HYPOTHESES, Hypotheses
from testbench.identify.diagnosis.kinematics import (
    EXPECTED_DISTANCE_OVER_REACH,
    IDENTITY_FRAME,
    FittedObservations,
    Issue,
    Observations,
    Submission,
    best_hypothesis,
    fit_kinematics,
    issues_without_fit,
    observations_of_series,
)
from testbench.identify.diagnosis.moves import (
    candidate_rows,
    most_significant_steps,
    nuisance_model,
    p_value,
    with_rms_shift_of_targets,
)
from testbench.identify.equations import MAX_ROBUST_READINGS, check_runs
from testbench.identify.prior import Prior, scale_by_prior
from testbench.model.load import read_body_masses_with_note
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm, marker_positions
from testbench.progress import stepwise

#: Median deflection, over the expected distance, above which loaded readings must fit the kinematics [1].
MAX_DEFLECTION_RATIO = 20.0
MAX_RUNS_PER_BATCH, MAX_RUN_BATCHES = 90, 12  #: Most runs that are tested together, and most batches of them.
#: Mistakes that the registration corrects, so that the loads are tested anyway.
ISSUES_CORRECTED_BY_REGISTRATION = ("frame", "targets")


def diagnose(submission: Submission, prior: Prior, hypotheses: Hypotheses = HYPOTHESES) -> list[Issue]:
    """Find probable mistakes in runs.

    The order of the tests is: mistakes that are certain without a fit, frame and kinematics, the sign of the
    work, single poses, then loads, deflections and moves in time.

    Args:
        submission: The arm and the runs.
        prior: Nominal prior of the compliances.
        hypotheses: The table of mistakes.

    Returns:
        Issues, the most probable first; none for runs without a mistake. A mistake in all poses or all
        readings ends the tests, because it would spoil them, unless the registration corrects it.

    Raises:
        BenchError: When the runs are of another arm, have no reading or hold absurd numbers.
    """
    registered = submission.registered_runs
    data, vjm = registered.data, registered.vjm
    check_runs(vjm, data)
    certain = issues_without_fit(submission, hypotheses.without_fit)
    if data.is_line_reading.any():
        return certain or _along_lines(registered, prior, hypotheses)
    # Frame, targets and kinematics: by the unloaded readings, and by the loaded ones if they are far off.
    issues, fitted = _kinematic_issues(submission, hypotheses)
    if certain or any(issue.name not in ISSUES_CORRECTED_BY_REGISTRATION for issue in issues):
        return [*issues, *certain]
    deflection = np.median(np.linalg.norm(data.deflection, axis=2)[data.is_measured])
    if vjm.arm.joints and deflection > MAX_DEFLECTION_RATIO * fitted.observations.expected_distance:
        runs = submission.data if registered.frame == "base" else _of_one_station(submission.data)
        loaded = _observations(vjm, runs, runs.after)
        loaded = loaded.with_free(frame=registered.frame == "tracker", targets=registered.frame == "tracker")
        issue, _ = best_hypothesis(loaded, hypotheses.kinematics, "loaded")
        if issue is not None:
            return [issue, *issues]
    # The sign of the work: targets that move against the force.
    loads = LoadedRuns(vjm, scale_by_prior(prior, vjm, all153(vjm.arm)), data, gravity_by_tracker(registered))
    if against := issues_without_fit(data, hypotheses.force_work):
        hung = _mounting_issue(loads, fitted.observations)
        return [*hung, *issues, *([] if hung else against)]
    # Single poses; the loads are tested without them.
    wrong_poses = issues_without_fit(fitted, hypotheses.single_poses)
    issues += wrong_poses
    wrong = [issue.details["pose"] for issue in wrong_poses]
    loads = replace(loads, data=select_runs(data, ~np.isin(data.pose_id, wrong)) if wrong else data)
    if not loads.data.is_measured.any():
        return issues
    # Loads, deflections and moves in time. A mistake in all loads may look like a move: it comes first.
    moves = find_moves(vjm, loads.data, prior)
    of_loads = _load_issues(loads, hypotheses)
    if any(issue.name == "mounting" for issue in of_loads):
        return [*of_loads, *issues]
    if all(issue.name in hypotheses.loads.single_run_names for issue in of_loads):
        return [*moves, *issues, *of_loads]
    return [*issues, *of_loads, *moves]


def _along_lines(registered: RegisteredDataset, prior: Prior, hypotheses: Hypotheses) -> list[Issue]:
    """Find mistakes in loads and readings along lines; these do not show where targets or trackers are."""
    data, vjm = registered.data, registered.vjm
    if against := issues_without_fit(data, hypotheses.force_work):
        return against
    loads = LoadedRuns(vjm, scale_by_prior(prior, vjm, all153(vjm.arm)), data, None)
    return _load_issues(loads, hypotheses)


def _kinematic_issues(
    submission: Submission, hypotheses: Hypotheses
) -> tuple[list[Issue], FittedObservations]:
    """Find mistakes in frame, targets and kinematics; return them, and the fitted unloaded readings."""
    registered = submission.registered_runs
    if registered.frame == "base" or not submission.frame_stated:
        # The readings as they are, in the base's frame.
        observations = _observations(submission.nominal_model, submission.data, submission.data.before)
        issue, fitted = best_hypothesis(observations, hypotheses.kinematics)
        if registered.registration is None and issue is not None and issue.name in ("frame", "kinematics"):
            # A tracker's frame is no mistake, but the reason why it was not found is one.
            reason = explain_unregistered_runs(submission.nominal_model, submission.data, hypotheses)
            issue = reason or (issue if issue.name == "frame" else None)
        if registered.frame == "base" or (issue is not None and issue.name not in ("frame", "kinematics")):
            return ([] if issue is None else [issue]), FittedObservations(observations, fitted)
    # The readings of one tracker, in its frame; then all of them, as registered.
    data = _of_one_station(submission.data)
    unloaded = _observations(registered.vjm, data, data.before).with_free(frame=True, targets=True)
    issue, _ = best_hypothesis(unloaded, hypotheses.kinematics)
    issues = [issue] if issue else issues_without_fit(submission, hypotheses.registration)
    observations = _observations(registered.vjm, registered.data, registered.data.before)
    return issues, FittedObservations(observations, fit_kinematics(observations))


def explain_unregistered_runs(vjm: Vjm, data: Dataset, hypotheses: Hypotheses = HYPOTHESES) -> Issue | None:
    """Find the mistake that prevents the registration of runs in the base's frame.

    Args:
        vjm: Nominal model of the arm.
        data: Runs of one or several stations.
        hypotheses: The table of mistakes.

    Returns:
        The issue; "kinematics" when the readings do not fit and no hypothesis explains them; None when they
        fit.
    """
    names = np.zeros(data.n_runs) if data.station is None else data.station
    every = [select_runs(data, names == name) for name in np.unique(names)]
    observations = (
        _observations(vjm, runs, runs.before).with_free(frame=True, targets=True) for runs in every
    )
    issues = [best_hypothesis(one, hypotheses.kinematics)[0] for one in observations]
    return min(filter(None, issues), key=lambda issue: issue.name == "kinematics", default=None)


def explain_unregistered_series(vjm: Vjm, series: Series) -> Issue | None:
    """Find the mistake that prevents absolute readings from fitting the arm in any frame.

    Args:
        vjm: Nominal model of the arm.
        series: The readings.

    Returns:
        The issue; "kinematics" when the readings do not fit and no hypothesis explains them; None when they
        fit.
    """
    if series.distance is not None:
        return None
    return best_hypothesis(observations_of_series(vjm, series), HYPOTHESES.kinematics, "all")[0]


def _mounting_issue(loads: LoadedRuns, observations: Observations) -> list[Issue]:
    """Find the mounting of the base that makes targets move against stated weights."""
    vjm, data = loads.vjm, loads.data
    gravity = suspected_gravity(vjm, loads.compliance_prior, data, loads.tracker_gravity)
    if gravity is None:
        return []
    if angle_between(gravity.g, DOWN) > MIN_REVERSED_ANGLE and not gravity.confirmed_by_tracker:
        prior = loads.compliance_prior
        pi = abs(deflection_scale(loads)) * (prior.L @ prior.expected_x)
        if not bends_like_hanging_arm(
            observations, _observations(vjm, data, data.after), prior.structure.C_theta_of(pi)
        ):
            return []
    return [mounting_issue(vjm, gravity)]


def _load_issues(loads: LoadedRuns, hypotheses: Hypotheses) -> list[Issue]:
    """Find mistakes in all loads from the first batch of runs, in single runs from all batches."""
    data = loads.data
    readings_per_run = len(data.markers) + (data.sigma_rotation is not None)
    parts = max(
        1, -(-data.n_runs // max(1, min(MAX_RUNS_PER_BATCH, MAX_ROBUST_READINGS // readings_per_run)))
    )
    subsets = [
        select_runs(data, np.arange(data.n_runs) % parts == k) for k in range(min(parts, MAX_RUN_BATCHES))
    ]
    runs = hypotheses.loads.single_run_names
    issues = find_load_issues(replace(loads, data=subsets[0]), hypotheses.loads)
    if any(issue.name not in runs for issue in issues):
        return issues
    for subset in stepwise(subsets[1:], "looking for mistakes"):
        more = find_load_issues(replace(loads, data=subset), hypotheses.loads)
        issues += [issue for issue in more if issue.name in runs]
    return sorted(issues, key=lambda issue: -(issue.log_likelihood_gain or 0))


def _of_one_station(data: Dataset) -> Dataset:
    """Select the runs of the station that read most of them."""
    if data.station is None:
        return data
    names, count = np.unique(data.station, return_counts=True)
    return select_runs(data, data.station == names[count.argmax()])


def _observations(vjm: Vjm, data: Dataset, position: Array) -> Observations:
    """Collect readings, unloaded or loaded; loads of a pose that share unloaded readings count once."""
    every = np.concatenate([data.q, np.nan_to_num(data.before.reshape(data.n_runs, -1))], axis=1)
    runs = np.sort(np.unique(every, axis=0, return_index=True)[1])
    return Observations(
        vjm=vjm,
        q=data.q[runs],
        markers=marker_positions(vjm, data.markers),
        position=position[runs],
        is_measured=data.is_measured[runs],
        expected_distance=EXPECTED_DISTANCE_OVER_REACH * vjm.reach,
        target_names=data.markers,
        run_id=data.run_id[runs],
        pose_id=data.pose_id[runs],
    )


# --- Moves between two readings -----------------------------------------------------------------------------

MAX_P_VALUE = 0.05
"""Largest probability of a reported move, or a clearer one, in readings without a move [1]."""
MIN_POSES_BESIDE_STEP = 3  #: Fewest poses before and after a move that is reported.
#: Highest order of the periodic joint errors that may explain a move instead; few poses determine no more.
MAX_PERIODIC_ORDER = 2
MAX_TESTED_TARGETS = 30
"""Most targets that are used, evenly spaced: all move together, and each adds unknowns."""
MOUNT_NAME = "targets"  #: Name of the mount of all targets.


def find_moves(vjm: Vjm, data: Dataset, prior: Prior) -> list[Issue]:
    """Find moves of the tracker or the targets between two readings of runs, at most one per station.

    From the move on, all readings are displaced against the arm by a rigid motion that no error of geometry,
    compliance or slow joint error explains. A move is reported if its p-value is below MAX_P_VALUE divided by
    twice the number of tested places.

    Args:
        vjm: The arm's virtual joint model, with targets as measured.
        data: Runs in the base's frame, in order of time.
        prior: Nominal prior of the compliances.

    Returns:
        Moves of targets, then of trackers; none when there are too few readings. Their details `before` and
        `after` identify the readings on both sides: 2 k is the unloaded reading of run k, 2 k + 1 the loaded.
    """
    series = tuple(_series_in_time(select_rows(data, select_evenly(np.arange(data.n_runs)))))
    steps = [candidate_rows(readings, MIN_POSES_BESIDE_STEP) for readings in series]
    if not vjm.arm.joints or not any(map(len, steps)):
        return []
    try:
        state, noise = fit_geometry_and_springs(
            _nominal_base_state(vjm, series), series, scale_by_prior(prior, vjm, joints_only(vjm.arm))
        )
    except BenchError:  # too few readings to determine arm and targets: no step can be found
        return []
    nuisance = nuisance_model(
        state, series, noise, scale_by_prior(prior, vjm, all153(vjm.arm)), MAX_PERIODIC_ORDER
    )
    clear = MAX_P_VALUE / (2 * sum(map(len, steps)))
    moves = [
        with_rms_shift_of_targets(nuisance, readings, step)
        for readings, step in most_significant_steps(nuisance, series, steps)
        if p_value(step) < clear
    ]
    moves = [replace(step, details={**step.details, "pairs": True}) for step in moves]
    return sorted(moves, key=lambda step: step.name)


def _series_in_time(data: Dataset) -> Iterator[Series]:
    """Sort the readings of every station by time; rows 2 k and 2 k + 1 are the unloaded and loaded run k.

    An unloaded reading that several loads share is listed once.
    """
    pose = dict(zip(data.run_id.tolist(), data.pose_id.tolist(), strict=True))
    stations = 1 if data.station is None else len(np.unique(data.station))
    for every in series_from_runs(data, "station", MOUNT_NAME):
        series = with_targets(every, every.markers[:: -(-len(every.markers) // MAX_TESTED_TARGETS)])
        loaded = np.arange(series.n_rows) >= series.n_rows // 2
        poses = np.array([pose[run] for run in series.row_id.tolist()])
        read = np.column_stack(
            [poses, loaded, np.where(loaded, series.pose_id, 0), series.position.reshape(series.n_rows, -1)]
        )
        first = np.unique(read, axis=0, return_index=True)[1]
        first = first[np.argsort((2 * series.pose_id + loaded)[first])]
        name = series.frame if stations > 1 else ""
        yield select_rows(replace(series, name=name, row_id=2 * series.row_id + loaded, pose_id=poses), first)


def _nominal_base_state(vjm: Vjm, series: tuple[Series, ...]) -> ArmState:
    """Build the nominal arm with trackers in the base's frame and nominal targets."""
    weights, markers = read_body_masses_with_note(vjm.arm)[0], series[0].markers
    return replace(
        nominal_state(vjm, weights, torque_scale(vjm, weights, series)),
        frames={readings.frame: IDENTITY_FRAME for readings in series},
        mounts={MOUNT_NAME: Mount(marker_positions(vjm, markers), np.eye(3), markers)},
    )
