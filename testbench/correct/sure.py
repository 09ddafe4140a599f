"""How sure a model is of where it has the tool: intervals of positions, and of how far they move.

A position is linear in what is unknown as far as that is still open: its rows are those of the bent arm,
Eq. (12) for compliances. What two poses share in them cancels in their difference.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.correct.rest import TOGETHER, loads_at, rest
from testbench.errors import Array, BenchError
from testbench.identify.arm_model import ArmModel
from testbench.identify.posterior import CONFIDENCE, check_confidence, quantile
from testbench.model.joint_errors import basis
from testbench.model.load import Load, on_joints
from testbench.model.loaded import displacement
from testbench.model.vjm import chain, parameter_rows, tool_pose, translation_rows
from testbench.model.weights import own_weight


@dataclass(frozen=True)
class Stand:
    """Poses of the arm and what acts in them."""

    q: Array  #: Joints as commanded, (poses, n) [rad, m].
    loads: Sequence[Load] = ()
    #: Whether own weight counts as one of the loads, to a model of compliances alone: deflections are then
    #: from the arm as drawn.
    heavy: bool = False

    def of(self, some: slice) -> "Stand":
        """Some of the poses."""
        return Stand(self.q[some], [load.over(len(self.q)).of(some) for load in self.loads], self.heavy)


def half_widths(
    model: ArmModel, end: Stand, start: Stand | None, points: Array, confidence: float = CONFIDENCE
) -> Array:
    """Half the interval of where points of the tool are, or of how far they are from where they were.

    Args:
        model: The arm.
        end: Where the tool is.
        start: Where it was, as many poses; None for positions in the world, of an absolute model.
        points: In the tool's frame, (k, 3) [m].
        confidence: Of each interval by itself.

    Returns:
        Along world x, y, z, (poses, k, 3) [m]; infinite where the model has not seen what decides.

    Raises:
        BenchError: When a model of compliances alone is asked for positions.
        NoEquilibrium: When the arm cannot bear a load.
    """
    check_confidence(confidence)
    if start is None and not model.absolute:
        raise BenchError("intervals: expected an absolute model for positions; this one knows deflections")
    scatter = quantile(math.inf, (1 + confidence) / 2) * model.scatter
    found = []
    for first in range(0, max(len(end.q), 1), TOGETHER):
        some = slice(first, first + TOGETHER)
        before = None if start is None else start.of(some)
        rows = rows_between(model, end.of(some), before, points)
        half = model.posterior.half_widths(rows.reshape(-1, rows.shape[-1]), confidence).reshape(
            rows.shape[:3]
        )
        if not model.absolute:
            half = np.hypot(half, curvature(model, end.of(some), points))
        elif start is None:
            half = np.hypot(half, scatter)
        found.append(half)
    return np.concatenate(found)


def fitted_half_widths(model: ArmModel, end: Stand, point: Array, confidence: float = CONFIDENCE) -> Array:
    """Half intervals of where a point of the tool is, relative to its other places: a frame fitted to them.

    Readings of a tracker do not tell where the base is from where its frame is: a calibrated arm knows places
    better beside each other than in its base. What a work frame measured by the tool takes up is taken out
    here: the rigid motion that fits all places best.

    Args:
        model: Absolute.
        end: At least 3 poses, not all in one place.
        point: In the tool's frame, (3,) [m].
        confidence: Of each interval by itself.

    Returns:
        Along world x, y, z, (poses, 3) [m].
    """
    rows = rows_between(model, end, None, point[None])[:, 0]
    x = rest(model.state, end.q, end.loads).at(point)
    x = x - x.mean(axis=0)
    turns = np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=2)
    F = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns], axis=2).reshape(-1, 6)
    A = rows.reshape(len(F), -1)
    A = A - F @ np.linalg.lstsq(F, A)[0]
    half = model.posterior.half_widths(A, confidence).reshape(x.shape)
    return np.asarray(np.hypot(half, quantile(math.inf, (1 + confidence) / 2) * model.scatter))


def rows_between(model: ArmModel, end: Stand, start: Stand | None, points: Array) -> Array:
    """Positions, or how far they are from where they were, per unit of every uncertain column.

    Returns:
        World x, y, z of every point, (poses, k, 3, c).
    """
    rows_of = _rows if model.absolute else _linear_rows
    rows = rows_of(model, end, points)
    if start is None or not (model.absolute or start.loads or start.heavy):  # nothing bends the drawn arm
        return rows
    return rows - rows_of(model, start, points)


def _rows(model: ArmModel, stand: Stand, points: Array) -> Array:
    """Positions per unit of every uncertain column, (poses, k, 3, c)."""
    state, unknowns = model.state, model.unknowns
    theta = rest(state, stand.q, stand.loads).theta
    where = chain(model.vjm, stand.q, theta)
    u = loads_at(state, where, [load.over(len(stand.q)) for load in stand.loads])
    J = translation_rows(where, points)
    A = np.zeros((len(J), unknowns.size, len(stand.q)))
    A[:, unknowns.columns("geometry")] = J[:, unknowns.inner]
    if state.errors.size:
        n = model.arm.n_joints
        phi = basis(state.errors, model.arm, stand.q, u[-n:], state.torque_scale)
        own = J[:, -n:, None] * phi
        A[:, unknowns.columns("errors")] = own.reshape(len(J), -1, len(stand.q))
    for row, line in zip(A, parameter_rows(model.structure, J, u), strict=True):
        row[unknowns.columns("elastic")] = line
    return A[:, model.columns].transpose(2, 0, 1).reshape(len(stand.q), len(points), 3, -1)


def _linear_rows(model: ArmModel, stand: Stand, points: Array) -> Array:
    """The same of a model of compliances alone, as Eq. (12) identified it: of loads on the unbent arm.

    Bending and own weight mix a little of every direction into every other; of one that the data have not
    seen that little would be infinite. What is left out here is in `curvature`.
    """
    where = chain(model.vjm, stand.q)
    u = on_joints(where, [load.over(len(stand.q)) for load in stand.loads])
    if stand.heavy:
        u = u + own_weight(where, model.state.weights)
    A = np.stack([*parameter_rows(model.structure, translation_rows(where, points), u)])
    return A.transpose(2, 0, 1).reshape(len(stand.q), len(points), 3, -1)


def curvature(model: ArmModel, stand: Stand, points: Array) -> Array:
    """What a linear model leaves out of deflections, (poses, k, 3) [m]: what its fit put elsewhere.

    Compliances are identified by Eq. (12), which is linear; the equilibrium is not.
    """
    state, loads = model.state, [load.over(len(stand.q)) for load in stand.loads]
    before = tool_pose(model.vjm, stand.q) if stand.heavy else rest(state, stand.q).pose
    after = rest(state, stand.q, loads).pose
    bent = np.einsum("rxy,py->rpx", after[1] - before[1], points) + (after[0] - before[0])[:, None]
    where = chain(model.vjm, stand.q)
    u = loads_at(state, where, loads) if stand.heavy else on_joints(where, loads)
    return np.asarray(np.abs(bent - displacement(where, (state.C_theta @ u).T, points)))
