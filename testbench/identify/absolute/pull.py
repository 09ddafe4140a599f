"""Information of poses that were not read: each joint turned by itself, and poses in the whole joint space.

Directions that no pose determines are structural: a change along them moves no target.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, Ids
from testbench.identify.absolute.state import ArmState
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.rows import series_rows

FURTHER_ROWS = 40
"""Further rows in which a joint is turned."""
AMPLE = 2
"""Equations of poses in the whole joint space, over the number of unknowns [1]."""
NEVER = 1e-3
"""Information of these poses over the prior's below which a direction is structural [1]."""
ZERO_INFORMATION = 1e-10
"""Eigenvalue of information with unit diagonal below which it counts as zero [1]."""
OFF = 1.0
"""Information of unknowns that are fixed at zero: they are not structural."""
COMMON_DIRECTION = 0.1
"""Singular value below which two sets of directions share one [1]."""


@dataclass(frozen=True)
class AddedInformation:
    """Hold the information that further readings would add."""

    turned: Array  #: Rows as in the series, with one joint turned through its range, (n, size, size).
    everywhere: Array  #: Poses in the whole joint space, more than there are unknowns, (size, size).
    rigid: Array  #: These poses of the rigid nominal arm, for what is structural in geometry, (size, size).


def pull_of(
    unknowns: Unknowns,
    state: ArmState,
    series: tuple[Series, ...],
    tells: Callable[[Series], Array] | None = None,
) -> AddedInformation:
    """Compute the information that further readings would add, under the loads of some series.

    Args:
        unknowns: The unknowns.
        state: Where the equations are linearised.
        series: Series that were read, or are planned.
        tells: Function that computes the information of a series, without a prior, (size, size); None for
            `information` at the state.

    Returns:
        The information, by the joint that is turned and for poses in the whole joint space.
    """
    arm = unknowns.vjm.arm
    lower, upper = arm.limits
    rng = np.random.Generator(np.random.Philox(0))
    told = tells or (lambda one: information(unknowns, state, one))

    def turned(j: int) -> Array:
        total = np.zeros((unknowns.size,) * 2)
        for one in series:
            count = min(one.rows, -(-FURTHER_ROWS // len(series)))
            rows = np.linspace(0, one.rows - 1, count).round().astype(int)
            q = one.q[rows].copy()
            stratified = (rng.permutation(count) + rng.random(count)) / count
            q[:, j] = stratified * (upper[j] - lower[j]) + lower[j]
            total += told(_moved(one, rows, arm.followed(q)))
        return total

    everywhere = []
    for one in series:
        count = -(-AMPLE * unknowns.size // (3 * len(one.markers) * len(series)))
        q = arm.drawn(rng, count)
        everywhere.append(_moved(one, np.arange(count) % one.rows, q))
    none = {name: np.zeros_like(getattr(state, name)) for name in ("theta_0", "C_theta", "n")}
    rigid = [information(unknowns, replace(state, **none), one) for one in everywhere]
    every = np.stack([turned(j) for j in range(len(lower))])
    return AddedInformation(every, np.sum([told(one) for one in everywhere], axis=0), np.sum(rigid, axis=0))


def information(unknowns: Unknowns, state: ArmState, series: Series) -> Array:
    """Compute the information of a series about the unknowns, A^T W A, without a prior.

    Args:
        unknowns: The unknowns.
        state: Where the equations are linearised.
        series: The readings: their positions and orientations count, with their stated noise.

    Returns:
        Information, (size, size).
    """
    m = len(series.markers)
    A = series_rows(unknowns, state, series)[:, :, :-1]
    A[:m] /= series.sigma
    if series.sigma_rotation is not None:
        A[m:] /= series.sigma_rotation
    flat = A.transpose(2, 0, 1, 3).reshape(unknowns.size, -1)
    return np.asarray(flat @ flat.T)


def _moved(series: Series, rows: Ids, q: Array) -> Series:
    """Put rows of a series into other poses, (count, n) [rad, m], with every target read."""
    rotation = None if series.rotation is None else np.tile(np.eye(3), (series.rows, 1, 1))
    return replace(select_rows(replace(series, precision=None, rotation=rotation), rows), q=q)


@dataclass(frozen=True)
class Structural:
    """Hold the directions that no pose determines under the given loads."""

    directions: Array  #: Orthonormal directions in units of the prior, (size, k).
    geometry: int  #: Number of those in geometry, frames and mounts.
    shared: tuple[int, ...]  #: Of these, the number between the two links of every joint.
    idle: tuple[int, ...]  #: Joints whose errors move no target, such as the last with a target on its axis.
    elastic: int  #: Number of compliance directions that the given loads do not show.


def structural(unknowns: Unknowns, L: Array, pull: AddedInformation) -> Structural:
    """Find the structural directions: changes of the unknowns that move no target in any pose.

    Args:
        unknowns: The unknowns.
        L: Root of the prior's covariance, (size, size).
        pull: Information of further readings.

    Returns:
        The directions in units of the prior, and how many concern geometry, joints and compliances.
    """
    # Directions with hardly any information, in units of the prior.
    M, drawn = L.T @ pull.everywhere @ L, L.T @ pull.rigid @ L
    M, drawn = (part + np.diag(np.where(np.diag(L) > 0, 0.0, OFF)) for part in (M, drawn))
    values, V = np.linalg.eigh(M)
    geometry = np.arange(unknowns.starts["errors"])
    # Structural directions of geometry, exactly, by the rigid nominal arm.
    never = np.zeros((len(M), _dimension(drawn, geometry)))
    never[geometry] = np.linalg.eigh(drawn[np.ix_(geometry, geometry)])[1][:, : never.shape[1]]
    U, s, _ = np.linalg.svd(np.hstack([V[:, values < NEVER], never]), full_matrices=False)
    # How these directions divide over joints.
    joints, first = range(unknowns.vjm.arm.n_joints), unknowns.starts["elastic"]
    around = [_around(unknowns, k) for k in range(len(joints) + 1)]
    own = [_dimension(drawn, columns) for columns in around]
    size = unknowns.errors.size
    of_joint = [unknowns.starts["errors"] + j * size + np.arange(size) for j in joints]
    return Structural(
        directions=U[:, s > COMMON_DIRECTION],
        geometry=never.shape[1],
        shared=tuple(
            _dimension(drawn, np.concatenate(around[j : j + 2])) - sum(own[j : j + 2]) for j in joints
        ),
        idle=tuple(j for j in joints if size and _dimension(M, of_joint[j]) == size),
        elastic=int((np.linalg.eigvalsh(M[first:, first:]) < NEVER).sum()),
    )


def _dimension(M: Array, columns: Ids) -> int:
    """Count the directions of some columns without information."""
    block = M[np.ix_(columns, columns)]
    size = np.sqrt(np.diag(block))
    told = size > ZERO_INFORMATION * size.max(initial=0.0)
    unit = block[np.ix_(told, told)] / np.outer(size[told], size[told])
    return int((~told).sum() + (np.linalg.eigvalsh(unit) < ZERO_INFORMATION).sum())


def _around(unknowns: Unknowns, k: int) -> Ids:
    """List the columns of a link; the first link includes the frames, the last the mounts."""
    mounts = unknowns.columns(f"frame {unknowns.frames[-1]}").stop
    first = unknowns.starts["geometry"]
    if k == 0:
        return np.arange(mounts)
    if k == unknowns.vjm.arm.n_joints:
        return np.arange(mounts, first)
    return first + 6 * (k - 1) + np.arange(6)
