"""Compensation of a program: corrected joints inside the limits, the remaining error, and refused points.

`compensate` is the last step of the flow: model, programmed joints and loads in, joints to command out.
Points that cannot be corrected keep their programmed joints and say why.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import NoneType
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.newton import (
    Aim,
    Asked,
    Corrected,
    Points,
    Target,
    assign_rows,
    equilibrium,
    solve_inverse_statics,
    target_of,
)
from testbench.correct.uncertainty import LoadedPoses, half_widths
from testbench.display import Displayed, span
from testbench.errors import Array, BenchError, Mask, check_array, check_items, check_type
from testbench.identify.arm_model import ArmModel
from testbench.model.load import Load
from testbench.plant.site import Site, collisions

Why = Literal["reach", "equilibrium", "limit", "collision"]
"""Reasons to refuse a point: out of reach, no equilibrium, beyond a joint's limit, or a new collision."""


@dataclass(frozen=True)
class Refusal:
    """State why a point cannot be corrected."""

    why: Why  #: The reason.
    names: tuple[str, ...] = ()  #: The joint that would pass its limit, or the two parts that would collide.
    size: float = 0.0  #: Remaining distance [m], or how far beyond the limit [rad, m].


@dataclass(frozen=True, repr=False)
class Compensated(Displayed):
    """Hold the joints that put the loaded tool where the program asks it to be, and the errors."""

    q: Array  #: Joints to command, those of the program at refused points, (points, n) [rad, m].
    start: Array  #: Joints of the program, (points, n) [rad, m].
    target: Target  #: Poses that the program asks for.
    before: Array  #: Predicted minus asked position without correction, world, (points, 3) [m].
    after: Array  #: Predicted minus asked position with it, world, (points, 3) [m].
    rotation_error: Array  #: Remaining rotation, a rotation vector, world, (points, 3) [rad].
    half_width: Array  #: Half width of the error's 95 % interval, world, (points, 3) [m]; infinite if unseen.
    stopped: Mask  #: Joints that a limit stopped, (points, n).
    refused: tuple[Refusal | None, ...]  #: Why a point is refused; None for a corrected one.
    reference: Asked  #: Meaning that the program's joints were given.

    def about(self) -> dict[str, object]:
        """Summarise the correction: points, refused points, and errors of position before and after."""
        sizes = (1e3 * np.linalg.norm(error, axis=1) for error in (self.before, self.after))
        return {
            "points": len(self.q),
            "refused": int((~self.corrected).sum()),
            **dict(zip(("before_mm", "after_mm"), map(span, sizes), strict=True)),
        }

    @property
    def corrected(self) -> Mask:
        """Tell which points are corrected, (points,)."""
        return np.array([reason is None for reason in self.refused], dtype=bool)


def compensate(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load],
    aim: Aim | None = None,
    room: Site | None = None,
) -> Compensated:
    """Find joints that put the loaded tool where a program asks it to be.

    Args:
        model: Identified model of the arm, such as `load_model` reads.
        q: Joints of the program, (points, n) [rad, m].
        loads: Loads at the points, each the same at all or with one row per point.
        aim: Tool point, the part of its pose to correct, and what joints of the program mean; None for the
            whole pose of the tool's origin.
        room: Surroundings of the arm, for collisions; None leaves collisions unchecked.

    Returns:
        Corrected joints inside the limits, remaining errors and their intervals.

    Raises:
        BenchError: When types or shapes do not fit, or there is no point.
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    check_type(aim, (Aim, NoneType), "aim")
    q = check_array(q, (None, model.arm.n_joints), "q [rad, m]")
    if not len(q):
        raise BenchError("q [rad, m]: expected at least one point")
    aim, loads = aim or Aim(), [load.over(len(q)) for load in loads]
    point = np.array(aim.point)
    meant: Asked = aim.reference or ("drawn" if model.absolute else "unloaded")
    # the target of the program, and how far the uncorrected tool is from it
    target = target_of(model.state, q, meant, point)
    before = equilibrium(model.state, q, loads).at(point) - target.position
    found, held = within_limits(model, q, loads, target, aim)
    refused = _refused(model.arm, found, q, room)
    bad = np.array([reason is not None for reason in refused], dtype=bool)
    # refused points keep their joints, and their error before correction
    left = np.where(bad[:, None], before, -found.position_error)
    corrected = np.where(bad[:, None], q, found.q)
    acts = np.asarray(before.any(axis=1))
    corrected = np.where(acts[:, None], corrected, q)  # where nothing acts, as it was to the last digit
    # interval of the error: of a position, or of the motion from the programmed to the corrected pose
    start = None if model.absolute and meant == "drawn" else LoadedPoses(q)
    end = LoadedPoses(corrected, loads, heavy=meant == "drawn")
    half = half_widths(model, end, start, point[None])[:, 0]
    return Compensated(
        corrected, q, target, before, left, found.rotation_error, half, held, tuple(refused), meant
    )


def within_limits(
    model: ArmModel, q: Array, loads: Sequence[Load], target: Target, aim: Aim
) -> tuple[Corrected, Mask]:
    """Solve all points as `solve_inverse_statics` does, with joints kept inside their limits.

    A joint that would pass its limit is held there, and the points are solved again with the other joints,
    until no further joint passes its limit.

    Args:
        model: Identified model of the arm.
        q: Joints to start from, (points, n) [rad, m].
        loads: Loads at the points, each with one row per point.
        target: Where the tool point has to be.
        aim: Tool point and the part of its pose to correct.

    Returns:
        The solution, and which joints a limit stopped, (points, n).
    """
    arm, (lower, upper) = model.arm, model.arm.limits
    free_joints = True if arm.moves is None else arm.moves.any(axis=0)
    points = Points(model.state, q, loads, target, aim, np.ones(q.shape))
    corrected = solve_inverse_statics(points)
    for _ in range(arm.n_joints):
        beyond = ((corrected.q < lower) | (corrected.q > upper)) & (points.free > 0) & free_joints
        some = np.flatnonzero(beyond.any(axis=1) & corrected.solved)
        if not len(some):
            break
        # hold the joints that passed a limit there, and solve these points again
        free = points.free * ~(beyond & corrected.solved[:, None])
        start = arm.followed(np.where(free > 0, points.start, np.clip(corrected.q, lower, upper)))
        points = replace(points, start=start, free=free)
        assign_rows(corrected, some, solve_inverse_statics(points.of(some)))
    return corrected, points.free == 0


def _refused(arm: Arm, corrected: Corrected, q: Array, room: Site | None) -> list[Refusal | None]:
    """Find why points cannot be corrected: reach, equilibrium, a limit, or a collision that is new."""
    lower, upper = arm.limits
    reasons: list[Refusal | None] = [None] * len(q)
    for k in np.flatnonzero(~corrected.solved):
        away = float(np.linalg.norm(corrected.position_error[k]))
        reasons[k] = Refusal("reach", size=away) if np.isfinite(away) else Refusal("equilibrium")
    for k, j in np.argwhere((corrected.q < lower - 1e-12) | (corrected.q > upper + 1e-12)):
        beyond = float(max(lower[j] - corrected.q[k, j], corrected.q[k, j] - upper[j]))
        reasons[k] = reasons[k] or Refusal("limit", (arm.joints[j].name,), beyond)
    if room is not None:
        good = np.flatnonzero([reason is None for reason in reasons])
        for k, pair in zip(good, collisions(room, corrected.q[good]), strict=True):
            if pair and collisions(room, q[k : k + 1])[0] != pair:
                reasons[k] = Refusal("collision", pair)
    return reasons
