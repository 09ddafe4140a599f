"""Joints of a robot's file that move together: URDF's mimic, MJCF's equalities of joints and fixed tendons.

All are linear equations between joints. Solved for the joints of the arm they are its `JointMap`; what closes
a loop or is not linear is refused, but for what only concerns branches off the arm.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.joint_map import JointMap, build_map
from testbench.errors import Array, BenchError, InputError
from testbench.plant.import_robot.robot import Body, Coupling, Joint

ROUNDING = 1e-9  #: Of a coefficient of an equation [1].
DIGITS = 12  #: Decimals of a coefficient.
STATE = "leave it out and state how joints depend in [joints] of elastic.toml"
LOOPS = {int(mujoco.mjtEq.mjEQ_CONNECT): "connect", int(mujoco.mjtEq.mjEQ_WELD): "weld"}
JOINT, SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
ENDS = SITE, int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)
"""What a tendon leads over: joints of one that is fixed, sites and geoms of one in space."""

Rows = Mapping[str, tuple[Mapping[str, float], float]]
"""Of joints that follow others, by name: coefficients of these [1], and an offset [rad, m]."""


def couplings_of(model: mujoco.MjModel, names: Mapping[int, str], index: Mapping[int, int]) -> list[Coupling]:
    """What MuJoCo's equalities say.

    Args:
        model: The robot, as MuJoCo compiles it.
        names: Ours of its joints.
        index: Of its bodies the place of ours.
    """
    found: list[Coupling] = []
    for e in np.flatnonzero(model.eq_active0).tolist():
        kind, label = int(model.eq_type[e]), model.equality(e).name or f"{e + 1}"
        ends = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if kind in LOOPS:
            if int(model.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
                ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
            bodies = index[ends[0]], index[max(ends[1], 0)]
            found.append(Coupling(f"{LOOPS[kind]} {label!r}", bodies=bodies))
        elif kind == int(mujoco.mjtEq.mjEQ_JOINT):
            both = [{end: 1.0} if end >= 0 else {} for end in ends]
            own = _equation(model, names, e, both)
            found.append(replace(own, label=f"joint equality {label!r}", follower=names[ends[0]]))
        elif kind == int(mujoco.mjtEq.mjEQ_TENDON):
            tendons = [end for end in ends if end >= 0]
            own = _equation(model, names, e, [_tendon(model, end) if end >= 0 else {} for end in ends])
            bent = own.bent or not all(map(partial(_is_fixed, model), tendons))
            found.append(replace(own, label=f"tendon equality {label!r}", bent=bent))
    return found


def _wraps(model: mujoco.MjModel, tendon: int) -> range:
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def _is_fixed(model: mujoco.MjModel, tendon: int) -> bool:
    """Whether a tendon's length is a sum of joints; that of one in space is not linear."""
    return all(int(model.wrap_type[k]) == JOINT for k in _wraps(model, tendon))


def _tendon(model: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Coefficients of a tendon's joints; 1 of all that move the ends of one in space against each other."""
    own = [(int(model.wrap_type[k]), int(model.wrap_objid[k]), k) for k in _wraps(model, tendon)]
    if _is_fixed(model, tendon):
        return {j: float(model.wrap_prm[k]) for _, j, k in own}
    bodies = [
        model.site_bodyid[i] if kind == SITE else model.geom_bodyid[i] for kind, i, _ in own if kind in ENDS
    ]
    joints = [_joints_above(model, int(b)) for b in bodies]
    return dict.fromkeys(sorted(set.union(*joints) - set.intersection(*joints)), 1.0)


def _joints_above(model: mujoco.MjModel, body: int) -> set[int]:
    """Joints between the world and a body of MuJoCo."""
    found = set[int]()
    while body:
        first = int(model.body_jntadr[body])
        found |= set(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return found


def _equation(
    model: mujoco.MjModel, names: Mapping[int, str], e: int, both: Sequence[dict[int, float]]
) -> Coupling:
    """X - x_0 = a_0 + a_1 (y - y_0) + ..., x and y sums of joints, as an equation of the joints."""
    a = model.eq_data[e, :5].tolist()
    terms: dict[str, float] = {}
    constant = a[0]
    for part, factor in zip(both, (1.0, -a[1]), strict=True):
        for j, c in part.items():
            terms[names[j]] = terms.get(names[j], 0.0) + factor * c
            constant += factor * c * float(model.qpos0[model.jnt_qposadr[j]])
    return Coupling("", terms, constant, bent=bool(both[1]) and any(a[2:]))


def map_of(
    file: Path,
    bodies: Sequence[Body],
    path: Sequence[int],
    couplings: Sequence[Coupling],
    driven: Collection[str],
) -> tuple[Rows, list[Coupling]]:
    """How joints of an arm follow others.

    Args:
        file: For messages.
        bodies: All of the robot.
        path: Bodies from the first to the tip.
        couplings: What the file says of joints.
        driven: Joints that a motor drives: where it is open, others follow these.

    Returns:
        The joints that follow others; and the couplings that do not concern the arm.

    Raises:
        InputError: When a loop is closed over a joint of the arm, an equation is not linear, a joint is not
            there, or equations contradict.
    """
    chain = [joint.name for k in path if (joint := bodies[k].joint)]
    _check_loops(file, bodies, chain, couplings)
    left = [own for own in couplings if own.bodies is None]
    while spare := next((own for own in left if _is_spare(own, left, chain, driven)), None):
        left.remove(spare)
    used, known = [], set(chain)
    while more := [own for own in left if own not in used and own.terms.keys() & known]:
        used += more
        known |= {name for own in more for name in own.terms}
    for own in used:
        if own.bent:
            raise InputError(file, "", f"{own.label} is not linear; {STATE}")
    there = {body.joint.name for body in bodies if body.joint}
    if missing := sorted(known - there):
        raise InputError(file, "", f"no joint {missing[0]!r}, which others follow")
    followers = {own.follower for own in used}
    order = [body.joint.name for body in reversed(bodies) if body.joint and body.joint.name in known]
    order.sort(key=lambda name: (name in driven, name not in followers))
    return _solved(file, order, used), [own for own in couplings if own not in used]


def _is_spare(
    own: Coupling, left: Sequence[Coupling], chain: Collection[str], driven: Collection[str]
) -> bool:
    """Whether a joint off the arm, in no other coupling, takes what one says: a rod follows the arm."""
    elsewhere = {name for other in left if other is not own for name in other.terms}
    takes = own.terms.keys() - elsewhere - set(chain)
    if own.follower:
        return own.follower in takes
    return not own.bent and bool(takes - set(driven))


def _check_loops(
    file: Path, bodies: Sequence[Body], chain: Collection[str], couplings: Sequence[Coupling]
) -> None:
    for own in couplings:
        if own.bodies is None:
            continue
        one, other = (_joints_to(bodies, k) for k in own.bodies)
        if over := [name for name in chain if name in one ^ other]:
            problem = f"{own.label} closes a loop over the joint {over[0]!r}, so the arm is no chain; {STATE}"
            raise InputError(file, "", problem)


def _joints_to(bodies: Sequence[Body], k: int) -> set[str]:
    """Names of the joints between the world and a body; -1 is the world."""
    found = set()
    while k >= 0:
        if joint := bodies[k].joint:
            found.add(joint.name)
        k = bodies[k].parent
    return found


def _solved(file: Path, order: Sequence[str], equations: Sequence[Coupling]) -> Rows:
    """Gauss-Jordan elimination: of every equation the first joint in the order follows the others."""
    A = np.array([[*(own.terms.get(name, 0.0) for name in order), own.constant] for own in equations])
    A = A.reshape(len(equations), len(order) + 1)
    pivots: list[int] = []
    for column in range(len(order)):
        row = len(pivots)
        if row == len(A):
            break
        best = row + int(np.argmax(np.abs(A[row:, column])))
        if abs(A[best, column]) <= ROUNDING:
            continue
        A[[row, best]] = A[[best, row]]
        A[row] /= A[row, column]
        others = np.arange(len(A)) != row
        A[others] -= A[others, column, None] * A[row]
        pivots.append(column)
    if (np.abs(A[len(pivots) :, -1]) > ROUNDING).any():
        raise InputError(file, "", f"{equations[0].label} and others contradict: no joints satisfy all")
    return {order[column]: _row(order, A[k], column) for k, column in enumerate(pivots)}


def _row(order: Sequence[str], row: Array, column: int) -> tuple[dict[str, float], float]:
    """What an equation, solved for a joint, says of it."""
    terms = {name: -round(float(c), DIGITS) + 0.0 for name, c in zip(order, row[:-1], strict=True)}
    del terms[order[column]]
    return {name: c for name, c in terms.items() if c}, round(float(row[-1]), DIGITS) + 0.0


def chain_map(file: Path, joints: Sequence[Joint], rows: Rows) -> JointMap | None:
    """The joint map of an arm's chain; None where no joint follows others.

    Raises:
        InputError: When the equations leave no map of an arm.
    """
    own = {joint.name: rows[joint.name] for joint in joints if joint.name in rows}
    try:
        return build_map(
            joints, {name: row for name, (row, _) in own.items()}, {name: x for name, (_, x) in own.items()}
        )
    except BenchError as err:
        raise InputError(file, "", str(err)) from err
