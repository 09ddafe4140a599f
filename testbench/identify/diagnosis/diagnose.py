"""Diagnosis of runs and series: certain mistakes first, then the place of the arm, then loads and moves.

Certain mistakes need no fit: equal or repeated readings, absurd sizes. A pair shows that the tracker, or the
targets on the tool, moved only if they moved between its two readings. Otherwise the order in time shows it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Series, select, select_evenly, select_rows, series_of
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import with_targets
from testbench.identify.absolute.evidence import first_fit
from testbench.identify.absolute.state import ArmState, Mount, nominal_state, torque_scale
from testbench.identify.diagnosis.deflections import LoadedRuns, deflection_scale, load_issues
from testbench.identify.diagnosis.gravity import (
    DOWN,
    REVERSED_ANGLE,
    angle,
    gravity_by_tracker,
    mounting,
    sags_like_hanging,
    suspected_gravity,
)
from testbench.identify.diagnosis.hypotheses import HYPOTHESES, Hypotheses
from testbench.identify.diagnosis.kinematics import (
    IDENTITY_FRAME,
    SOUND_DISTANCE,
    FittedObservations,
    FreeParameters,
    Issue,
    Observations,
    Submission,
    best_hypothesis,
    fit,
    listed_issues,
    of_series,
)
from testbench.identify.diagnosis.moves import (
    most_significant_step,
    nuisance_model,
    p_value,
    step_places,
    with_shift,
)
from testbench.identify.metric import Prior, scale_by_prior
from testbench.identify.registered import RegisteredDataset
from testbench.identify.rows import MAX_READINGS, check_runs
from testbench.model.load import weights_with_note
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import Vjm, marker_points
from testbench.progress import stepwise

NO_PARAMETERS = FreeParameters()
HUGE_DEFLECTION = 20.0  #: Deflection over a sound distance from which loaded readings are of something else.
RUNS_AT_A_TIME, MAX_PARTS = 90, 12  #: Runs that are tested together, and greatest number of such batches.
#: Mistakes that a registration mends: the loads can be looked at all the same.
CORRECTED_BY_REGISTRATION = ("frame", "targets")


def diagnose(submission: Submission, prior: Prior, hypotheses: Hypotheses = HYPOTHESES) -> list[Issue]:
    """Find probable mistakes in runs.

    The checks come in this order: plain mistakes, frame and kinematics, the sign of the work, then loads,
    deflections and their order in time.

    Args:
        submission: The arm and the runs.
        prior: Prior of the compliances, from the arm's folder.
        hypotheses: The table of mistakes.

    Returns:
        Issues, the most probable first; none for sound runs. A mistake of all poses or of all readings ends
        the checks, because it would spoil them, unless the registration corrects it.

    Raises:
        BenchError: When the runs are of another arm, have no reading or hold absurd numbers.
    """
    registered = submission.registered
    check_runs(registered.vjm, registered.data)
    plain = listed_issues(submission, hypotheses.without_fit)
    if registered.data.lines.any():
        return plain or _along_lines(registered, prior, hypotheses)
    said, placed = _placed(submission, hypotheses)
    if plain or any(issue.name not in CORRECTED_BY_REGISTRATION for issue in said):
        return [*said, *plain]
    data, vjm = registered.data, registered.vjm
    size = np.median(np.linalg.norm(data.deflection, axis=2)[data.seen])
    if vjm.arm.joints and size > HUGE_DEFLECTION * placed.observations.scale:
        station_data = submission.data if registered.frame == "base" else _of_one_station(submission.data)
        loaded, _ = best_hypothesis(
            _observations(vjm, station_data, station_data.after, _free_parameters(registered)),
            hypotheses.kinematics,
            "loaded",
        )
        if loaded is not None:
            return [loaded, *said]
    loads = LoadedRuns(vjm, scale_by_prior(prior, vjm, all153(vjm.arm)), data, gravity_by_tracker(registered))
    if against := listed_issues(data, hypotheses.work):
        hung = _mounting_issue(loads, placed.observations)
        return [*hung, *said, *([] if hung else against)]
    off = listed_issues(placed, hypotheses.single_poses)
    said += off
    wrong = [issue.numbers["pose"] for issue in off]
    loads = replace(loads, data=select(data, ~np.isin(data.pose, wrong)) if off else data)
    if not loads.data.seen.any():
        return said
    moved = moves_in_time(vjm, loads.data, prior)
    pushed = _load_issues(loads, hypotheses)
    if any(issue.name == "mounting" for issue in pushed):
        return [*pushed, *said]
    runs = {row.name for row in hypotheses.single_runs}
    if all(issue.name in runs for issue in pushed):  # else a mistake of all loads may look like a step
        return [*moved, *said, *pushed]
    return [*said, *pushed, *moved]


def _along_lines(registered: RegisteredDataset, prior: Prior, hypotheses: Hypotheses) -> list[Issue]:
    """Find mistakes of loads and readings along lines; these do not show where targets or trackers are."""
    data, vjm = registered.data, registered.vjm
    if against := listed_issues(data, hypotheses.work):
        return against
    loads = LoadedRuns(vjm, scale_by_prior(prior, vjm, all153(vjm.arm)), data, None)
    every = tuple(row for row in hypotheses.all_loads if row.name != "tracker_moved")
    return _load_issues(loads, replace(hypotheses, all_loads=every))


def _placed(submission: Submission, hypotheses: Hypotheses) -> tuple[list[Issue], FittedObservations]:
    """Find mistakes about the places of arm, targets and tracker; return the readings with their fit too."""
    registered = submission.registered
    if registered.frame == "base" or not submission.declared:
        observations = _observations(submission.folder_model, submission.data, submission.data.before)
        raw, best_fit = best_hypothesis(observations, hypotheses.kinematics)
        if registered.registration is None and raw is not None and raw.name in ("frame", "kinematics"):
            # a tracker's frame is no mistake; the reason that it was not found is one
            raw = unplaced_runs(submission.folder_model, submission.data, hypotheses) or (
                raw if raw.name == "frame" else None
            )
        mistaken = raw is not None and raw.name not in ("frame", "kinematics")
        if registered.frame == "base" or mistaken:
            return ([] if raw is None else [raw]), FittedObservations(observations, best_fit)
    data = _of_one_station(submission.data)
    issue, _ = best_hypothesis(
        _observations(registered.vjm, data, data.before, _free_parameters(registered)), hypotheses.kinematics
    )
    observations = _observations(registered.vjm, registered.data, registered.data.before)
    return ([issue] if issue else listed_issues(submission, hypotheses.registration)), FittedObservations(
        observations, fit(observations)
    )


def unplaced_runs(vjm: Vjm, data: Dataset, hypotheses: Hypotheses = HYPOTHESES) -> Issue | None:
    """Find the mistake that keeps readings from being brought into the base's frame.

    Args:
        vjm: The arm as its folder has it.
        data: Runs of one or several stations.
        hypotheses: The table of mistakes.

    Returns:
        The mistake; "kinematics" when the readings do not fit and no hypothesis explains them; None when they
        fit.
    """
    names = np.zeros(data.runs) if data.station is None else data.station
    every = [select(data, names == name) for name in np.unique(names)]
    free = FreeParameters(frame=True, targets=True)
    issues = [
        best_hypothesis(_observations(vjm, runs, runs.before, free), hypotheses.kinematics)[0]
        for runs in every
    ]
    return min(filter(None, issues), key=lambda issue: issue.name == "kinematics", default=None)


def unplaced_series(vjm: Vjm, series: Series) -> Issue | None:
    """Find the mistake that keeps absolute readings from fitting the arm in any frame.

    Args:
        vjm: The arm as its folder has it.
        series: The readings.

    Returns:
        The mistake; "kinematics" when the readings do not fit and no hypothesis explains them; None when they
        fit.
    """
    if series.distance is not None:
        return None
    return best_hypothesis(of_series(vjm, series), HYPOTHESES.kinematics, "all")[0]


def _mounting_issue(loads: LoadedRuns, observations: Observations) -> list[Issue]:
    """Name the mounting of the base if it makes targets move against stated weights."""
    vjm, data = loads.vjm, loads.data
    pull = suspected_gravity(vjm, loads.scaling, data, loads.level)
    if pull is None:
        return []
    if angle(pull.g, DOWN) > REVERSED_ANGLE and not pull.confirmed_by_level:
        model = loads.scaling
        pi = abs(deflection_scale(vjm, model, data)) * (model.L @ model.expected)
        if not sags_like_hanging(
            observations, _observations(vjm, data, data.after), model.structure.matrix(pi)
        ):
            return []
    return [mounting(vjm, pull)]


def _load_issues(loads: LoadedRuns, hypotheses: Hypotheses) -> list[Issue]:
    """Find mistakes of loads: of all runs from a part of the runs, of single runs from all."""
    data = loads.data
    readings_per_run = len(data.markers) + (data.sigma_rotation is not None)
    parts = max(1, -(-data.runs // max(1, min(RUNS_AT_A_TIME, MAX_READINGS // readings_per_run))))
    subsets = [select(data, np.arange(data.runs) % parts == k) for k in range(min(parts, MAX_PARTS))]
    issues = load_issues(replace(loads, data=subsets[0]), hypotheses.all_loads, hypotheses.single_runs)
    runs = {row.name for row in hypotheses.single_runs}
    if any(issue.name not in runs for issue in issues):
        return issues
    for subset in stepwise(subsets[1:], "looking for mistakes"):
        more = load_issues(replace(loads, data=subset), hypotheses.all_loads, hypotheses.single_runs)
        issues += [issue for issue in more if issue.name in runs]
    return sorted(issues, key=lambda issue: -(issue.nats or 0))


def _of_one_station(data: Dataset) -> Dataset:
    """Select the runs of the station that read most of them."""
    if data.station is None:
        return data
    names, count = np.unique(data.station, return_counts=True)
    return select(data, data.station == names[count.argmax()])


def _free_parameters(registered: RegisteredDataset) -> FreeParameters:
    return FreeParameters(frame=registered.frame == "tracker", targets=registered.frame == "tracker")


def _observations(
    vjm: Vjm, data: Dataset, position: Array, free: FreeParameters = NO_PARAMETERS
) -> Observations:
    """Collect readings, unloaded or loaded, of the runs that have unloaded readings of their own."""
    every = np.concatenate([data.q, np.nan_to_num(data.before.reshape(data.runs, -1))], axis=1)
    runs = np.sort(np.unique(every, axis=0, return_index=True)[1])  # several loads of a pose may share them
    return Observations(
        vjm=vjm,
        q=data.q[runs],
        markers=marker_points(vjm, data.markers),
        position=position[runs],
        seen=data.seen[runs],
        scale=SOUND_DISTANCE * vjm.reach,
        names=data.markers,
        runs=data.run[runs],
        poses=data.pose[runs],
        free=free,
    )


# --- Moves between two readings -----------------------------------------------------------------------------

MAX_P_VALUE = 0.05
"""Probability of a step as clear in sound readings, above which a step is not reported."""
MIN_POSES = 3  #: Poses before and behind a step that is reported.
MAX_ORDER = 2  #: Highest order of periodic errors that may explain a step: few poses determine no more.
MAX_TARGETS = 30
"""Targets that are used, evenly chosen out of more: all move together, and each adds unknowns."""
MOUNT_NAME = "targets"  #: Name of the mount in reports.


def moves_in_time(vjm: Vjm, data: Dataset, prior: Prior) -> list[Issue]:
    """Find moves of tracker or targets between two readings of runs, at most one step per station.

    It is the step that `calibrate` looks for (`moves`): from one reading on all lie elsewhere than the arm
    says, by a move that no error of geometry, spring or slow joint error explains. Only steps count whose
    chance is below MAX_P_VALUE divided by twice the number of places.

    Args:
        vjm: The arm's virtual joint model, with targets as measured.
        data: Runs in the base's frame, in order of time.
        prior: Prior of the compliances, from the arm's folder.

    Returns:
        Moves of targets, then of trackers; none when there are too few readings. In their numbers `before`
        and `after`, 2 k is the unloaded reading of run k and 2 k + 1 the loaded one.
    """
    series = tuple(_series_in_time(select_rows(data, select_evenly(np.arange(data.runs)))))
    steps = [step_places(readings, MIN_POSES) for readings in series]
    if not vjm.arm.joints or not any(map(len, steps)):
        return []
    try:
        state, noise = first_fit(
            _folder_state(vjm, series), series, scale_by_prior(prior, vjm, joints_only(vjm.arm))
        )
    except BenchError:  # too few readings to determine arm and targets: no step can be found
        return []
    linear = nuisance_model(state, series, noise, scale_by_prior(prior, vjm, all153(vjm.arm)), MAX_ORDER)
    clear = MAX_P_VALUE / (2 * sum(map(len, steps)))
    moves = [
        with_shift(linear, readings, step)
        for readings, step in most_significant_step(linear, series, steps)
        if p_value(step) < clear
    ]
    moves = [replace(step, numbers={**step.numbers, "pairs": True}) for step in moves]
    return sorted(moves, key=lambda step: step.name)


def _series_in_time(data: Dataset) -> Iterator[Series]:
    """Sort the readings of every station by time; 2 run is an unloaded reading, 2 run + 1 a loaded one.

    An unloaded reading that several loads share is listed once.
    """
    pose = dict(zip(data.run.tolist(), data.pose.tolist(), strict=True))
    stations = 1 if data.station is None else len(np.unique(data.station))
    for every in series_of(data, "station", MOUNT_NAME):
        series = with_targets(every, every.markers[:: -(-len(every.markers) // MAX_TARGETS)])
        loaded = np.arange(series.rows) >= series.rows // 2
        poses = np.array([pose[run] for run in series.row.tolist()])
        read = np.column_stack(
            [poses, loaded, np.where(loaded, series.pose, 0), series.position.reshape(series.rows, -1)]
        )
        first = np.unique(read, axis=0, return_index=True)[1]
        first = first[np.argsort((2 * series.pose + loaded)[first])]
        name = series.frame if stations > 1 else ""
        yield select_rows(replace(series, name=name, row=2 * series.row + loaded, pose=poses), first)


def _folder_state(vjm: Vjm, series: tuple[Series, ...]) -> ArmState:
    """Build the arm as its folder has it, in the base's frame."""
    weights, markers = weights_with_note(vjm.arm)[0], series[0].markers
    return replace(
        nominal_state(vjm, weights, torque_scale(vjm, weights, series)),
        frames={readings.frame: IDENTITY_FRAME for readings in series},
        mounts={MOUNT_NAME: Mount(marker_points(vjm, markers), np.eye(3), markers)},
    )
