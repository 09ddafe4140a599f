"""Joints for which the loaded tool is where it was asked to be, many points at once.

Both unknowns go together: the virtual joints theta to the equilibrium of `rest`, the commanded joints q to
the target. Every step evaluates the bent arm once; it foretells by J_theta where the new theta brings the
tool, and moves q by what is left then. What it neglects is a hundredth on heavy arms, so five steps reach
1e-10 m. The operator of a step is that of the start: what is met, and what is damped, follows from where a
point starts alone, so neighbours on a path stay neighbours. Steps are of bounded length, and get shorter
where they do not end (a damped Newton). What has not come to rest by then takes a new operator in every step.

A step puts position right first, then as much of the turn as is asked. With d the joints' motion, J_p and J_r
the rows of the Jacobian for position and turn, and Z a base of what leaves the position alone:

    d = J_p^+ b_p + Z z,    z of least |J_r Z z - (b_r - J_r J_p^+ b_p)|

so the position is met in any pose in which it can be met at all. Near a singular pose of the wrist a turn
costs any motion: there every direction z of small singular value s is damped, s / (s^2 + l^2) for 1 / s, with
l growing smoothly from zero at s = SMALL (Nakamura & Hanafusa 1986); what is not turned is said. Where joints
are left over, d is the shortest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from testbench.correct.rest import batches, put, rest
from testbench.data.dataset import in_order, joined
from testbench.errors import Array, BenchError, Ids, Mask, check_array
from testbench.identify.absolute.state import State, loads_at, unbent
from testbench.model.load import Load
from testbench.model.tool_motion import turn_between, turn_of_axis
from testbench.model.vjm import Chain, chain, cross, tool_pose

Hold = Literal["pose", "axis", "position"]
"""What of the tool is put right: all, all but its turn about the spindle, or its position alone."""
SMALL = 0.05
"""Singular value [rad a rad] below which turns are damped: there a milliradian costs a degree and more."""
RANK = 1e-7  #: Singular value of J_p over its largest below which a direction cannot be gone.


def solutions(J: Array, hold: Hold, axis: Array) -> Array:
    """Operator G with d = G b, (points, n, 6) [rad/m, rad/rad].

    Args:
        J: Jacobian of the joints at the tool point, translation first, world axes, (points, 6, n) [m, 1].
        hold: What is put right.
        axis: Unit vector of the spindle in the world, (points, 3).
    """
    U, s, Vt = np.linalg.svd(J[:, :3])
    r = s.shape[1]
    keep = s > RANK * s[:, :1]
    inverse = np.where(keep, 1 / np.where(keep, s, 1), 0)
    position = (Vt[:, :r].swapaxes(1, 2) * inverse[:, None]) @ U[:, :, :r].swapaxes(1, 2)
    G = np.zeros((len(J), J.shape[2], 6))
    G[:, :, :3] = position
    if hold == "position" or r == J.shape[2]:
        return G
    Z, turns = Vt[:, r:].swapaxes(1, 2), J[:, 3:]
    if hold == "axis":
        turns = turns - axis[:, :, None] * (axis[:, None] @ turns)
    turning = Z @ _damped(turns @ Z)
    G[:, :, :3] -= turning @ (turns @ position)
    G[:, :, 3:] = turning
    if hold == "axis":
        G[:, :, 3:] -= (turning @ axis[:, :, None]) @ axis[:, None]
    return G


def _damped(B: Array) -> Array:
    """Inverses of (points, 3, k) matrices, damped where they are nearly singular, (points, k, 3)."""
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    scarce = np.maximum(0, 1 - s / SMALL)
    gain = s / np.maximum(s**2 + (SMALL * scarce) ** 2, np.finfo(float).tiny)
    return np.asarray((Vt.swapaxes(1, 2) * gain[:, None]) @ U.swapaxes(1, 2))


Asked = Literal["unloaded", "drawn"]
"""Where the model has the tool under its own weight alone, a taught point; or as drawn and rigid."""
TOLERANCE = 1e-10  #: Of the position of a point, and of its equilibrium [m, rad].
FEW, MOST = 5, 60  #: Steps that do for most points, and in all.
SHORTER = 10  #: Steps after which they are half as long, then a quarter.
STILL = 1e-9  #: A step of all joints below this is the last [rad, m].
LONGEST = 0.1  #: Of a step of one joint [rad, m].
FARTHEST, UNIT = 10.0, 1e-6
"""Farthest that a tool point can be from the tool's origin [m], and rounding of a unit vector."""
SPINDLE = (1.0, 0.0, 0.0)  #: Its axis in the tool's frame, where nothing else is said.


@dataclass(frozen=True)
class Target:
    """Where the tool point is asked to be."""

    position: Array  #: World, (points, 3) [m].
    rotation: Array  #: World from tool, (points, 3, 3).


@dataclass(frozen=True)
class Aim:
    """What is put right, and about which point of the tool."""

    hold: Hold = "pose"
    #: What joints of a program mean; "drawn" to an absolute model, "unloaded" to any other if not given.
    asked: Asked | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: Tool point in the tool's frame [m].
    spindle: tuple[float, float, float] = SPINDLE  #: Unit vector in the tool's frame.

    def __post_init__(self) -> None:
        """Refuse other words, a point that is none and a spindle of another length, by BenchError."""
        if self.hold not in get_args(Hold) or self.asked not in (None, *get_args(Asked)):
            known = f"{', '.join(get_args(Hold))} and {', '.join(get_args(Asked))}"
            raise BenchError(f"aim: expected {known}, got {self.hold!r} and {self.asked!r}")
        point, spindle = check_array(np.array([self.point, self.spindle]), (2, 3), "tool point and spindle")
        if np.abs(point).max() > FARTHEST or abs(np.linalg.norm(spindle) - 1) > UNIT:
            problem = f"a tool point within {FARTHEST:g} m and a spindle of length 1"
            raise BenchError(f"aim: expected {problem}, got {self.point} and {self.spindle}")


def asked(state: State, q: Array, meant: Asked, point: Array) -> Target:
    """What programmed joints ask for.

    Args:
        state: The arm.
        q: Joints of the program, (points, n) [rad, m].
        meant: "unloaded" corrects what loads do; "drawn" also geometry, joint errors and own weight.
        point: Tool point in the tool's frame, (3,) [m].
    """
    if meant == "drawn":
        position, rotation = tool_pose(state.vjm, q)
        return Target(position + rotation @ point, rotation)
    found = rest(state, q)
    return Target(found.at(point), found.rotation)


@dataclass(frozen=True)
class Corrected:
    """Joints that put the tool right."""

    q: Array  #: To command, (points, n) [rad, m].
    left: Array  #: Asked minus foretold position of the tool point, world, (points, 3) [m].
    #: The same of its turn, or of the turn of its spindle's axis, rotation vectors, world, (points, 3) [rad].
    turned: Array
    balance: Array  #: Largest virtual joint out of its equilibrium, (points,) [m, rad].
    steps: Ids  #: Evaluations of the bent arm, (points,).

    @property
    def solved(self) -> Mask:
        """Which points are met within `TOLERANCE`, (points,); a turn that was damped is not counted."""
        far = np.maximum(np.linalg.norm(self.left, axis=1), self.balance)
        return np.asarray(far <= TOLERANCE)


@dataclass(frozen=True)
class Points:
    """Points to be solved."""

    state: State  #: The arm.
    start: Array  #: Joints to start from, (points, n) [rad, m].
    loads: Sequence[Load]  #: Each with a row a point.
    target: Target  #: Where the tool point has to be.
    aim: Aim  #: What is put right.
    free: Array  #: One of a joint that may move, zero of one that is held, (points, n).

    def of(self, some: slice | Ids) -> "Points":
        """Some of them."""
        loads, target = [load.of(some) for load in self.loads], in_order(self.target, some)
        return replace(self, start=self.start[some], loads=loads, target=target, free=self.free[some])


@dataclass(frozen=True)
class _Off:
    """How far points are off."""

    where: Chain
    left: Array  #: Asked minus foretold, (points, 3) [m].
    turned: Array  #: (points, 3) [rad].
    springs: Array  #: Where the springs want theta minus where it is, (points, n_theta).


def _off(points: Points, q: Array, theta: Array) -> _Off:
    """One evaluation of the bent arm."""
    state = points.state
    where = chain(state.vjm, q, theta)
    u = loads_at(state, where, points.loads)
    springs = unbent(state, q, points.loads) + (state.C_theta @ u).T - theta
    position = where.position + where.rotation @ np.array(points.aim.point)
    turned = _turned(points, where.rotation)
    return _Off(where, points.target.position - position, turned, springs)


def _turned(points: Points, rotation: Array) -> Array:
    """What of the turn is left; where the spindle may turn about itself, the turn of its axis alone."""
    if points.aim.hold != "axis":
        return turn_between(rotation, points.target.rotation)
    spindle = np.array(points.aim.spindle)
    return turn_of_axis(rotation @ spindle, points.target.rotation @ spindle)


def solve(points: Points) -> Corrected:
    """Joints for which the loaded tool is on its target, without regard to limits; some may be held.

    `Corrected.solved` says which points were reached. Those that take more than a few steps take them
    together, whatever batch they come from. Where the arm is stretched, turns may keep the position from
    being met: there it is met alone.
    """
    found = _in_batches(points, FEW)
    late = np.flatnonzero(found.steps > FEW)
    if len(late):
        put(found, late, _in_batches(points.of(late), MOST))
    alone = replace(points.aim, hold="position")
    for aim, renewed in ((points.aim, True), (alone, False), (alone, True)):
        bad = np.flatnonzero(~found.solved)
        if len(bad):
            again = _in_batches(replace(points.of(bad), aim=aim), MOST, renewed=renewed)
            better = np.flatnonzero(again.solved)
            put(found, bad[better], in_order(again, better))
    return found


def _in_batches(points: Points, most: int, *, renewed: bool = False) -> Corrected:
    """After so many steps at most; `steps` is one more where that did not do."""
    some = batches(len(points.start))
    return joined([_correct(points.of(part), most, renewed=renewed) for part in some])


def _correct(points: Points, most: int, *, renewed: bool) -> Corrected:
    runs = len(points.start)
    q, theta = points.start.copy(), unbent(points.state, points.start, points.loads)
    found = Corrected(q, np.zeros((runs, 3)), np.zeros((runs, 3)), np.zeros(runs), np.zeros(runs, int))
    moving, now, moves = np.arange(runs), points, points.state.vjm.arm.moves
    G, J = np.zeros((runs, q.shape[1], 6)), np.zeros((runs, 6, q.shape[1]))
    for step in range(most):
        off = _off(now, q[moving], theta[moving])
        found.left[moving], found.turned[moving] = off.left, off.turned
        found.balance[moving], found.steps[moving] = np.abs(off.springs).max(axis=1), step + 1
        if step == 0 or renewed:
            J = _jacobian(now.aim, off.where, now.state.vjm.own)
            J = (J if moves is None else J @ moves) * now.free[:, None]
            G = solutions(J, now.aim.hold, now.target.rotation @ np.array(now.aim.spindle))
        move = _move(now, off, q[moving], G, J) / 2 ** min(2, step // SHORTER)
        still = found.solved[moving] & (np.abs(move).max(axis=1) <= STILL)
        go = np.flatnonzero(~still & np.isfinite(off.left).all(axis=1))
        if not len(go):
            return found
        q[moving[go]] += move[go]
        theta[moving[go]] += off.springs[go]
        if len(go) < len(moving):
            moving, now, G, J = moving[go], now.of(go), G[go], J[go]
    found.steps[moving] += 1
    return found


def _jacobian(aim: Aim, where: Chain, columns: slice) -> Array:
    """Of some virtual joints at the tool point, translation first, (points, 6, k) [1, m]."""
    v, omega = where.J_theta[:3, columns], where.J_theta[3:, columns]
    arm = (where.rotation @ np.array(aim.point)).T[:, None]
    return np.ascontiguousarray(np.concatenate([v + cross(omega, arm), omega]).transpose(2, 0, 1))


def _move(points: Points, off: _Off, q: Array, G: Array, J: Array) -> Array:
    """How far to move the joints, (points, n): by what is left when the springs have followed."""
    arm = (off.where.rotation @ np.array(points.aim.point)).T
    v, omega = np.einsum("xtr,rt->xr", off.where.J_theta, off.springs).reshape(2, 3, -1)
    left = np.hstack([off.left - (v + cross(omega, arm)).T, off.turned - omega.T])
    gone = q - points.start
    move = np.matvec(G, left + np.matvec(J, gone)) - gone
    if points.state.vjm.arm.moves is not None:  # joints that follow others move as these do
        move = np.matvec(points.state.vjm.arm.moves, move)
    return np.asarray(move * np.minimum(1, LONGEST / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None])
