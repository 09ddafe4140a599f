"""A program compensated: joints within limits, what is left, and which points cannot be put right."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.newton import Aim, Asked, Corrected, Points, Target, asked, solve
from testbench.correct.rest import put, rest
from testbench.correct.uncertainty import Poses, half_widths
from testbench.errors import Array, BenchError, Mask, check_array
from testbench.identify.arm_model import ArmModel
from testbench.model.load import Load
from testbench.plant.site import Site, collisions

Why = Literal["reach", "equilibrium", "limit", "collision"]


@dataclass(frozen=True)
class Refusal:
    """Why a point cannot be put right."""

    why: Why  #: Out of reach, without an equilibrium, beyond a joint's limit, or into something.
    names: tuple[str, ...] = ()  #: The joint that would pass its limit, or the two that would collide.
    size: float = 0.0  #: What is left [m], or how far beyond the limit [rad, m].


@dataclass(frozen=True)
class Compensated:
    """Joints to command so that the loaded tool is where it was asked to be, and what is left."""

    q: Array  #: Joints to command; those of the program where `refused` says why not, (points, n) [rad, m].
    start: Array  #: Joints of the program, (points, n) [rad, m].
    target: Target  #: Where the tool point was asked to be.
    before: Array  #: Foretold minus asked position without correction, world, (points, 3) [m].
    after: Array  #: The same with it: what the solver leaves, (points, 3) [m].
    turned: Array  #: What is left of the turn, a rotation vector, world, (points, 3) [rad].
    half: Array  #: Half the interval of the error that remains, world, (points, 3) [m]; infinite if unseen.
    held: Mask  #: Joints that a limit stopped, (points, n).
    refused: tuple[Refusal | None, ...]  #: Why a point cannot be put right; None where it is.
    asked: Asked  #: What joints of the program were taken to mean.

    @property
    def corrected(self) -> Mask:
        """Which points are put right, (points,)."""
        return np.array([reason is None for reason in self.refused], dtype=bool)


def compensate(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load],
    aim: Aim | None = None,
    room: Site | None = None,
) -> Compensated:
    """Joints that put the loaded tool where a program asks it to be.

    Args:
        model: The arm, as of `load_model`.
        q: Joints of the program, (points, n) [rad, m].
        loads: What acts at the points, each the same at all or with a row a point.
        aim: Tool point, what of its pose is put right, and what joints of the program mean; the whole pose of
            the tool's origin if not given.
        room: Where the arm stands, for collisions; None leaves them unchecked.

    Returns:
        Corrected joints inside the limits, and what is left.

    Raises:
        BenchError: When shapes do not fit.
        NoEquilibrium: When the arm cannot bear a load; names the pose.
    """
    q = check_array(q, (None, model.arm.n_joints), "q [rad, m]")
    if not len(q):
        raise BenchError("q [rad, m]: expected at least one point")
    aim, loads = aim or Aim(), [load.over(len(q)) for load in loads]
    point = np.array(aim.point)
    meant: Asked = aim.asked or ("drawn" if model.absolute else "unloaded")
    target = asked(model.state, q, meant, point)
    before = rest(model.state, q, loads).at(point) - target.position
    found, held = within_limits(model, q, loads, target, aim)
    refused = _refused(model.arm, found, q, room)
    bad = np.array([reason is not None for reason in refused], dtype=bool)
    left = np.where(bad[:, None], before, -found.left)
    corrected = np.where(bad[:, None], q, found.q)
    acts = np.asarray(before.any(axis=1))
    corrected = np.where(acts[:, None], corrected, q)  # where nothing acts, as it was to the last digit
    start = None if model.absolute and meant == "drawn" else Poses(q)
    end = Poses(corrected, loads, heavy=meant == "drawn")
    half = half_widths(model, end, start, point[None])[:, 0]
    return Compensated(corrected, q, target, before, left, found.turned, half, held, tuple(refused), meant)


def within_limits(
    model: ArmModel, q: Array, loads: Sequence[Load], target: Target, aim: Aim
) -> tuple[Corrected, Mask]:
    """As `solve`; a joint that would pass its limit stays there, and the others do what they can.

    Returns:
        The joints, and which of them a limit stopped, (points, n).
    """
    arm, (lower, upper) = model.arm, model.arm.limits
    free_joints = True if arm.moves is None else arm.moves.any(axis=0)
    points = Points(model.state, q, loads, target, aim, np.ones(q.shape))
    found = solve(points)
    for _ in range(arm.n_joints):
        beyond = ((found.q < lower) | (found.q > upper)) & (points.free > 0) & free_joints
        some = np.flatnonzero(beyond.any(axis=1) & found.solved)
        if not len(some):
            break
        free = points.free * ~(beyond & found.solved[:, None])
        start = arm.followed(np.where(free > 0, points.start, np.clip(found.q, lower, upper)))
        points = replace(points, start=start, free=free)
        put(found, some, solve(points.of(some)))
    return found, points.free == 0


def _refused(arm: Arm, found: Corrected, q: Array, room: Site | None) -> list[Refusal | None]:
    """Why points cannot be put right."""
    lower, upper = arm.limits
    reasons: list[Refusal | None] = [None] * len(q)
    for k in np.flatnonzero(~found.solved):
        away = float(np.linalg.norm(found.left[k]))
        reasons[k] = Refusal("reach", size=away) if np.isfinite(away) else Refusal("equilibrium")
    for k, j in np.argwhere((found.q < lower - 1e-12) | (found.q > upper + 1e-12)):
        beyond = float(max(lower[j] - found.q[k, j], found.q[k, j] - upper[j]))
        reasons[k] = reasons[k] or Refusal("limit", (arm.joints[j].name,), beyond)
    if room is not None:
        good = np.flatnonzero([reason is None for reason in reasons])
        for k, pair in zip(good, collisions(room, found.q[good]), strict=True):
            if pair and collisions(room, q[k : k + 1])[0] != pair:
                reasons[k] = Refusal("collision", pair)
    return reasons
