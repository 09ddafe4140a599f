"""Two searches among more candidates than can be fitted: orders of the joints, and shifted rows.

Of six joints there are 720 orders. With the joints in the right one, the tool's pose R, p by the kinematics
and a target m on the tool, readings y fit some frame where

    A y + b = R m + p

The form is linear in A, b and, if it is unknown, m. Its residual is small only for the right order. The few
orders that fit it best are then fitted with a frame, whose A is a rotation.

If a cell of a table was deleted, all readings from its row on are shifted against their poses. One half of
the rows is all sound or all shifted: it determines the frame. The shift begins at the row where the summed
losses are least.

`check_last_joint_sign` and `check_row_order` find absolute readings that fit the arm although they are wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from testbench.data.dataset import Series, evenly_spaced, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.align import Misfit, Noise
from testbench.identify.absolute.state import ArmState
from testbench.identify.diagnosis.kinematics import (
    MAX_ROWS,
    MIN_NATS_PER_READING,
    UNFIT_DISTANCE,
    Fit,
    Observations,
    cauchy,
    fit,
    fit_residuals,
    of_series,
)
from testbench.model.vjm import Vjm, chain, tool_pose

MAX_JOINTS = 7  #: Up to which every order is tried; of more joints, every exchange of two and the reverse.
SCREENED_ROWS, SCREENED_TARGETS = 30, 2  #: Poses, evenly out of more, and first targets that screen orders.
FITTED_ORDERS = 6  #: Orders that are fitted, the best of all.
REWEIGHTINGS = 3  #: Weightings of the linear form: a wild reading must not choose the order.
ORDERS_AT_ONCE = 720  #: Orders whose equations are in memory at a time.
RIDGE = 1e-9  #: Ridge of the normal equations, over their mean diagonal, for undetermined directions.
MIN_ROWS = 3  #: Fewest rows of half a file, and of a slipped part.


def likely_joint_orders(observations: Observations) -> Iterator[Ids]:
    """Find the most probable orders of the joints in the file, by a linear form (see the module).

    Yields:
        At most FITTED_ORDERS orders, (n,) each, the most probable first: joint k has the angles of column
        order[k].
    """
    n = len(observations.vjm.arm.joints)
    if n <= MAX_JOINTS:
        every = np.array(list(permutations(range(n)))[1:], dtype=int).reshape(-1, n)
    else:
        every = np.array([np.arange(n)[::-1], *(_exchange(n, *pair) for pair in combinations(range(n), 2))])
    rows = np.flatnonzero(observations.seen.any(axis=1))
    rows = rows[evenly_spaced(len(rows), SCREENED_ROWS)]
    parts = np.array_split(every, -(-len(every) // ORDERS_AT_ONCE)) if len(every) else []
    cost = [loss for part in parts for loss in _screened(observations, rows, part)]
    yield from every[np.argsort(cost, kind="stable")[:FITTED_ORDERS]]


def _exchange(n: int, i: int, j: int) -> Ids:
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def _screened(observations: Observations, rows: Ids, orders: Ids) -> Array:
    """Compute the robustly weighted loss of the linear form for every order, (orders,) [nats]."""
    count = len(orders)
    p, R = tool_pose(
        observations.vjm, observations.q[rows][:, orders].swapaxes(0, 1).reshape(-1, orders.shape[1])
    )
    row, target = np.nonzero(observations.seen[rows, :SCREENED_TARGETS])
    p, R = p.reshape(count, -1, 3)[:, row], R.reshape(count, -1, 3, 3)[:, row]
    y = observations.position[rows][row, target]
    right, columns = p + np.matvec(R, observations.markers[target]), np.zeros((count, len(row), 3, 0))
    if not observations.free.frame:
        right = right - y
    else:
        fixed = np.zeros((len(row), 3, 12))  # of A, by rows, and of b: the same in every order
        for axis in range(3):
            fixed[:, axis, 3 * axis : 3 * axis + 3] = y
            fixed[:, axis, 9 + axis] = 1
        columns = np.broadcast_to(fixed, (count, *fixed.shape))
    if observations.free.targets:
        of = np.equal(target[:, None], np.arange(observations.seen[:, :SCREENED_TARGETS].shape[1]))
        target_columns = -R[:, :, :, None, :] * of[None, :, None, :, None]
        columns = np.concatenate([columns, target_columns.reshape(*target_columns.shape[:3], -1)], axis=3)
    weight, left = np.ones(right.shape[:2]), right
    for _ in range(REWEIGHTINGS if columns.shape[3] else 0):
        held = columns * weight[..., None, None]
        H = np.einsum("orxa,orxb->oab", held, columns, optimize=True)
        g = np.einsum("orxa,orx->oa", held, right)
        ridge = RIDGE * np.trace(H, axis1=1, axis2=2) / H.shape[1]
        x = np.linalg.solve(H + ridge[:, None, None] * np.eye(H.shape[1]), g[..., None])
        left = right - (columns @ x[:, None])[..., 0]
        off = np.linalg.norm(left, axis=2)
        weight = 1 / (1 + (off / np.maximum(np.median(off, axis=1, keepdims=True), observations.scale)) ** 2)
    return np.asarray(cauchy(left, observations.scale).sum(axis=1))


@dataclass(frozen=True)
class RowShift:
    """Hold the row from which all readings belong to another pose."""

    first: int  #: The row, counted from 0.
    shift: int  #: 1 if readings belong to the pose before, -1 for the pose after.
    q: Array  #: The joint angles that the readings belong to, (poses, n) [rad, m].


def find_row_shift(observations: Observations) -> RowShift | None:
    """Find the row from which readings are those of the pose before or after, with all rows before it sound.

    It is None when no slip explains the readings clearly better.
    """
    n, far = len(observations.q), UNFIT_DISTANCE * observations.scale
    head = _fit_half(observations, slice(n // 2))
    if head is None or _misfits(observations, head, np.arange(n)[-MAX_ROWS:]) < MIN_ROWS:
        return None
    _, gain, first, shift, best_fit = min(_slip_costs(observations, head), key=lambda candidate: candidate[0])
    while first > 1 and _misfits(observations, best_fit, np.array([first - 1])):
        first -= 1  # the row that was deleted has no pose at all
    q = np.roll(observations.q, shift, axis=0)
    q[:first] = observations.q[:first]
    before, behind = (
        _median_distance(replace(observations, q=q), best_fit, part)
        for part in (slice(first), slice(first, None))
    )
    sound = gain > MIN_NATS_PER_READING * observations.seen[first:].sum() and max(before, behind) < far
    return RowShift(first, shift, q) if sound else None


def _slip_costs(observations: Observations, head: Fit) -> Iterator[tuple[float, float, int, int, Fit]]:
    """Yield the cost of all readings if they slipped one way from the best row, and the gain [nats].

    With them the row, the way and the fit: of the first half, all sound, or of the second, all slipped.
    """
    for shift in (1, -1):
        moved = replace(observations, q=np.roll(observations.q, shift, axis=0))
        for half_fit in (head, _fit_half(moved, slice(len(observations.q) // 2, None)) or head):
            as_read, slipped = (
                cauchy(
                    fit_residuals(observed, chain(observed.vjm, observed.q), half_fit), observed.scale
                ).sum(axis=1)
                for observed in (observations, moved)
            )
            cost = np.cumsum(as_read - slipped)[:-MIN_ROWS] + slipped.sum()
            # an inserted row fits either way
            alike = cost < cost.min() + MIN_NATS_PER_READING * observations.seen.shape[1]
            first = 1 + int(np.flatnonzero(alike)[-1])
            yield float(cost.min()), float(as_read.sum() - cost.min()), first, shift, half_fit


def _fit_half(observations: Observations, half: slice) -> Fit | None:
    """Fit frame and targets to half of the rows; None if there are too few."""
    rows = np.arange(len(observations.q))[half]
    sample = observations.select(rows[evenly_spaced(len(rows), MAX_ROWS)])
    return fit(sample) if len(rows) >= MIN_ROWS and sample.seen.any() else None


def _misfits(observations: Observations, fitted: Fit, rows: Ids) -> int:
    """Count how many of the given rows do not fit the arm in the fitted frame."""
    sample = observations.select(rows)
    off = np.linalg.norm(fit_residuals(sample, chain(sample.vjm, sample.q), fitted), axis=2)
    return int((off > UNFIT_DISTANCE * observations.scale).any(axis=1).sum())


def _median_distance(observations: Observations, fitted: Fit, part: slice) -> float:
    """Compute the median distance of the readings in some rows [m]; 0 without any."""
    off = np.linalg.norm(
        fit_residuals(observations, chain(observations.vjm, observations.q), fitted), axis=2
    )[part][observations.seen[part]]
    return float(np.median(off)) if len(off) else 0.0


MAX_SCATTER_RATIO = 0.5  #: Scatter over that of the readings as they are, below which they were mistaken [1].


def check_last_joint_sign(
    vjm: Vjm, series: Sequence[Series], fitted: Callable[[tuple[Series, ...]], tuple[ArmState, Noise]]
) -> None:
    """Refuse readings that fit much better with the last joint's sign reversed.

    A target near the last joint's axis lets them fit a frame with either sign. With orientations, which show
    the sign, nothing is checked here.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.
        fitted: Function that fits geometry and springs to series, and returns state and noise.

    Raises:
        BenchError: When the scatter with the sign reversed is below MAX_SCATTER_RATIO times the scatter as
            read.
    """
    if any(readings.rotation is not None for readings in series):
        return
    thin = [select_rows(readings, evenly_spaced(readings.rows, MAX_ROWS)) for readings in series]
    sign = np.where(np.arange(vjm.arm.n_joints) == vjm.arm.n_joints - 1, -1.0, 1.0)
    try:
        mirrored = fitted(tuple(replace(readings, q=sign * readings.q) for readings in thin))[
            1
        ].position_model_error
    except BenchError:
        return
    as_read = fitted(tuple(thin))[1].position_model_error
    if mirrored < MAX_SCATTER_RATIO * as_read:
        raise BenchError(
            f"{series[0].name}: the readings fit this arm to {1e3 * as_read:.2g} mm along an axis; with the "
            f"other sign of {vjm.arm.joints[-1].name} they would fit to {1e3 * mirrored:.2g} mm"
        )


def check_row_order(vjm: Vjm, series: Sequence[Series]) -> None:
    """Refuse a series whose rows slipped against their poses.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Raises:
        Misfit: When the rows of one series belong to other poses from some row on.
    """
    for readings in series:
        if readings.distance is None and (slip := find_row_shift(of_series(vjm, readings))):
            first = readings.row[slip.first]
            raise Misfit(f"{readings.name}: its rows from {first} on do not fit those before", readings)
