"""The table of mistakes: their effect on readings, arm or loads, their names, and checks for the user.

A row is a `Hypothesis`. To add one, write how it is undone and its words, and append the row to its part of
HYPOTHESES: `docs/add_hypothesis.md` has an example.
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
from testbench.identify.diagnosis.deflections import (
    MIN_NATS,
    MIN_NATS_OF_AXES,
    MIN_NATS_OF_RUN,
    LoadedRuns,
    load_levels,
)
from testbench.identify.diagnosis.gravity import mounting, with_gravity_along
from testbench.identify.diagnosis.kinematics import (
    HALF,
    Change,
    FittedObservations,
    FreeParameters,
    Hypothesis,
    Issue,
    Observations,
    Submission,
    any_above,
    cauchy,
    find_row_shift,
    fit,
    likely_joint_orders,
    longer_than,
)
from testbench.identify.registered import station_number, unloaded_series
from testbench.model.vjm import tool_points, tool_pose

MM = 1e3
UNITS = {
    1e-3: "1000 times too large: millimetres read as metres?",
    1e-2: "100 times too large: centimetres read as metres?",
    0.1: "10 times too large: millimetres read as centimetres?",
    0.0254: "39.4 times too large: inches read as metres?",
    1 / 25.4: "25.4 times too large: millimetres read as inches?",
    10.0: "10 times too small: centimetres read as millimetres?",
    25.4: "25.4 times too small: inches read as millimetres?",
    1e3: "1000 times too small: metres read as millimetres?",
}
"""Factor that corrects positions in a wrong unit: the mistake that it suggests."""
CHOICE_PARAMETERS = 2  #: Number of free parameters that a choice among many alternatives counts as.
MIN_FRAME_TURN, MIN_SHIFT, MIN_TARGET_SHIFT = np.deg2rad(0.3), 15e-3, 25e-3
"""Least rotation of a frame [rad], shift of a frame or link [m], shift of a target [m] that are an issue."""
#: Zeros of a hinge that another convention of its angle has [rad].
QUARTER_TURNS = (np.pi / 2, -np.pi / 2, np.pi)
MIN_JOINT_ZERO, LAST_JOINT_FACTOR = (np.deg2rad(0.5), 5e-3), 4.0
"""Least error of a joint's zero that is one [rad, m], and of the last joint's over it: targets may be off."""
#: Targets up to which every order of their names is tried; of more, one exchange of two.
MAX_PERMUTED_TARGETS = 4
NEAR_BASE, ROUGH_TARGET = 0.5, 0.1
"""Distance of a frame from the base where no tracker stands, and of a target from its rough place [m]."""
OUTLYING_DISTANCE = 8.0  #: Distance of a reading, over that of a sound one, from which this reading is wrong.
#: Distance of a load point from the tool, over the arm's reach, beyond which a unit is wrong [1].
FAR_LOAD_POINT = 1.0
STILL_SHARE = 0.5  #: Share of the readings that must not move for it to be a mistake of all of them.
AGAINST_SHARE = 0.8  #: Share of the runs whose targets have to move against the force.
FORCE_SHARE, POINT_ERROR, TRACKER_SHIFT, LOAD_FACTOR, BUMP_SIZE = 0.1, 0.1, 1e-3, 0.3, 3e-3
"""Sizes that are expected of a constant force over the largest, of a load point's error [m], of a tracker's
move [m, rad], of a wrong load [1], and of a target that was touched or read elsewhere [m]."""
MIN_BUMP, BUMP_SIGMAS = 4e-4, 8.0
"""Least size of a reading that is wrong [m], and the same in standard deviations."""
Axes = Literal["XYZ", "xyz", "ZYX", "zyx", "ZYZ", "zyz", "ZXZ", "zxz", ""]
NOTATIONS: Mapping[str, Axes] = {
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
"""Usual notations of an orientation by three angles, as a map names them and as SciPy does."""
KinematicChanges = Iterator[Change[Observations]]
LoadChanges = Iterator[Change[LoadedRuns]]


# --- Without a fit: copied readings, absurd load points, moves against the force ----------------------------


def _equal(submission: Submission) -> Iterator[Change[Submission]]:
    """Find loaded readings that equal their unloaded ones."""
    data = submission.data
    loaded = np.asarray(data.wrench.any(axis=1))[:, None] & data.seen
    still = np.asarray(loaded & (data.deflection == 0).all(axis=2))
    if still.any():
        runs = [] if still.sum() > STILL_SHARE * loaded.sum() else data.run[still.any(axis=1)].tolist()
        yield Change(tuple(map(str, runs)), numbers={"count": int(still.sum()), "of": int(loaded.sum())})


def _equal_words(issue: Issue, _: Arm) -> str:
    where = f"run {', '.join(issue.where[:5])}{' ...' * (len(issue.where) > 5)}"
    return (
        "loaded and unloaded readings are equal in "
        f"{where if issue.where else _count_text(issue) + ' readings'}"
    )


def _count_text(issue: Issue) -> str:
    return "{count} of {of}".format(**issue.numbers)


def _repeated(submission: Submission) -> Iterator[Change[Submission]]:
    """Find a run whose loaded readings are those of another pose."""
    data = submission.data
    read = np.where(data.seen[..., None], data.after, np.nan).reshape(data.runs, -1)
    _, first, group = np.unique(read, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero((data.q != data.q[first[group]]).any(axis=1) & data.seen.any(axis=1))
    if len(again):
        yield Change((str(data.run[again[0]]), str(data.run[first[group[again[0]]]])))


def _far_load(submission: Submission) -> Iterator[Change[Submission]]:
    away, reach = float(np.linalg.norm(submission.data.point, axis=1).max()), submission.vjm.reach
    if away > FAR_LOAD_POINT * reach:
        yield Change(numbers={"away": away, "reach": reach})


def _against(data: Dataset) -> Iterator[Change[Dataset]]:
    """Count runs whose targets move against the force: an elastic arm yields along it."""
    force = data.wrench[:, :3]
    work = np.einsum("rx,rmx->r", force, np.where(data.seen[..., None], data.deflection, 0))
    against, pushed = int((work < 0).sum()), int(force.any(axis=1).sum())  # others turn by a moment alone
    if against and against >= AGAINST_SHARE * pushed:
        along = np.abs(force[:, :2]).max() < np.abs(force[:, 2]).max() / 10
        upwards = bool((force[:, 2] > 0).mean() > 1 / 2 and along)
        yield Change(numbers={"count": against, "of": pushed, "upwards": upwards})


def _against_words(issue: Issue, _: Arm) -> str:
    hint = "are before and after exchanged, or is the force's sign wrong?"
    hint = "the force points up: is its sign wrong?" if issue.numbers["upwards"] else hint
    return f"in {_count_text(issue)} runs the targets move against the force: {hint}"


# --- By registration: a frame too near for a tracker, targets far from the folder's -------------------------


def _near_frame(submission: Submission) -> Iterator[Change[Submission]]:
    """Find a frame of a tracker that is too near the base."""
    registration = submission.registered.registration
    if registration is None or submission.registered.frame != "tracker" or submission.declared:
        return
    near = [f for f in registration.frames.values() if np.linalg.norm(f.translation) < NEAR_BASE]
    for frame in near[:1]:
        yield Change(size=np.concatenate([frame.rotation_vector, frame.translation]))


def _far_targets(submission: Submission, *, exchanged: bool) -> Iterator[Change[Submission]]:
    """Find targets that are far from their nominal places, or at the nominal places of others."""
    registration = submission.registered.registration
    off = (
        np.zeros(0)
        if registration is None
        else np.linalg.norm(registration.targets - registration.nominal, axis=1)
    )
    far = np.flatnonzero(off > ROUGH_TARGET)
    if registration is None or not len(far):
        return
    between = np.linalg.norm(registration.targets[far, None] - registration.nominal[None, far], axis=2)
    if (len(far) > 1 and bool((between.min(axis=1) < ROUGH_TARGET).all())) != exchanged:
        return
    if exchanged:
        yield Change(tuple(registration.markers[k] for k in far))
    else:
        worst = int(far[np.argmax(off[far])])
        off_by = registration.targets[worst] - registration.nominal[worst]
        yield Change((registration.markers[worst],), off_by)


# --- Readings against the kinematics ------------------------------------------------------------------------


def _frame(observations: Observations) -> KinematicChanges:
    if not observations.free.frame:
        free = replace(observations.free, frame=True)
        yield Change(undone=replace(observations, free=free), is_large=longer_than(MIN_FRAME_TURN, MIN_SHIFT))


def _frame_words(issue: Issue, _: Arm) -> str:
    turn, at = issue.size[:3], _vector_text(issue.size[3:], MM, 0)
    angle = float(np.linalg.norm(turn))
    words = f"are in a frame turned by {np.rad2deg(angle):.3g} deg about "
    words += f"({_vector_text(turn / max(angle, 1e-12), 1, 2)}) and moved by ({at}) mm against the arm's base"
    if issue.readings is not None:
        return words
    how = "where no tracker can stand; the fitted frame is used, unless --frame states another"
    return f"the readings {words}, {how}"


def _targets(observations: Observations) -> KinematicChanges:
    if not observations.free.targets:
        yield Change(
            undone=replace(observations, free=replace(observations.free, targets=True)),
            is_large=longer_than(MIN_TARGET_SHIFT),
        )


def _targets_words(issue: Issue, _: Arm) -> str:
    [name] = issue.where
    off = f"{MM * np.linalg.norm(issue.size):.0f} mm from where the arm's folder has it on the tool"
    return f"{name} is {off}" if issue.readings is None else f"have {name} {off}"


def _mirrored(observations: Observations) -> KinematicChanges:
    yield Change(undone=replace(observations, free=replace(observations.free, frame=True, mirrored=True)))


def _link(observations: Observations) -> KinematicChanges:
    for k, link in enumerate(observations.vjm.arm.links[1:-1], start=1):
        free = replace(observations.free, theta=(6 * k, 6 * k + 1, 6 * k + 2))
        yield Change((link.name,), undone=replace(observations, free=free), is_large=longer_than(MIN_SHIFT))


def _joint_zero(observations: Observations) -> KinematicChanges:
    """Try a zero error of any size, and quarter and half turns, which no linear fit finds.

    A half turn of a wrist may as well be a reversed sign, which is more probable: it counts as one parameter
    more.
    """
    joints, links = observations.vjm.arm.joints, 6 * len(observations.vjm.arm.links)
    for k, joint in enumerate(joints):
        is_large = any_above(
            (LAST_JOINT_FACTOR if k == len(joints) - 1 else 1.0) * MIN_JOINT_ZERO[joint.prismatic]
        )
        free = replace(observations.free, theta=(links + k,))
        yield Change(
            (joint.name,),
            np.zeros(1),
            undone=replace(observations, free=free),
            parameters=1,
            is_large=is_large,
        )
        for turn in () if joint.prismatic else QUARTER_TURNS:
            undone = replace(observations, q=observations.q + turn * np.eye(len(joints))[k])
            yield Change((joint.name,), np.array([turn]), undone=undone, parameters=CHOICE_PARAMETERS + 1)


def _joint_zero_words(issue: Issue, arm: Arm) -> str:
    [name] = issue.where
    ends = {arm.joints[-1].name: ", or the tool is", arm.joints[0].name: ", or the frame is turned about it"}
    return f"fit if the zero of {name} is off by {_angle_text(arm, name, issue.size[0])}{ends.get(name, '')}"


def _markers(observations: Observations) -> KinematicChanges:
    """Try other names of the targets: every order of a few; of more, the exchange of two that fits best."""
    m = len(observations.markers)
    if observations.free.targets_unknown:  # no target has a known place
        return
    orders = list(permutations(range(m)))[1:] if m <= MAX_PERMUTED_TARGETS else [_best_exchange(observations)]
    for order in orders:
        wrong = tuple(observations.names[k] for k, other in enumerate(order) if k != other)
        undone = replace(
            observations, position=observations.position[:, order], seen=observations.seen[:, order]
        )
        yield Change(wrong, undone=undone, parameters=CHOICE_PARAMETERS)


def _best_exchange(observations: Observations) -> tuple[int, ...]:
    """Find the exchange of two targets that lowers the loss most, as an order of the targets."""
    frame, m = fit(observations).frame, len(observations.markers)
    x = (
        tool_points(observations.vjm, observations.q, observations.markers) @ frame.rotation.T
        + frame.translation
    )
    pairs = np.empty((m, m))  # of a place and the target that was read there
    for k in range(m):
        pairs[k] = cauchy(
            np.where(observations.seen[..., None], x[:, [k]] - observations.position, 0), observations.scale
        ).sum(axis=0)
    unexchanged = np.diag(pairs)
    change = pairs + pairs.T - unexchanged - unexchanged[:, None]
    change[np.diag_indices(m)] = np.inf
    i, j = divmod(int(change.argmin()), m)
    return tuple(j if k == i else i if k == j else k for k in range(m))


def _markers_words(issue: Issue, _: Arm) -> str:
    names = ", ".join(issue.where)
    if issue.readings is None:
        return f"targets {names} are at each other's places: are their names exchanged?"
    return f"fit if the names of {names} are exchanged"


def _unit(observations: Observations) -> KinematicChanges:
    for factor in UNITS:
        undone = replace(observations, position=factor * observations.position)
        yield Change(size=np.array([factor]), undone=undone, parameters=CHOICE_PARAMETERS)


def _angle_unit(observations: Observations) -> KinematicChanges:
    hinge = np.array([not joint.prismatic for joint in observations.vjm.arm.joints], dtype=bool)
    for factor in (np.rad2deg(1), np.deg2rad(1)):
        undone = replace(observations, q=np.where(hinge, factor * observations.q, observations.q))
        yield Change(size=np.array([factor]), undone=undone, parameters=CHOICE_PARAMETERS)


def _angle_unit_words(issue: Issue, _: Arm) -> str:
    return (
        f"fit if joint angles are {'radians, not degrees' if issue.size[0] > 1 else 'degrees, not radians'}"
    )


def _order(observations: Observations) -> KinematicChanges:
    """Try the readings of the pose before or after, from the first row on or from a later one."""
    for shift in (1, -1):
        undone = replace(observations, q=np.roll(observations.q, shift, axis=0))
        yield Change(size=np.array([shift]), undone=undone, parameters=CHOICE_PARAMETERS)
    if slip := find_row_shift(observations):
        first, undone = str(observations.runs[slip.first]), replace(observations, q=slip.q)
        yield Change((first,), np.array([slip.shift]), undone=undone, parameters=CHOICE_PARAMETERS + 1)


def _order_words(issue: Issue, _: Arm) -> str:
    row = "row" if issue.readings == "all" else "run"
    since = f" from {row} {issue.where[0]} on" if issue.where else ""
    return f"are those of the pose {'before' if issue.size[0] > 0 else 'after'}{since}"


def _joint_sign(observations: Observations) -> KinematicChanges:
    for k, joint in enumerate(observations.vjm.arm.joints):
        sign = np.where(np.arange(observations.q.shape[1]) == k, -1, 1)
        yield Change(
            (joint.name,), undone=replace(observations, q=observations.q * sign), parameters=CHOICE_PARAMETERS
        )


def _joint_coupling(observations: Observations) -> KinematicChanges:
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
            yield Change(tuple(where), undone=replace(observations, q=q), parameters=CHOICE_PARAMETERS)


def _joint_coupling_words(issue: Issue, _: Arm) -> str:
    triples = list(zip(issue.where[0::3], issue.where[1::3], issue.where[2::3], strict=True))
    sums = " and ".join(f"{joint} is the file's {joint} {sign} {other}" for joint, sign, other in triples)
    return f"fit if {sums}: does the robot count {triples[0][0]} together with {triples[0][2]}?"


def _joint_order(observations: Observations) -> KinematicChanges:
    """Try the most probable orders of the joints in the file."""
    names = [joint.name for joint in observations.vjm.arm.joints]
    for order in likely_joint_orders(observations):
        where = tuple(names[k] for k in np.argsort(order))
        yield Change(
            where, undone=replace(observations, q=observations.q[:, order]), parameters=CHOICE_PARAMETERS
        )


def _joint_order_words(issue: Issue, arm: Arm) -> str:
    order, names = list(issue.where), [joint.name for joint in arm.joints]
    moved = [name for name, usual in zip(order, names, strict=True) if name != usual]
    if len(moved) == 2:
        return f"fit if {moved[1]} and {moved[0]} are exchanged"
    if order == names[::-1]:
        return "fit if the joints come in the opposite order"
    return f"fit if the joint order in the file is {', '.join(order)}"


def _axes(observations: Observations) -> KinematicChanges:
    """Try positions with one axis reversed, or two exchanged; only orientations can show it."""
    if observations.rotation is None:
        return
    position = observations.position[:, : len(observations.names)]
    for k, name in enumerate("xyz"):
        flipped = observations.oriented(
            position * np.where(np.arange(3) == k, -1.0, 1.0), observations.rotation
        )
        yield Change((name,), undone=flipped, parameters=CHOICE_PARAMETERS)
    for i, j in combinations(range(3), 2):
        order = np.arange(3)
        order[[i, j]] = j, i
        exchanged = observations.oriented(position[..., order], observations.rotation)
        yield Change(("xyz"[i], "xyz"[j]), undone=exchanged, parameters=CHOICE_PARAMETERS)


def _axes_words(issue: Issue, _: Arm) -> str:
    if len(issue.where) == 2:
        return f"fit if {issue.where[0]} and {issue.where[1]} of the positions are exchanged"
    return f"fit if {issue.where[0]} of the positions has the other sign"


def _notation(observations: Observations) -> KinematicChanges:
    """Try other notations of the orientations, as meant and as read; equal results count once."""
    if observations.rotation is None:
        return
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    position, rotations = observations.position[:, : len(observations.names)], observations.rotation
    rotations = np.where(np.isfinite(rotations).all(axis=(1, 2), keepdims=True), rotations, np.eye(3))
    R, by_rotation = Rotation.from_matrix(rotations), dict[bytes, tuple[tuple[str, ...], Array]]()
    for (read, axes), (meant, order) in product(NOTATIONS.items(), NOTATIONS.items()):
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
        yield Change(names, undone=observations.oriented(position, rotation), parameters=CHOICE_PARAMETERS)


def _notation_words(issue: Issue, _: Arm) -> str:
    if not issue.where:
        return "fit if orientations are inverted: the tracker's in the target's frame"
    ways = zip(issue.where[0::2], issue.where[1::2], strict=True)
    return "fit if orientations are " + ", or ".join(f"{a} instead of {b}" for a, b in ways)


# --- Single poses and readings that lie off while most do not -----------------------------------------------


def _off_poses(placed: FittedObservations, *, whole_poses: bool) -> Iterator[Change[FittedObservations]]:
    """Find poses most of whose readings are off, with the cause; or single readings that are."""
    observations, far = placed.observations, OUTLYING_DISTANCE * placed.observations.scale
    off = np.linalg.norm(placed.fit.residual, axis=2)
    for row in np.flatnonzero((off > far).any(axis=1)).tolist():
        run, typical = str(observations.runs[row]), float(np.median(off[row][observations.seen[row]]))
        numbers = {"pose": int(observations.poses[row])}
        if (typical > far / 2) != whole_poses:
            continue
        if whole_poses:
            where, size = _explain_pose(placed, row, far)
            yield Change((run, *where), size, {"off": typical, **numbers})
        else:
            k = int(np.argmax(off[row]))
            yield Change((run, observations.names[k]), numbers={"off": float(off[row, k]), **numbers})


def _explain_pose(placed: FittedObservations, row: int, far: float) -> tuple[tuple[str, ...], Array]:
    """Find targets of a pose that may be exchanged, or a joint whose angle may be larger.

    Returns their names, and by how much the joint is larger, (1,) [rad, m]; (0,) for targets.
    """
    frame, observations = placed.fit.frame, placed.observations.select(np.array([row]))
    observations = replace(
        observations,
        position=(observations.position - frame.translation) @ frame.rotation,
        markers=placed.fit.markers,
    )
    observations = replace(observations, free=FreeParameters())
    for name, changes in (("markers", _markers(observations)), ("joint_zero", _joint_zero(observations))):
        tried = [(change, fit(change.undone)) for change in changes if change.undone is not None]
        tried = [(change, refit) for change, refit in tried if refit.theta.any() or name == "markers"]
        good = [(change, refit) for change, refit in tried if refit.distance_quantile(observations) < far]
        if good:
            change, refit = min(good, key=lambda x: x[1].loss)
            return change.where, refit.theta[refit.theta != 0]
    return (), np.zeros(0)


def _pose_words(issue: Issue, arm: Arm) -> str:
    run, *names = issue.where
    words = "is its pose right?"
    if len(issue.size):
        words = f"they fit if {names[0]} is {_angle_text(arm, names[0], issue.size[0])} larger"
    elif names:
        words = f"they fit if the names of {', '.join(names)} are exchanged"
    return f"run {run}: its unloaded readings lie {length_text(issue.numbers['off'])} off: {words}"


# --- Loads and deflections ----------------------------------------------------------------------------------


def _mounting(loads: LoadedRuns) -> LoadChanges:
    if loads.gravity is not None:
        issue, data = mounting(loads.vjm, loads.gravity), with_gravity_along(loads.data, loads.gravity.g)
        yield Change(issue.where, issue.size, issue.numbers, undone=replace(loads, data=data))


def _mounting_words(issue: Issue, _: Arm) -> str:
    down, turn = issue.size[:3], issue.size[3:]
    tilt = float(np.rad2deg(np.arccos(np.clip(-down[2], -1.0, 1.0))))
    axis = int(np.abs(down).argmax())
    along = f"gravity along {'-+'[bool(down[axis] > 0)]}{'xyz'[axis]} of its base"
    how = "the arm hangs" if axis == 2 else "the arm stands on a wall"
    if abs(down[axis]) < np.cos(np.deg2rad(3)):
        how = f"the base is tilted by {tilt:.0f} deg"
        along = f"gravity along ({_vector_text(down, 1, 2)}) of its axes"
    known = "the sag in the unloaded readings agrees" * (tilt > 120)  # weights pull upwards
    known = "the level tracker agrees" if issue.numbers["level"] else known
    quat = " ".join(f"{round(float(x), 4) + 0.0:g}" for x in turn)
    state = f'state it as quat="{quat}" of the body {issue.where[0]} in rigid.xml'
    return f"the readings fit if {how}: {along}{f' ({known})' * bool(known)}; {state}"


def _sized_change(loads: LoadedRuns, prior_deviation: float, undone: Sequence[Dataset]) -> Change[LoadedRuns]:
    """Describe a mistake of unknown size by data sets with one prior deviation of it undone in each."""
    assert loads.model is not None
    return Change(columns=loads.model.columns(undone), prior_deviation=prior_deviation)


def _force_offset(loads: LoadedRuns) -> LoadChanges:
    if loads.model is not None and loads.largest_force > 0:
        data, size = loads.data, FORCE_SHARE * loads.largest_force
        undone = [replace(data, wrench=data.wrench + size * e) for e in np.eye(6)[:3]]
        yield replace(_sized_change(loads, size, undone), is_large=any_above(0.045 * loads.largest_force))


def _load_point(loads: LoadedRuns) -> LoadChanges:
    if loads.model is not None:
        data = loads.data
        undone = [replace(data, point=data.point + POINT_ERROR * e) for e in np.eye(3)]
        yield replace(_sized_change(loads, POINT_ERROR, undone), is_large=any_above(0.05))


def _load_point_words(issue: Issue, _: Arm) -> str:
    if "reach" in issue.numbers:
        words = (
            "the load acts {away:.3g} m from the tool, but the arm reaches {reach:.3g} m: is it in "
            "millimetres?"
        )
        return words.format(**issue.numbers)
    return f"the load acts ({_vector_text(issue.size, MM, 0)}) mm from the stated point, in the tool's axes"


def _touched_tracker(loads: LoadedRuns) -> LoadChanges:
    """Try a tracker, of each station, that moved between the two readings of every run."""
    data, y = loads.data, loads.data.after
    moves = [*np.eye(3), *(np.cross(e, y - y[data.seen].mean(axis=0)) for e in np.eye(3))]
    for name in (
        (station_number(series.frame) for series in unloaded_series(data)) if loads.model is not None else ()
    ):
        here = TRACKER_SHIFT * runs_of_station(data, name)[:, None, None]
        change = _sized_change(loads, TRACKER_SHIFT, [replace(data, after=y - here * move) for move in moves])
        yield replace(change, where=() if data.station is None else (str(name),), is_large=any_above(4e-4))


def _level(loads: LoadedRuns) -> LoadChanges:
    """Try a wrong factor of the loads of each load level."""
    data, groups = loads.data, load_levels(loads.data)
    for mask in groups if len(groups) > 1 and loads.model is not None else ():
        force = float(np.linalg.norm(data.wrench[mask, :3], axis=1).mean())
        change = _sized_change(
            loads, LOAD_FACTOR, [replace(data, wrench=data.wrench * (1 + LOAD_FACTOR * mask)[:, None])]
        )
        yield replace(change, numbers={"force": force}, is_large=any_above(0.08))


def _force_axes(loads: LoadedRuns) -> LoadChanges:
    """Try wrenches in the tool's axes, and wrenches with permuted or reversed axes."""
    data, w = loads.data, loads.data.wrench.reshape(-1, 2, 3)

    def undone(other: Array) -> LoadedRuns:
        return replace(loads, data=replace(data, wrench=other.reshape(-1, 6)))

    turned = np.einsum("rxy,rky->rkx", tool_pose(loads.vjm, data.q)[1], w)
    yield Change(("tool",), undone=undone(turned))
    for order, sign in product(list(permutations(range(3)))[1:], (1, -1)):
        where = "".join("xyz"[k] for k in order), "+" if sign > 0 else "-"
        yield Change(where, undone=undone(sign * w[:, :, list(order)]))


def _force_axes_words(issue: Issue, _: Arm) -> str:
    if issue.where == ("tool",):
        return "the readings fit if forces are in the tool's axes"
    order, sign = issue.where
    minus = "" if sign == "+" else ", with the other sign"
    return f"the readings fit if the forces' axes x, y, z are {', '.join(order)}{minus}"


def _levels(loads: LoadedRuns) -> LoadChanges:
    """Try loads that were listed in reversed order."""
    data, groups = loads.data, load_levels(loads.data)
    sizes = [np.linalg.norm(data.wrench[level, :3], axis=1).mean() for level in groups]
    factor = np.ones(data.runs)
    for level, size, value in zip(groups, sizes, sizes[::-1], strict=True):
        factor[level] = value / size
    if len(groups) > 1:
        yield Change(undone=replace(loads, data=replace(data, wrench=data.wrench * factor[:, None])))


def _rows_of_runs(loads: LoadedRuns) -> Iterator[tuple[str, tuple[int, int]]]:
    """Yield the name of every run and the range of its equations, three per reading."""
    assert loads.model is not None
    run = loads.model.readings.run
    for r, name in enumerate(map(str, loads.data.run)):
        first, end = np.searchsorted(run, [r, r + 1])
        if first < end:
            yield name, (3 * int(first), 3 * int(end))


def _run_load(loads: LoadedRuns) -> LoadChanges:
    """Try a wrong factor of the load of each run."""
    if (residual_model := loads.model) is not None:
        expected = (residual_model.readings.A @ residual_model.pi).ravel()
        for name, rows in _rows_of_runs(loads):
            columns = LOAD_FACTOR * expected[slice(*rows), None]
            yield Change(
                (name,), columns=columns, rows=rows, prior_deviation=LOAD_FACTOR, is_large=any_above(0.4)
            )


def _bumps(loads: LoadedRuns, *, all_targets: bool) -> LoadChanges:
    """Try displaced targets of one run, each displaced independently: all of them, or one."""
    if (residual_model := loads.model) is not None:
        size = BUMP_SIZE / np.repeat(residual_model.readings.unit, 3)
        least = float(np.max([MIN_BUMP, BUMP_SIGMAS * loads.data.sigma * residual_model.misfit]))

        def is_large(b: Array) -> bool:
            return bool(np.linalg.norm(b) > least)

        for name, every in _rows_of_runs(loads):
            for rows in [every] if all_targets else [(k, k + 3) for k in range(*every, 3)]:
                target = residual_model.readings.marker[rows[0] // 3]
                label = () if all_targets or target < 0 else (loads.data.markers[target],)
                columns = np.diag(size[slice(*rows)])
                yield Change(
                    (name, *label), columns=columns, rows=rows, prior_deviation=BUMP_SIZE, is_large=is_large
                )


def _reading_words(issue: Issue, _: Arm) -> str:
    run, target = (*issue.where, "the tool's turn")[:2]
    if "off" in issue.numbers:
        return f"run {run}: {target} was read {length_text(issue.numbers['off'])} off, the others were not"
    off = f"{target} is {_distance(issue):.2g} mm from where the other readings place it"
    return f"run {run}: {off}: was it touched, or read wrongly?"


def _run_load_words(issue: Issue, _: Arm) -> str:
    b = issue.size[0]
    hint = "is its mass right?" if b > -1 else "are before and after exchanged?"
    return f"run {issue.where[0]}: the deflections are those of {1 + b:.2f} times the stated load: {hint}"


def _distance(issue: Issue) -> float:
    """Compute the root mean square displacement of all targets [mm]."""
    return MM * float(np.linalg.norm(issue.size)) / math.sqrt(len(issue.size) / 3)


# --- Moves between two readings -----------------------------------------------------------------------------


def _moved_words(issue: Issue, _: Arm) -> str:
    """Describe a tracker that moved between the readings of every run, or a move between two rows."""
    size, b = issue.numbers, issue.size
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
    """Hold the table of hypotheses, grouped by the data that their test needs."""

    without_fit: tuple[Hypothesis[Submission], ...]  #: Certain from the runs as they are, without a fit.
    registration: tuple[Hypothesis[Submission], ...]  #: Tested on frames and targets of the registration.
    kinematics: tuple[Hypothesis[Observations], ...]  #: Tested by fitting positions to the kinematics.
    #: Tested on residuals of single poses and readings, once the kinematics fit.
    single_poses: tuple[Hypothesis[FittedObservations], ...]
    work: tuple[Hypothesis[Dataset], ...]  #: Tested on the sign of the work of the forces.
    all_loads: tuple[Hypothesis[LoadedRuns], ...]  #: Tested on the deflections of all runs.
    single_runs: tuple[Hypothesis[LoadedRuns], ...]  #: Tested on the deflections of single runs.

    @property
    def words(self) -> dict[str, tuple[Callable[[Issue, Arm], str], str]]:
        """Map the name of each hypothesis to its words and its remedy."""
        parts = (
            self.single_runs,
            self.all_loads,
            self.work,
            self.single_poses,
            self.kinematics,
            self.registration,
            self.without_fit,
        )
        return {row.name: (row.words, row.remedy) for part in parts for row in part}


HYPOTHESES = Hypotheses(
    without_fit=(
        Hypothesis("equal", _equal, _equal_words, "was one of them copied?"),
        Hypothesis(
            "repeated",
            _repeated,
            lambda issue, _: (
                f"run {issue.where[0]} has the loaded readings of run {issue.where[1]}, in another pose"
            ),
            "was it copied?",
        ),
        Hypothesis("load_point", _far_load, _load_point_words),
    ),
    registration=(
        Hypothesis("frame", _near_frame, _frame_words),
        Hypothesis("markers", partial(_far_targets, exchanged=True), _markers_words),
        Hypothesis("targets", partial(_far_targets, exchanged=False), _targets_words),
    ),
    kinematics=(
        Hypothesis("frame", _frame, _frame_words),
        Hypothesis("targets", _targets, _targets_words, many_parameters=True),
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
        Hypothesis("joint_zero", _joint_zero, _joint_zero_words),
        Hypothesis("markers", _markers, _markers_words),
        Hypothesis("unit", _unit, lambda issue, _: f"are {UNITS[issue.size[0]]}"),
        Hypothesis("angle_unit", _angle_unit, _angle_unit_words),
        Hypothesis("order", _order, _order_words),
        Hypothesis("joint_sign", _joint_sign, lambda issue, _: f"fit if {issue.where[0]} has the other sign"),
        Hypothesis("joint_coupling", _joint_coupling, _joint_coupling_words),
        Hypothesis("joint_order", _joint_order, _joint_order_words),
        Hypothesis("notation", _notation, _notation_words),
        Hypothesis("axes", _axes, _axes_words),
    ),
    single_poses=(
        Hypothesis("pose", partial(_off_poses, whole_poses=True), _pose_words),
        Hypothesis("reading", partial(_off_poses, whole_poses=False), _reading_words),
    ),
    work=(Hypothesis("sign", _against, _against_words),),
    all_loads=(
        Hypothesis("mounting", _mounting, _mounting_words, nats=MIN_NATS_OF_AXES),
        Hypothesis(
            "force_offset",
            _force_offset,
            lambda issue, _: (
                f"a constant force of ({_vector_text(issue.size, 1, 0)}) N is missing in every load"
            ),
            "is the sensor's zero wrong?",
            nats=MIN_NATS,
        ),
        Hypothesis("load_point", _load_point, _load_point_words, nats=MIN_NATS),
        Hypothesis("tracker_moved", _touched_tracker, _moved_words, nats=MIN_NATS),
        Hypothesis(
            "level",
            _level,
            lambda issue, _: (
                f"compared with the other loads, the load of {issue.numbers['force']:.4g} N acts as if it "
                f"were {1 + issue.size[0]:.2f} times as large"
            ),
            "is its mass right?",
            nats=MIN_NATS_OF_RUN,
        ),
        Hypothesis("force_axes", _force_axes, _force_axes_words, nats=MIN_NATS_OF_AXES),
        Hypothesis(
            "levels",
            _levels,
            lambda *_: "the readings fit if the loads are in reversed order",
            nats=MIN_NATS_OF_AXES,
        ),
    ),
    single_runs=(
        Hypothesis("run_load", _run_load, _run_load_words, nats=MIN_NATS_OF_RUN),
        Hypothesis(
            "run",
            partial(_bumps, all_targets=True),
            lambda issue, _: (
                f"run {issue.where[0]}: its targets are {_distance(issue):.2g} mm from where the load should "
                "move them"
            ),
            nats=MIN_NATS_OF_RUN,
        ),
        Hypothesis("reading", partial(_bumps, all_targets=False), _reading_words, nats=MIN_NATS_OF_RUN),
    ),
)
"""Every mistake that is looked for."""


# --- In words -----------------------------------------------------------------------------------------------


def _scale_words(issue: Issue, arm: Arm) -> str:
    """Describe a factor between prior and readings, or name a single reading where no compliance fits."""
    factor = issue.numbers["factor"]
    if issue.where:
        largest, median = MM * issue.numbers["largest"], MM * issue.numbers["median"]
        return (
            f"as a whole the deflections are {factor:.3g} times what the arm's folder predicts; the largest "
            f"is {largest:.3g} mm, {issue.where[0]} in run {issue.where[1]}, the median {median:.3g} mm: "
            "is that reading wrong, or do loaded readings belong to other runs?"
        )
    hint = "forces in another unit, a lighter load, or a folder too soft?"
    if factor > 1:
        hint = "forces in kg instead of N (9.81 times), in kN, a heavier load, or a folder too stiff?"
    times = f"{factor:,.0f}" if factor > 100 else f"{factor:.3g}"
    stated = "" if arm.payload is None else f" (payload {arm.payload:.4g} kg)"
    words = f"the readings are {times} times what the arm's folder predicts under loads up to "
    return f"{words}{issue.numbers['force']:,.5g} N{stated}: {hint}"


OTHER_WORDS: Mapping[str, Callable[[Issue, Arm], str]] = {
    "kinematics": lambda issue, _: (
        f"the {_readings_text(issue)} lie {length_text(issue.numbers['now'])} (median) from the "
        "arm's kinematics, and no single mistake explains that: is this the arm?"
    ),
    "scale": _scale_words,
    "target_moved": _moved_words,
    "tracker_moved": _moved_words,
    "noise": lambda issue, _: (
        f"the readings scatter {issue.numbers['factor']:.2g} times as much as their noise of "
        f"{1e6 * issue.numbers['sigma']:.3g} um: is the noise larger, or does the arm not bend like springs?"
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
"""Words for readings that no hypothesis explains, for moves in time, and for corrections by calibration."""


def describe(
    issue: Issue,
    arm: Arm,
    columns: Sequence[tuple[str, str]] = (),
    hypotheses: Hypotheses = HYPOTHESES,
) -> Doubt:
    """Describe an issue in one sentence.

    Args:
        issue: The issue.
        arm: The arm.
        columns: Name and unit of the file's column for every joint, in the arm's order; empty if unknown.
        hypotheses: The table that the issue was found with.

    Returns:
        Name, sentence and nats.

    Raises:
        KeyError: When neither the table nor OTHER_WORDS has words for the issue.
    """
    if issue.name in OTHER_WORDS:
        return Doubt(issue.name, OTHER_WORDS[issue.name](issue, arm), issue.nats)
    find, remedy = hypotheses.words[issue.name]
    words = find(issue, arm) + (f": {remedy}" if remedy else "")
    if "was" in issue.numbers:
        ends = length_text(issue.numbers["was"]), length_text(issue.numbers["now"])
        far = f"median distance from the arm's kinematics {ends[0]}, with this change {ends[1]}"
        if (share := issue.numbers["share"]) > HALF:
            most = f"{100 * share:.0f} % of them"
            far = f"{most} lie within {ends[0]} of the arm's kinematics, with this change within {ends[1]}"
        words = f"the {_readings_text(issue)} {words} ({far})"
    if issue.name == "joint_order" and len(columns) == len(arm.joints):
        joint_columns = zip(issue.where, columns, arm.joints, strict=True)
        lines = [
            f'{name}_{unit} = "{column}"'
            for name, (column, unit), joint in joint_columns
            if name != joint.name
        ]
        words += f"; in a map's [columns]: {', '.join(lines)}"
    return Doubt(issue.name, words, issue.nats)


def _readings_text(issue: Issue) -> str:
    return "readings" if issue.readings == "all" else f"{issue.readings} readings"


def length_text(metres: float) -> str:
    """Format a length for people: "3.42 mm" below 1 m, "3,420 m" above."""
    return f"{MM * metres:.3g} mm" if metres < 1 else f"{metres:,.4g} m"


def _vector_text(vector: Array, factor: float, digits: int) -> str:
    return ", ".join(f"{round(factor * float(x), digits) + 0.0:.{digits}f}" for x in vector[:3])


def _angle_text(arm: Arm, name: str, size: float) -> str:
    joint = next(joint for joint in arm.joints if joint.name == name)
    return f"{joint.display_factor * size:.3g} {joint.display_unit}"
