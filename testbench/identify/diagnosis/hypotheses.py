"""The table of mistakes: how each is corrected, its sentence, and the question to the user.

A row is a `Hypothesis`. To add a mistake, write its corrections and its sentence, and append one row to its
part of HYPOTHESES: `docs/add_hypothesis.md` has an example.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, runs_of_station
from testbench.errors import Array, Doubt
from testbench.identify.base_frame import station_number, unloaded_series
from testbench.identify.diagnosis.deflections import (
    MIN_GAIN,
    MIN_GAIN_OF_ALL_LOADS,
    MIN_GAIN_OF_RUN,
    FittedRuns,
    LoadedRuns,
    LoadHypotheses,
    load_levels,
)
from testbench.identify.diagnosis.gravity import mounting_issue, with_gravity_along
from testbench.identify.diagnosis.kinematics import (
    MEDIAN,
    Correction,
    FittedObservations,
    FreeParameters,
    Hypothesis,
    Issue,
    Observations,
    Submission,
    any_component_above,
    any_vector_longer_than,
    cauchy_loss,
    exchanged_order,
    find_row_shift,
    fit_kinematics,
    likely_joint_orders,
)
from testbench.model.vjm import tool_points, tool_poses

MM = 1e3  #: Millimetres per metre.
UNIT_FACTORS = {
    1e-3: "1000 times too large: millimetres read as metres?",
    1e-2: "100 times too large: centimetres read as metres?",
    0.1: "10 times too large: millimetres read as centimetres?",
    0.0254: "39.4 times too large: inches read as metres?",
    1 / 25.4: "25.4 times too large: millimetres read as inches?",
    10.0: "10 times too small: centimetres read as millimetres?",
    25.4: "25.4 times too small: inches read as millimetres?",
    1e3: "1000 times too small: metres read as millimetres?",
}
"""Factors that correct positions in a wrong unit, each with the end of its sentence."""
CHOICE_PARAMETER_COUNT = 2  #: Number of free parameters that a choice among many alternatives counts as.
MIN_FRAME_TURN, MIN_FRAME_SHIFT, MIN_TARGET_SHIFT = np.deg2rad(0.3), 15e-3, 25e-3
"""Least rotation of a frame [rad], shift of a frame or link [m], and shift of a target [m] of an issue."""
#: Differences between usual conventions of the zero of a revolute joint [rad].
ZERO_CONVENTIONS = (np.pi / 2, -np.pi / 2, np.pi)
MIN_JOINT_ZERO_ERROR, LAST_JOINT_ZERO_FACTOR = (np.deg2rad(0.5), 5e-3), 4.0
"""Least error of a joint's zero of an issue, revolute and prismatic [rad, m], and factor on it for the last
joint [1]: errors of targets look like one."""
#: Most targets of which every order of names is tried; of more, the best exchange of two.
MAX_PERMUTED_TARGETS = 4
MIN_TRACKER_DISTANCE, MAX_TARGET_DISTANCE = 0.5, 0.1
"""Least distance of a tracker from the base, and largest of a target from its nominal position [m]."""
#: Distance of a reading from the kinematics, over the expected distance, from which it is wrong [1].
MIN_OUTLIER_RATIO = 8.0
#: Largest distance of a load point from the tool, over the arm's reach [1]; beyond it the unit is wrong.
MAX_LOAD_POINT_DISTANCE = 1.0
MIN_AGAINST_FORCE_SHARE = 0.8  #: Least share of runs whose targets move against the force [1].
PRIOR_FORCE_OFFSET_SHARE, MIN_FORCE_OFFSET_SHARE = 0.1, 0.045
"""Prior deviation, and least size, of a constant force that is missing in all loads, over the largest [1]."""
PRIOR_LOAD_POINT_ERROR, MIN_LOAD_POINT_ERROR = 0.1, 0.05
"""Prior deviation, and least size, of the error of a load point [m]."""
PRIOR_TRACKER_SHIFT, MIN_TRACKER_SHIFT = 1e-3, 4e-4
"""Prior deviation, and least size, of the move of a tracker between two readings [m, rad]."""
PRIOR_LOAD_ERROR, MIN_LEVEL_ERROR, MIN_RUN_LOAD_ERROR = 0.3, 0.08, 0.4
"""Prior deviation of the relative error of a load [1], and least size in a load level and in a single run."""
PRIOR_TARGET_SHIFT = 3e-3  #: Prior deviation of the shift of a target that was touched or misread [m].
MIN_READING_ERROR, MIN_READING_ERROR_SIGMAS = 4e-4, 8.0
"""Least error of a wrong reading [m], and the same in standard deviations of the readings [1]."""
EulerAxes = Literal["XYZ", "xyz", "ZYX", "zyx", "ZYZ", "zyz", "ZXZ", "zxz", ""]
ORIENTATION_NOTATIONS: Mapping[str, EulerAxes] = {
    "intrinsic xyz": "XYZ",
    "extrinsic xyz": "xyz",
    "intrinsic zyx": "ZYX",
    "extrinsic zyx": "zyx",
    "intrinsic zyz": "ZYZ",
    "extrinsic zyz": "zyz",
    "intrinsic zxz": "ZXZ",
    "extrinsic zxz": "zxz",
    "vector": "",
}
"""Usual notations of an orientation by three numbers: the name in a map, and SciPy's axes."""
KinematicCorrections = Iterator[Correction[Observations]]
LoadCorrections = Iterator[Correction[LoadedRuns]]
SizedCorrections = Iterator[Correction[FittedRuns]]


# --- Without a fit: copied readings, absurd load points, moves against the force ----------------------------


def _equal(submission: Submission) -> Iterator[Correction[Submission]]:
    """Find loaded readings that equal the unloaded readings of their run."""
    data = submission.data
    loaded = np.asarray(data.wrench.any(axis=1))[:, None] & data.is_measured
    still = np.asarray(loaded & (data.deflection == 0).all(axis=2))
    if still.any():
        first = str(data.run_id[still.any(axis=1)][0])
        yield Correction((first,), details={"count": int(still.sum()), "of": int(loaded.sum())})


def _equal_sentence(issue: Issue, _: Arm) -> str:
    return f"loaded and unloaded readings are equal, {_count_text(issue)}, the first in run {issue.where[0]}"


def _count_text(issue: Issue) -> str:
    return "{count} of {of}".format(**issue.details)


def _repeated(submission: Submission) -> Iterator[Correction[Submission]]:
    """Find a run whose loaded readings are those of another pose."""
    data = submission.data
    read = np.where(data.is_measured[..., None], data.after, np.nan).reshape(data.n_runs, -1)
    _, first, group = np.unique(read, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero((data.q != data.q[first[group]]).any(axis=1) & data.is_measured.any(axis=1))
    if len(again):
        yield Correction((str(data.run_id[again[0]]), str(data.run_id[first[group[again[0]]]])))


def _far_load(submission: Submission) -> Iterator[Correction[Submission]]:
    away, reach = float(np.linalg.norm(submission.data.point, axis=1).max()), submission.vjm.reach
    if away > MAX_LOAD_POINT_DISTANCE * reach:
        yield Correction(details={"away": away, "reach": reach})


def _against(data: Dataset) -> Iterator[Correction[Dataset]]:
    """Count runs whose targets move against the force: an elastic arm yields along it."""
    force = data.wrench[:, :3]
    work = np.einsum("rx,rmx->r", force, np.where(data.is_measured[..., None], data.deflection, 0))
    against, pushed = int((work < 0).sum()), int(force.any(axis=1).sum())  # others turn by a moment alone
    if against and against >= MIN_AGAINST_FORCE_SHARE * pushed:
        yield Correction(details={"count": against, "of": pushed})


# --- By registration: a frame too near for a tracker, targets far from their nominal positions --------------


def _near_frame(submission: Submission) -> Iterator[Correction[Submission]]:
    """Find a frame of a tracker that is too near the base."""
    registration = submission.registered_runs.registration
    if registration is None or submission.registered_runs.frame != "tracker" or submission.frame_stated:
        return
    near = [f for f in registration.frames.values() if np.linalg.norm(f.translation) < MIN_TRACKER_DISTANCE]
    for frame in near[:1]:
        yield Correction(size=np.concatenate([frame.rotation_vector, frame.translation]))


def _far_targets(submission: Submission, *, exchanged: bool) -> Iterator[Correction[Submission]]:
    """Find targets that are far from their nominal places, or at the nominal places of others."""
    registration = submission.registered_runs.registration
    if registration is None:
        return
    targets, nominal = registration.targets, registration.nominal_targets
    distance = np.linalg.norm(targets - nominal, axis=1)
    far = np.flatnonzero(distance > MAX_TARGET_DISTANCE)
    if not len(far):
        return
    # Exchanged: every target that is far from its own place is near that of another one.
    between = np.linalg.norm(targets[far, None] - nominal[None, far], axis=2)
    if (len(far) > 1 and bool((between.min(axis=1) < MAX_TARGET_DISTANCE).all())) != exchanged:
        return
    if exchanged:
        yield Correction(tuple(registration.target_names[k] for k in far))
    else:
        worst = int(distance.argmax())
        yield Correction((registration.target_names[worst],), targets[worst] - nominal[worst])


# --- Readings against the kinematics ------------------------------------------------------------------------


def _alternative(
    corrected: Observations, where: tuple[str, ...] = (), size: Sequence[float] = (), more_parameters: int = 0
) -> Correction[Observations]:
    """Make the correction of one of many alternatives; the choice counts as several parameters."""
    count = CHOICE_PARAMETER_COUNT + more_parameters
    return Correction(where, np.array(size), corrected_data=corrected, parameter_count=count)


def _frame(observations: Observations) -> KinematicCorrections:
    if not observations.free_parameters.frame:
        yield Correction(
            corrected_data=observations.with_free(frame=True),
            is_large=any_vector_longer_than(MIN_FRAME_TURN, MIN_FRAME_SHIFT),
        )


def _frame_sentence(issue: Issue, _: Arm) -> str:
    turn, at = issue.size[:3], _vector_text(issue.size[3:], MM, 0)
    angle = float(np.linalg.norm(turn))
    words = f"are in a frame turned by {np.rad2deg(angle):.3g} deg about "
    words += f"({_vector_text(turn / max(angle, 1e-12), 1, 2)}) and moved by ({at}) mm against the arm's base"
    if issue.reading_kind is not None:
        return words
    how = "where no tracker can stand; the fitted frame is used, unless --frame states another"
    return f"the readings {words}, {how}"


def _targets(observations: Observations) -> KinematicCorrections:
    if not observations.free_parameters.targets:
        yield Correction(
            corrected_data=observations.with_free(targets=True),
            is_large=any_vector_longer_than(MIN_TARGET_SHIFT),
        )


def _targets_sentence(issue: Issue, _: Arm) -> str:
    [name] = issue.where
    off = f"{MM * np.linalg.norm(issue.size):.0f} mm from where the arm's folder has it on the tool"
    return f"{name} is {off}" if issue.reading_kind is None else f"have {name} {off}"


def _mirrored(observations: Observations) -> KinematicCorrections:
    yield Correction(corrected_data=observations.with_free(frame=True, mirrored=True))


def _link(observations: Observations) -> KinematicCorrections:
    for k, link in enumerate(observations.vjm.arm.links[1:-1], start=1):
        yield Correction(
            (link.name,),
            corrected_data=observations.with_free(theta=(6 * k, 6 * k + 1, 6 * k + 2)),
            is_large=any_vector_longer_than(MIN_FRAME_SHIFT),
        )


def _joint_zero(observations: Observations) -> KinematicCorrections:
    """Try a zero error of any size, and quarter and half turns, which no linear fit finds.

    A half turn of a wrist may as well be a reversed sign, which is more probable: it counts as one parameter
    more.
    """
    joints, links = observations.vjm.arm.joints, 6 * len(observations.vjm.arm.links)
    for k, joint in enumerate(joints):
        is_large = any_component_above(
            (LAST_JOINT_ZERO_FACTOR if k == len(joints) - 1 else 1.0) * MIN_JOINT_ZERO_ERROR[joint.prismatic]
        )
        yield Correction(
            (joint.name,),
            np.zeros(1),
            corrected_data=observations.with_free(theta=(links + k,)),
            parameter_count=1,
            is_large=is_large,
        )
        for turn in () if joint.prismatic else ZERO_CONVENTIONS:
            corrected = replace(observations, q=observations.q + turn * np.eye(len(joints))[k])
            yield _alternative(corrected, (joint.name,), [turn], more_parameters=1)


def _joint_zero_sentence(issue: Issue, arm: Arm) -> str:
    [name] = issue.where
    ends = {arm.joints[-1].name: ", or the tool is", arm.joints[0].name: ", or the frame is turned about it"}
    return f"fit if the zero of {name} is off by {_angle_text(arm, name, issue.size[0])}{ends.get(name, '')}"


def _markers(observations: Observations) -> KinematicCorrections:
    """Try other names of the targets: every order of a few; of more, the exchange of two that fits best."""
    m = len(observations.markers)
    if observations.free_parameters.targets_unknown:  # no target has a known place
        return
    orders = list(permutations(range(m)))[1:] if m <= MAX_PERMUTED_TARGETS else [_best_exchange(observations)]
    for order in orders:
        wrong = tuple(observations.target_names[k] for k, other in enumerate(order) if k != other)
        corrected = replace(
            observations,
            position=observations.position[:, order],
            is_measured=observations.is_measured[:, order],
        )
        yield _alternative(corrected, wrong)


def _best_exchange(observations: Observations) -> tuple[int, ...]:
    """Find the exchange of two targets that lowers the loss most, as an order of the targets."""
    frame, m = fit_kinematics(observations).frame, len(observations.markers)
    x = (
        tool_points(observations.vjm, observations.q, observations.markers) @ frame.rotation.T
        + frame.translation
    )
    pairs = np.empty((m, m))  # of a place and the target that was read there
    for k in range(m):
        pairs[k] = cauchy_loss(
            np.where(observations.is_measured[..., None], x[:, [k]] - observations.position, 0),
            observations.expected_distance,
        ).sum(axis=0)
    unexchanged = np.diag(pairs)
    change = pairs + pairs.T - unexchanged - unexchanged[:, None]
    change[np.diag_indices(m)] = np.inf
    i, j = divmod(int(change.argmin()), m)
    return tuple(exchanged_order(m, i, j))


def _markers_sentence(issue: Issue, _: Arm) -> str:
    names = ", ".join(issue.where)
    if issue.reading_kind is None:
        return f"targets {names} are at each other's places: are their names exchanged?"
    return f"fit if the names of {names} are exchanged"


def _unit(observations: Observations) -> KinematicCorrections:
    for factor in UNIT_FACTORS:
        yield _alternative(replace(observations, position=factor * observations.position), size=[factor])


def _angle_unit(observations: Observations) -> KinematicCorrections:
    for factor in (np.rad2deg(1), np.deg2rad(1)):
        corrected = replace(
            observations, q=np.where(observations.vjm.arm.hinges, factor * observations.q, observations.q)
        )
        yield _alternative(corrected, size=[factor])


def _angle_unit_sentence(issue: Issue, _: Arm) -> str:
    return (
        f"fit if joint angles are {'radians, not degrees' if issue.size[0] > 1 else 'degrees, not radians'}"
    )


def _order(observations: Observations) -> KinematicCorrections:
    """Try the readings of the previous or the next pose, from the first row on or from a later one."""
    for shift in (1, -1):
        yield _alternative(replace(observations, q=np.roll(observations.q, shift, axis=0)), size=[shift])
    if slip := find_row_shift(observations):
        first = str(observations.run_id[slip.first_row])
        yield _alternative(replace(observations, q=slip.q), (first,), [slip.shift], more_parameters=1)


def _order_sentence(issue: Issue, _: Arm) -> str:
    row = "row" if issue.reading_kind == "all" else "run"
    since = f" from {row} {issue.where[0]} on" if issue.where else ""
    return f"belong to the {'previous' if issue.size[0] > 0 else 'next'} pose{since}"


def _joint_sign(observations: Observations) -> KinematicCorrections:
    for k, joint in enumerate(observations.vjm.arm.joints):
        sign = np.where(np.arange(observations.q.shape[1]) == k, -1, 1)
        yield _alternative(replace(observations, q=observations.q * sign), (joint.name,))


def _joint_coupling(observations: Observations) -> KinematicCorrections:
    """Try usual couplings; `where` holds for each joint its name, "+" or "-" and the other joint's name.

    A pendant's third joint includes the second one if a linkage drives it, or if its angle is counted against
    the floor (FANUC, ABB, Yaskawa). The motors of a wrist also turn the joints behind it.
    """
    joints, n = observations.vjm.arm.joints, len(observations.vjm.arm.joints)
    wrist = n - 3
    usual: list[tuple[tuple[int, int], ...]] = [((2, 1),)] if n > 2 else []
    if n > 4:
        usual += [((wrist + 1, wrist),), ((wrist + 2, wrist),), ((wrist + 2, wrist + 1),)]
        usual += [((wrist + 1, wrist), (wrist + 2, wrist))]
    for pairs in usual:
        if any(joints[k].prismatic for pair in pairs for k in pair):
            continue
        for signs in product((1, -1), repeat=len(pairs)):
            q, where = observations.q.copy(), list[str]()
            for (j, i), sign in zip(pairs, signs, strict=True):
                q[:, j] += sign * observations.q[:, i]
                where += [joints[j].name, "+" if sign > 0 else "-", joints[i].name]
            yield _alternative(replace(observations, q=q), tuple(where))


def _joint_coupling_sentence(issue: Issue, _: Arm) -> str:
    triples = list(zip(issue.where[0::3], issue.where[1::3], issue.where[2::3], strict=True))
    sums = " and ".join(f"{joint} is the file's {joint} {sign} {other}" for joint, sign, other in triples)
    return f"fit if {sums}: does the robot count {triples[0][0]} together with {triples[0][2]}?"


def _joint_order(observations: Observations) -> KinematicCorrections:
    """Try the most probable orders of the joints in the file."""
    names = [joint.name for joint in observations.vjm.arm.joints]
    for order in likely_joint_orders(observations):
        where = tuple(names[k] for k in np.argsort(order))
        yield _alternative(replace(observations, q=observations.q[:, order]), where)


def _axes(observations: Observations) -> KinematicCorrections:
    """Try positions with one axis reversed, or two exchanged; only orientations can show it."""
    if observations.rotation is None:
        return
    position = observations.position[:, : len(observations.target_names)]
    for k, name in enumerate("xyz"):
        flipped = observations.with_orientations(
            position * np.where(np.arange(3) == k, -1.0, 1.0), observations.rotation
        )
        yield _alternative(flipped, (name,))
    for i, j in combinations(range(3), 2):
        exchanged = observations.with_orientations(
            position[..., exchanged_order(3, i, j)], observations.rotation
        )
        yield _alternative(exchanged, ("xyz"[i], "xyz"[j]))


def _axes_sentence(issue: Issue, _: Arm) -> str:
    if len(issue.where) == 2:
        return f"fit if {issue.where[0]} and {issue.where[1]} of the positions are exchanged"
    return f"fit if {issue.where[0]} of the positions has the other sign"


def _notation(observations: Observations) -> KinematicCorrections:
    """Try other notations of the orientations, as meant and as read; equal results count once."""
    if observations.rotation is None:
        return
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    position, rotations = observations.position[:, : len(observations.target_names)], observations.rotation
    rotations = np.where(np.isfinite(rotations).all(axis=(1, 2), keepdims=True), rotations, np.eye(3))
    R, by_rotation = Rotation.from_matrix(rotations), dict[bytes, tuple[tuple[str, ...], Array]]()
    for (read, axes), (meant, order) in product(ORIENTATION_NOTATIONS.items(), ORIENTATION_NOTATIONS.items()):
        if meant == read:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # two angles about one axis: any pair of them will do
            numbers = R.as_euler(axes) if axes else R.as_rotvec()
        matrix = (Rotation.from_euler(order, numbers) if order else Rotation.from_rotvec(numbers)).as_matrix()
        same = (matrix.round(3) + 0.0).tobytes()
        names, _ = by_rotation.get(same, ((), matrix))
        by_rotation[same] = (*names, meant, read), matrix
    for names, rotation in (((), rotations.swapaxes(1, 2)), *by_rotation.values()):
        yield _alternative(observations.with_orientations(position, rotation), names)


def _notation_sentence(issue: Issue, _: Arm) -> str:
    if not issue.where:
        return "fit if orientations are inverted: the tracker's in the target's frame"
    ways = zip(issue.where[0::2], issue.where[1::2], strict=True)
    return "fit if orientations are " + ", or ".join(f"{a} instead of {b}" for a, b in ways)


# --- Single poses and readings that do not fit while most do ------------------------------------------------


def _off_poses(placed: FittedObservations, *, whole_poses: bool) -> Iterator[Correction[FittedObservations]]:
    """Find poses of which most readings do not fit, with the cause; or single readings that do not fit."""
    observations, far = placed.observations, MIN_OUTLIER_RATIO * placed.observations.expected_distance
    off = np.linalg.norm(placed.fit.residual, axis=2)
    for row in np.flatnonzero((off > far).any(axis=1)).tolist():
        run, typical = (
            str(observations.run_id[row]),
            float(np.median(off[row][observations.is_measured[row]])),
        )
        pose = {"pose": int(observations.pose_id[row])}
        if (typical > far / 2) != whole_poses:
            continue
        if whole_poses:
            where, size = _explain_pose(placed, row, far)
            yield Correction((run, *where), size, {"off": typical, **pose})
        else:
            k = int(np.argmax(off[row]))
            yield Correction((run, observations.target_names[k]), details={"off": float(off[row, k]), **pose})


def _explain_pose(placed: FittedObservations, row: int, far: float) -> tuple[tuple[str, ...], Array]:
    """Find targets of a pose that may be exchanged, or a joint whose angle may be larger.

    Returns their names, and by how much the joint is larger, (1,) [rad, m]; (0,) for targets.
    """
    frame, observations = placed.fit.frame, placed.observations.select(np.array([row]))
    observations = replace(
        observations,
        position=(observations.position - frame.translation) @ frame.rotation,
        markers=placed.fit.markers,
        free_parameters=FreeParameters(),
    )
    # Other conventions of a joint's zero concern all poses: of its corrections only the free one is tried.
    joints = [correction for correction in _joint_zero(observations) if not correction.size.any()]
    for corrections in (list(_markers(observations)), joints):
        refits = [(each, fit_kinematics(each.corrected_data)) for each in corrections if each.corrected_data]
        good = [(each, refit) for each, refit in refits if refit.distance_quantile(observations) < far]
        if good:
            correction, refit = min(good, key=lambda pair: pair[1].loss)
            return correction.where, refit.theta[refit.theta != 0]
    return (), np.zeros(0)


def _pose_sentence(issue: Issue, arm: Arm) -> str:
    run, *names = issue.where
    words = "is its pose right?"
    if len(issue.size):
        words = f"they fit if {names[0]} is {_angle_text(arm, names[0], issue.size[0])} larger"
    elif names:
        words = f"they fit if the names of {', '.join(names)} are exchanged"
    return f"run {run}: its unloaded readings lie {length_text(issue.details['off'])} off: {words}"


# --- Loads and deflections ----------------------------------------------------------------------------------


def _mounting(loads: LoadedRuns) -> LoadCorrections:
    if loads.suspected_gravity is not None:
        issue = mounting_issue(loads.vjm, loads.suspected_gravity)
        data = with_gravity_along(loads.data, loads.suspected_gravity.g)
        yield Correction(issue.where, issue.size, issue.details, corrected_data=replace(loads, data=data))


def _mounting_sentence(issue: Issue, _: Arm) -> str:
    down, turn = issue.size[:3], issue.size[3:]
    tilt = float(np.rad2deg(np.arccos(np.clip(-down[2], -1.0, 1.0))))
    axis = int(np.abs(down).argmax())
    along = f"gravity along {'-+'[bool(down[axis] > 0)]}{'xyz'[axis]} of its base"
    how = "the arm hangs" if axis == 2 else "the arm stands on a wall"
    if abs(down[axis]) < np.cos(np.deg2rad(3)):
        how = f"the base is tilted by {tilt:.0f} deg"
        along = f"gravity along ({_vector_text(down, 1, 2)}) of its axes"
    known = "the sag in the unloaded readings agrees" * (tilt > 120)  # weights pull upwards
    known = "the level tracker agrees" if issue.details["tracker_agrees"] else known
    quat = " ".join(f"{round(float(x), 4) + 0.0:g}" for x in turn)
    state = f'state it as quat="{quat}" of the body {issue.where[0]} in rigid.xml'
    return f"the readings fit if {how}: {along}{f' ({known})' * bool(known)}; {state}"


def _sized_correction(
    fitted: FittedRuns, prior_deviation: float, min_size: float, corrected: Sequence[Dataset]
) -> Correction[FittedRuns]:
    """Describe a mistake of unknown size by data sets with one prior deviation of it corrected in each."""
    Z = fitted.mistake_jacobian(corrected)
    return Correction(jacobian=Z, prior_deviation=prior_deviation, is_large=any_component_above(min_size))


def _force_offset(fitted: FittedRuns) -> SizedCorrections:
    data, largest = fitted.runs.data, fitted.runs.largest_force
    if largest > 0:
        size = PRIOR_FORCE_OFFSET_SHARE * largest
        corrected = [replace(data, wrench=data.wrench + size * e) for e in np.eye(6)[:3]]
        yield _sized_correction(fitted, size, MIN_FORCE_OFFSET_SHARE * largest, corrected)


def _load_point(fitted: FittedRuns) -> SizedCorrections:
    data = fitted.runs.data
    corrected = [replace(data, point=data.point + PRIOR_LOAD_POINT_ERROR * e) for e in np.eye(3)]
    yield _sized_correction(fitted, PRIOR_LOAD_POINT_ERROR, MIN_LOAD_POINT_ERROR, corrected)


def _load_point_sentence(issue: Issue, _: Arm) -> str:
    if "reach" in issue.details:
        words = (
            "the load acts {away:.3g} m from the tool, but the arm reaches {reach:.3g} m: is it in "
            "millimetres?"
        )
        return words.format(**issue.details)
    return f"the load acts ({_vector_text(issue.size, MM, 0)}) mm from the stated point, in the tool's axes"


def _touched_tracker(fitted: FittedRuns) -> SizedCorrections:
    """Try a tracker, of each station, that moved between the two readings of every run."""
    data, y = fitted.runs.data, fitted.runs.data.after
    if data.is_line_reading.any():  # a gauge has no tracker
        return
    moves = [*np.eye(3), *(np.cross(e, y - y[data.is_measured].mean(axis=0)) for e in np.eye(3))]
    for name in (station_number(series.frame) for series in unloaded_series(data)):
        here = PRIOR_TRACKER_SHIFT * runs_of_station(data, name)[:, None, None]
        corrected = [replace(data, after=y - here * move) for move in moves]
        correction = _sized_correction(fitted, PRIOR_TRACKER_SHIFT, MIN_TRACKER_SHIFT, corrected)
        yield replace(correction, where=() if data.station is None else (str(name),))


def _level(fitted: FittedRuns) -> SizedCorrections:
    """Try a wrong factor of the loads of each load level."""
    data, levels = fitted.runs.data, load_levels(fitted.runs.data)
    for level in levels if len(levels) > 1 else ():
        force = float(np.linalg.norm(data.wrench[level, :3], axis=1).mean())
        corrected = replace(data, wrench=data.wrench * (1 + PRIOR_LOAD_ERROR * level)[:, None])
        correction = _sized_correction(fitted, PRIOR_LOAD_ERROR, MIN_LEVEL_ERROR, [corrected])
        yield replace(correction, details={"force": force})


def _force_axes(loads: LoadedRuns) -> LoadCorrections:
    """Try wrenches in the tool's axes, and wrenches with permuted or reversed axes."""
    data, w = loads.data, loads.data.wrench.reshape(-1, 2, 3)

    def with_wrenches(wrench: Array) -> LoadedRuns:
        return replace(loads, data=replace(data, wrench=wrench.reshape(-1, 6)))

    turned = np.einsum("rxy,rky->rkx", tool_poses(loads.vjm, data.q)[1], w)
    yield Correction(("tool",), corrected_data=with_wrenches(turned))
    for order, sign in product(list(permutations(range(3)))[1:], (1, -1)):
        where = "".join("xyz"[k] for k in order), "+" if sign > 0 else "-"
        yield Correction(where, corrected_data=with_wrenches(sign * w[:, :, list(order)]))


def _force_axes_sentence(issue: Issue, _: Arm) -> str:
    if issue.where == ("tool",):
        return "the readings fit if forces are in the tool's axes"
    order, sign = issue.where
    minus = "" if sign == "+" else ", with the other sign"
    return f"the readings fit if the forces' axes x, y, z are {', '.join(order)}{minus}"


def _levels(loads: LoadedRuns) -> LoadCorrections:
    """Try loads that were listed in reversed order."""
    data, levels = loads.data, load_levels(loads.data)
    if len(levels) < 2:
        return
    sizes = [np.linalg.norm(data.wrench[level, :3], axis=1).mean() for level in levels]
    factor = np.ones(data.n_runs)
    for level, size, other in zip(levels, sizes, sizes[::-1], strict=True):
        factor[level] = other / size
    yield Correction(corrected_data=replace(loads, data=replace(data, wrench=data.wrench * factor[:, None])))


def _equations_of_runs(fitted: FittedRuns) -> Iterator[tuple[str, tuple[int, int]]]:
    """Yield the name of every run and the range of its equations, three per reading."""
    run = fitted.model.readings.run_index
    for r, name in enumerate(map(str, fitted.runs.data.run_id)):
        first, end = np.searchsorted(run, [r, r + 1])
        if first < end:
            yield name, (3 * int(first), 3 * int(end))


def _run_load(fitted: FittedRuns) -> SizedCorrections:
    """Try a wrong factor of the load of each run."""
    deflections = (fitted.model.readings.A @ fitted.model.pi).ravel()
    for name, equations in _equations_of_runs(fitted):
        yield Correction(
            (name,),
            jacobian=PRIOR_LOAD_ERROR * deflections[slice(*equations), None],
            equation_range=equations,
            prior_deviation=PRIOR_LOAD_ERROR,
            is_large=any_component_above(MIN_RUN_LOAD_ERROR),
        )


def _displaced_targets(fitted: FittedRuns, *, all_targets: bool) -> SizedCorrections:
    """Try displaced targets of one run, each displaced independently: all of them, or one."""
    model, data = fitted.model, fitted.runs.data
    size = PRIOR_TARGET_SHIFT / np.repeat(model.readings.standard_deviation, 3)
    least = float(np.max([MIN_READING_ERROR, MIN_READING_ERROR_SIGMAS * data.sigma * model.misfit]))

    def is_large(displacement: Array) -> bool:
        return bool(np.linalg.norm(displacement) > least)

    for name, every in _equations_of_runs(fitted):
        for equations in [every] if all_targets else [(k, k + 3) for k in range(*every, 3)]:
            target = model.readings.marker_index[equations[0] // 3]
            label = () if all_targets or target < 0 else (data.markers[target],)
            yield Correction(
                (name, *label),
                jacobian=np.diag(size[slice(*equations)]),
                equation_range=equations,
                prior_deviation=PRIOR_TARGET_SHIFT,
                is_large=is_large,
            )


def _reading_sentence(issue: Issue, _: Arm) -> str:
    run, target = (*issue.where, "the tool's turn")[:2]
    if "off" in issue.details:
        return f"run {run}: {target} was read {length_text(issue.details['off'])} off, the others were not"
    off = f"{target} is {_distance(issue):.2g} mm from where the other readings place it"
    return f"run {run}: {off}: was it touched, or read wrongly?"


def _run_load_sentence(issue: Issue, _: Arm) -> str:
    b = issue.size[0]
    hint = "is its mass right?" if b > -1 else "are before and after exchanged?"
    return f"run {issue.where[0]}: the deflections are those of {1 + b:.2f} times the stated load: {hint}"


def _distance(issue: Issue) -> float:
    """Compute the root mean square displacement of all targets [mm]."""
    return MM * float(np.linalg.norm(issue.size)) / math.sqrt(len(issue.size) / 3)


# --- Moves between two readings -----------------------------------------------------------------------------


def _moved_sentence(issue: Issue, _: Arm) -> str:
    """Describe a tracker that moved between the readings of every run, or a move between two rows."""
    size, b = issue.details, issue.size
    if not size:
        which = f"the loaded readings of station {issue.where[0]}" if issue.where else "all loaded readings"
        turn = f"({_vector_text(b[3:], MM, 2)}) mrad"
        return (
            f"{which} are moved by ({_vector_text(b, MM, 2)}) mm and turned by {turn}: did the tracker move?"
        )
    what = issue.name.removesuffix("_moved")
    other = {"target": "tracker", "tracker": "target"}[what]
    angle = float(np.linalg.norm(b[3:]))
    turn = f" and turned by {MM * angle:.2g} mrad" if angle > 1e-4 else ""
    moved = f"the {what}{f' or the {other}' * bool(size['alike'])} moved by {MM * size['shift']:.2g} mm{turn}"
    ends = size["before"], size["after"]
    if not size.get("pairs"):
        new = "mounts" if what == "target" else "frames"
        return f"{issue.where[0]}: {moved} between rows {ends[0]} and {ends[1]}, so two {new} are fitted"
    readings = [f"the {'loaded' if row % 2 else 'unloaded'} reading of run {row // 2:.0f}" for row in ends]
    hint = "was it touched?" if what == "target" else "give the runs after it a station of their own"
    across = "; runs with readings on both sides of the move have this error" if size["across"] else ""
    station_ = f"{issue.where[0]}: " if issue.where[0] else ""
    return f"{station_}{moved} between {readings[0]} and {readings[1]}: {hint}{across}"


# --- The table ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Hypotheses:
    """Hold the table of all kinds of mistakes; each part is tested on another kind of data."""

    without_fit: tuple[Hypothesis[Submission], ...]  #: Certain from the runs as they are, without a fit.
    registration: tuple[Hypothesis[Submission], ...]  #: Tested on frames and targets of the registration.
    kinematics: tuple[Hypothesis[Observations], ...]  #: Tested by fitting positions to the kinematics.
    #: Tested on residuals of single poses and readings, once the kinematics fit.
    single_poses: tuple[Hypothesis[FittedObservations], ...]
    force_work: tuple[Hypothesis[Dataset], ...]  #: Tested on the sign of the work that the forces do.
    loads: LoadHypotheses  #: Mistakes in loads and single runs, tested on the deflections.

    @property
    def sentences(self) -> dict[str, tuple[Callable[[Issue, Arm], str], str]]:
        """Return, for each kind of mistake, the function that describes it and the question to the user."""
        parts = (
            *vars(self.loads).values(),
            self.force_work,
            self.single_poses,
            self.kinematics,
            self.registration,
            self.without_fit,
        )
        return {row.name: (row.sentence, row.question) for part in parts for row in part}


HYPOTHESES = Hypotheses(
    without_fit=(
        Hypothesis("equal", _equal, _equal_sentence, "was one of them copied?"),
        Hypothesis(
            "repeated",
            _repeated,
            lambda issue, _: (
                f"run {issue.where[0]} has the loaded readings of run {issue.where[1]}, in another pose"
            ),
            "was it copied?",
        ),
        Hypothesis("load_point", _far_load, _load_point_sentence),
    ),
    registration=(
        Hypothesis("frame", _near_frame, _frame_sentence),
        Hypothesis("markers", partial(_far_targets, exchanged=True), _markers_sentence),
        Hypothesis("targets", partial(_far_targets, exchanged=False), _targets_sentence),
    ),
    kinematics=(
        Hypothesis("frame", _frame, _frame_sentence),
        Hypothesis("targets", _targets, _targets_sentence, many_parameters=True),
        Hypothesis(
            "mirrored",
            _mirrored,
            lambda *_: "lie in a left-handed frame",
            "is the sign of an axis wrong, or are two axes exchanged?",
        ),
        Hypothesis(
            "link",
            _link,
            lambda issue, _: (
                f"fit if the end of {issue.where[0]} is moved by ({_vector_text(issue.size, MM, 0)}) mm, "
                "in its axes"
            ),
            "is this the arm?",
            many_parameters=True,
        ),
        Hypothesis("joint_zero", _joint_zero, _joint_zero_sentence),
        Hypothesis("markers", _markers, _markers_sentence),
        Hypothesis("unit", _unit, lambda issue, _: f"are {UNIT_FACTORS[issue.size[0]]}"),
        Hypothesis("angle_unit", _angle_unit, _angle_unit_sentence),
        Hypothesis("order", _order, _order_sentence),
        Hypothesis("joint_sign", _joint_sign, lambda issue, _: f"fit if {issue.where[0]} has the other sign"),
        Hypothesis("joint_coupling", _joint_coupling, _joint_coupling_sentence),
        Hypothesis(
            "joint_order",
            _joint_order,
            lambda issue, _: f"fit if the joint order in the file is {', '.join(issue.where)}",
        ),
        Hypothesis("notation", _notation, _notation_sentence),
        Hypothesis("axes", _axes, _axes_sentence),
    ),
    single_poses=(
        Hypothesis("pose", partial(_off_poses, whole_poses=True), _pose_sentence),
        Hypothesis("reading", partial(_off_poses, whole_poses=False), _reading_sentence),
    ),
    force_work=(
        Hypothesis(
            "sign",
            _against,
            lambda issue, _: f"in {_count_text(issue)} runs the targets move against the force",
            "are before and after exchanged, or is the force's sign wrong?",
        ),
    ),
    loads=LoadHypotheses(
        mounting=(Hypothesis("mounting", _mounting, _mounting_sentence, min_gain=MIN_GAIN_OF_ALL_LOADS),),
        other_loads=(
            Hypothesis("force_axes", _force_axes, _force_axes_sentence, min_gain=MIN_GAIN_OF_ALL_LOADS),
            Hypothesis(
                "levels",
                _levels,
                lambda *_: "the readings fit if the loads are in reversed order",
                min_gain=MIN_GAIN_OF_ALL_LOADS,
            ),
        ),
        sized=(
            Hypothesis(
                "force_offset",
                _force_offset,
                lambda issue, _: (
                    f"a constant force of ({_vector_text(issue.size, 1, 0)}) N is missing in every load"
                ),
                "is the sensor's zero wrong?",
                min_gain=MIN_GAIN,
            ),
            Hypothesis("load_point", _load_point, _load_point_sentence, min_gain=MIN_GAIN),
            Hypothesis("tracker_moved", _touched_tracker, _moved_sentence, min_gain=MIN_GAIN),
            Hypothesis(
                "level",
                _level,
                lambda issue, _: (
                    f"compared with the other loads, the load of {issue.details['force']:.4g} N acts as if "
                    f"it were {1 + issue.size[0]:.2f} times as large"
                ),
                "is its mass right?",
                min_gain=MIN_GAIN_OF_RUN,
            ),
        ),
        single_runs=(
            Hypothesis("run_load", _run_load, _run_load_sentence, min_gain=MIN_GAIN_OF_RUN),
            Hypothesis(
                "run",
                partial(_displaced_targets, all_targets=True),
                lambda issue, _: (
                    f"run {issue.where[0]}: its targets are {_distance(issue):.2g} mm from where the load "
                    "should move them"
                ),
                min_gain=MIN_GAIN_OF_RUN,
            ),
            Hypothesis(
                "reading",
                partial(_displaced_targets, all_targets=False),
                _reading_sentence,
                min_gain=MIN_GAIN_OF_RUN,
            ),
        ),
    ),
)
"""All mistakes that the diagnosis tests for."""


# --- In words -----------------------------------------------------------------------------------------------


def _scale_sentence(issue: Issue, arm: Arm) -> str:
    """Describe a factor between prior and readings, or name a single reading where no compliance fits."""
    factor = issue.details["factor"]
    if issue.where:
        largest, median = MM * issue.details["largest"], MM * issue.details["median"]
        return (
            f"as a whole the deflections are {factor:.3g} times what the arm's folder predicts; the largest "
            f"is {largest:.4g} mm, {issue.where[0]} in run {issue.where[1]}, the median {median:.4g} mm: "
            "is that reading wrong, or do loaded readings belong to other runs?"
        )
    stated = "" if arm.payload is None else f" (payload {arm.payload:.4g} kg)"
    times = f"{factor:,.0f}" if factor > 100 else f"{factor:.3g}"
    return (
        f"the readings are {times} times what the arm's folder predicts under loads up to "
        f"{issue.details['force']:,.5g} N{stated}: forces in another unit (1 kg is 9.81 N), another load, or "
        "a folder too stiff or too soft?"
    )


SENTENCES_WITHOUT_HYPOTHESIS: Mapping[str, Callable[[Issue, Arm], str]] = {
    "kinematics": lambda issue, _: (
        f"the {_readings_text(issue)} lie {length_text(issue.details['now'])} (median) from the "
        "arm's kinematics, and no single mistake explains that: is this the arm?"
    ),
    "scale": _scale_sentence,
    "target_moved": _moved_sentence,
    "tracker_moved": _moved_sentence,
    "noise": lambda issue, _: (
        f"the readings scatter {issue.details['factor']:.2g} times as much as their noise of "
        f"{1e6 * issue.details['sigma']:.3g} um: is the noise larger, or does the arm not bend like springs?"
    ),
    "never_read": lambda issue, _: (
        f"{issue.where[0]}: targets without any reading are left out: {', '.join(issue.where[1:])}"
    ),
    "unshared": lambda issue, _: (
        f"{issue.where[0]}: its {issue.where[1]} should be shared, but is fitted separately"
    ),
    "not_parted": lambda issue, _: (
        f"{', '.join(issue.where)}: stays one series, because its parts alone do not determine their frames "
        "or mounts"
    ),
}
"""Sentences of issues without a hypothesis: unexplained readings, moves in time, changes by `calibrate`."""


def describe(
    issue: Issue,
    arm: Arm,
    joint_columns: Sequence[tuple[str, str]] = (),
    hypotheses: Hypotheses = HYPOTHESES,
) -> Doubt:
    """Describe an issue in one sentence.

    Args:
        issue: The issue.
        arm: The arm.
        joint_columns: Name and unit of the file's column of every joint, in order; empty if unknown.
        hypotheses: The table of mistakes with which the issue was found.

    Returns:
        The issue's name, sentence and log-likelihood gain.

    Raises:
        KeyError: When neither the table nor SENTENCES_WITHOUT_HYPOTHESIS has a sentence for the issue.
    """
    if issue.name in SENTENCES_WITHOUT_HYPOTHESIS:
        return Doubt(
            issue.name, SENTENCES_WITHOUT_HYPOTHESIS[issue.name](issue, arm), issue.log_likelihood_gain
        )
    sentence, question = hypotheses.sentences[issue.name]
    words = sentence(issue, arm) + (f": {question}" if question else "")
    if "was" in issue.details:
        ends = length_text(issue.details["was"]), length_text(issue.details["now"])
        far = f"median distance from the arm's kinematics {ends[0]}, with this change {ends[1]}"
        if (share := issue.details["share"]) > MEDIAN:
            most = f"{100 * share:.0f} % of them"
            far = f"{most} lie within {ends[0]} of the arm's kinematics, with this change within {ends[1]}"
        words = f"the {_readings_text(issue)} {words} ({far})"
    if issue.name == "joint_order" and len(joint_columns) == len(arm.joints):
        lines = [
            f'{name}_{unit} = "{column}"'
            for name, (column, unit), joint in zip(issue.where, joint_columns, arm.joints, strict=True)
            if name != joint.name
        ]
        words += f"; in a map's [columns]: {', '.join(lines)}"
    return Doubt(issue.name, words, issue.log_likelihood_gain)


def _readings_text(issue: Issue) -> str:
    return "readings" if issue.reading_kind == "all" else f"{issue.reading_kind} readings"


def length_text(metres: float) -> str:
    """Format a length [m] for a sentence: "3.42 mm" below 1 m, "3,420 m" from 1 m on."""
    return f"{MM * metres:.3g} mm" if metres < 1 else f"{metres:,.4g} m"


def _vector_text(vector: Array, factor: float, digits: int) -> str:
    return ", ".join(f"{round(factor * float(x), digits) + 0.0:.{digits}f}" for x in vector[:3])


def _angle_text(arm: Arm, name: str, size: float) -> str:
    joint = next(joint for joint in arm.joints if joint.name == name)
    return f"{joint.display_factor * size:.3g} {joint.display_unit}"
