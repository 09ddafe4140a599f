"""Intervals of predicted positions and deflections, and the part of a model that widens them most.

A position is linear in the remaining errors of the unknowns. Its rows are those of the deflected arm, Eq.
(12) for compliances; the model's posterior turns them into intervals. Errors common to two poses cancel in
their difference.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.correct.newton import RestPoses, batches, equilibrium
from testbench.data.dataset import select_evenly, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import ArmState
from testbench.identify.posterior import CONFIDENCE, ArmModel, conditional_covariance, quantile
from testbench.identify.rows import jacobian, nominal_chain
from testbench.model.kinematics import joint_error_basis
from testbench.model.load import Load, displacement, on_joints, own_weight
from testbench.model.vjm import chain, marker_motion, tool_pose

MAX_POSES = 60  #: Most poses, evenly picked, over which the most uncertain part is found.
MIN_VARIANCE_SHARE = 0.5  #: Least share of the variance for a part to be named [1].
MIN_SHARE_RATIO = 1.2  #: Least ratio of its share to that of the next part [1].


@dataclass(frozen=True)
class LoadedPoses:
    """Hold poses of the arm and the loads that act in them."""

    q: Array  #: Joints as commanded, (poses, n) [rad, m].
    loads: Sequence[Load] = ()  #: Loads that act together, besides own weight.
    #: Whether own weight counts as one of the loads for a model of compliances alone: deflections are then
    #: measured from the nominal rigid arm.
    with_own_weight: bool = False
    equilibrium: RestPoses | None = None  #: Equilibrium under these loads; None where it is not known yet.

    def __post_init__(self) -> None:
        """Give every load a row a pose; BenchError where it has another number of them."""
        object.__setattr__(self, "loads", [load.for_poses(len(self.q)) for load in self.loads])

    def select(self, poses: slice | Ids) -> "LoadedPoses":
        """Select some of the poses with their loads.

        Args:
            poses: Indices of the poses, (k,), or a slice.
        """
        known = None if self.equilibrium is None else select_rows(self.equilibrium, poses)
        return LoadedPoses(
            self.q[poses], [load.select(poses) for load in self.loads], self.with_own_weight, known
        )

    def is_unloaded(self, other: "LoadedPoses") -> bool:
        """Tell whether these are the same poses as others, but without any load.

        Args:
            other: Poses under loads.

        Returns:
            True if the joints are equal and no load acts here.
        """
        return not (self.loads or self.with_own_weight) and np.array_equal(self.q, other.q)

    def rest_poses(self, state: ArmState) -> RestPoses:
        """Return the equilibrium under these loads; solve it if it is not known.

        Args:
            state: The identified arm.

        Raises:
            NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        """
        return self.equilibrium or equilibrium(state, self.q, self.loads)


def half_widths(model: ArmModel, end: LoadedPoses, start: LoadedPoses | None, points: Array) -> Array:
    """Compute half widths of 95 % intervals of positions, or of motions from one pose to another.

    Mathematics: `int-8`.

    Args:
        model: Identified model of the arm.
        end: Poses whose positions are predicted.
        start: Poses from which the motion is measured, as many; None for positions in the world, by an
            absolute model.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Half widths along world x, y, z, (poses, k, 3) [m]; infinite where the data have not determined what
        decides.

    Raises:
        BenchError: When positions are requested of a model of compliances only.
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    if start is None and not model.absolute:
        raise BenchError("intervals: expected an absolute model for positions; this one knows deflections")
    scatter, widths = _scatter(model), []
    for batch in batches(len(end.q)):
        before = None if start is None else start.select(batch)
        # Widths by the posterior, then terms that a linear model leaves out, or the scatter of positions.
        rows = rows_between(model, end.select(batch), before, points)
        half = model.posterior.half_widths(rows.reshape(-1, rows.shape[-1])).reshape(rows.shape[:3])
        if not model.absolute:
            loaded_poses = end.select(batch)
            free = (
                before
                if before is not None and before.is_unloaded(loaded_poses)
                else LoadedPoses(loaded_poses.q)
            )
            half = np.hypot(half, curvature(model, loaded_poses, free, points))
        elif start is None:
            half = np.hypot(half, scatter)
        widths.append(half)
    return np.concatenate(widths)


def _scatter(model: ArmModel) -> float:
    """Compute the half width of the 95 % interval of readings about an absolute model [m]."""
    return quantile(math.inf, (1 + CONFIDENCE) / 2) * model.scatter


def fitted_half_widths(model: ArmModel, end: LoadedPoses, point: Array) -> Array:
    """Compute half widths of 95 % intervals of positions relative to each other: a frame is fitted to all.

    A tracker does not see the base, only its own frame. So an absolute model is more accurate between places
    than against its base. The rigid motion that fits all places best is removed here, as a work frame
    measured by the tool removes it.

    Mathematics: `int-9`.

    Args:
        model: Absolute model.
        end: At least 3 poses, not all in one place.
        point: Point in the tool's frame, (3,) [m].

    Returns:
        Half widths along world x, y, z, (poses, 3) [m].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    rows = rows_between(model, end, None, point[None])[:, 0]
    x = end.rest_poses(model.state).at(point)
    x = x - x.mean(axis=0)
    # F: motions of the places by a translation and a small rotation of the frame
    F = marker_motion(x)
    # rows without the part that the best rigid motion explains
    A = rows.reshape(len(F), -1)
    A = A - F @ np.linalg.lstsq(F, A)[0]
    half = model.posterior.half_widths(A).reshape(x.shape)
    return np.asarray(np.hypot(half, _scatter(model)))


def rows_between(model: ArmModel, end: LoadedPoses, start: LoadedPoses | None, points: Array) -> Array:
    """Compute positions, or motions from one pose to another, per unit of every uncertain unknown.

    Mathematics: `cor-8`.

    Args:
        model: Identified model of the arm.
        end: Poses whose positions are predicted.
        start: Poses from which the motion is measured; None for positions.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Rows along world x, y, z of every point, (poses, k, 3, c) [m per unit of the unknown].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    rows = _rows(model, end, points)
    # nothing bends the drawn arm
    if start is None or not (model.absolute or start.loads or start.with_own_weight):
        return rows
    return rows - _rows(model, start, points)


def _rows(model: ArmModel, poses: LoadedPoses, points: Array) -> Array:
    """Compute positions per unit of every uncertain unknown, (poses, k, 3, c).

    An absolute model uses the deflected arm. A model of compliances alone uses loads on the undeflected arm,
    as Eq. (12) identified it. There deflection and own weight would mix a little of every direction into
    every other; where the data have not shown one of them, that little would become infinite. `curvature`
    covers what is left out.
    """
    state, at_rest = model.state, nominal_chain(model.vjm, poses.q, poses.loads)
    if model.absolute:
        theta = poses.rest_poses(state).theta
        where = chain(model.vjm, poses.q, theta)
        at_rest = replace(at_rest, theta=theta, chain=where, u=on_joints(where, poses.loads))
    if model.absolute or poses.with_own_weight:
        at_rest = replace(at_rest, u=own_weight(at_rest.chain, state.weights) + at_rest.u)
    phi = joint_error_basis(
        state.errors, model.arm, poses.q, at_rest.u[model.vjm.joint_slice], state.torque_scale
    )
    A = jacobian(model.unknowns, replace(at_rest, phi=phi), points, rotations=False)
    return A[:, :, model.columns].transpose(3, 0, 1, 2)


def curvature(model: ArmModel, poses: LoadedPoses, free: LoadedPoses, points: Array) -> Array:
    """Compute the deflection that a linear model leaves out, which its fit put into other parameters.

    Compliances are identified by Eq. (12), which is linear; the equilibrium is not.

    Mathematics: `int-7`.

    Args:
        model: Identified model of the arm.
        poses: Loaded poses.
        free: The same poses without loads.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Absolute difference of equilibrium and linear model along world x, y, z, (poses, k, 3) [m].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    state, loads = model.state, poses.loads
    where, after = chain(model.vjm, poses.q), poses.rest_poses(state)
    u = on_joints(where, loads)
    if poses.with_own_weight:
        (position, rotation), u = tool_pose(model.vjm, poses.q), u + own_weight(where, state.weights)
    else:
        before = free.rest_poses(state)
        position, rotation = before.position, before.rotation
    bent = np.einsum("rxy,py->rpx", after.rotation - rotation, points) + (after.position - position)[:, None]
    return np.asarray(np.abs(bent - displacement(where, (state.C_theta @ u).T, points)))


@dataclass(frozen=True)
class LargestUncertainty:
    """Name the part of a model that causes most of the remaining uncertainty."""

    name: str  #: Name of a link or joint, "geometry" or "joint errors".
    share: float  #: Share of the variance, or of unbounded rows, that knowing the part would remove [1].
    joint: bool  #: Whether it is the spring of a joint.


def largest_uncertainty(
    model: ArmModel, q: Array, loads: Sequence[Load], point: Array, absolute: bool
) -> LargestUncertainty | None:
    """Find the part whose exact knowledge would remove most of the remaining uncertainty.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        point: Point in the tool's frame, (3,) [m].
        absolute: Whether positions count, not how far loads move the point.

    Returns:
        The part; None where no single one stands out by `MIN_VARIANCE_SHARE` and `MIN_SHARE_RATIO`.

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    sample = select_evenly(np.arange(len(q)), MAX_POSES)
    end = LoadedPoses(q, loads, with_own_weight=absolute).select(sample)
    rows = rows_between(model, end, None if absolute else LoadedPoses(q[sample]), point[None])
    rows = rows.reshape(-1, rows.shape[-1])
    unseen = np.isinf(model.posterior.deviations(rows))
    shares = _bounded_shares(model, rows[unseen]) if unseen.any() else _variance_shares(model, rows)
    (best, share), (_, second) = sorted(((k, s) for k, s in shares.items()), key=lambda entry: -entry[1])[:2]
    if share < MIN_VARIANCE_SHARE or share < MIN_SHARE_RATIO * second:
        return None
    return LargestUncertainty(best, share, best in [joint.name for joint in model.arm.joints])


def _variance_shares(model: ArmModel, rows: Array) -> dict[str, float]:
    """Compute the share of the variance of functionals, rows (k, c), that is gone where a part is known."""
    k, size = len(rows), np.linalg.norm(model.posterior.root, axis=0)
    K = model.posterior.covariance(np.vstack([rows, np.diag(1 / np.where(size > 0, size, 1))]))
    whole, every = float(np.trace(K[:k, :k])), np.arange(k)
    return {
        name: (whole - float(np.trace(conditional_covariance(K, every, k + columns)))) / (whole or 1.0)
        for name, columns in _parts(model)
        if len(columns)
    }


def _bounded_shares(model: ArmModel, rows: Array) -> dict[str, float]:
    """Compute the share of functionals without bound, rows (k, c), that have one where a part is known."""
    shares = {}
    for name, columns in _parts(model):
        rest = rows.copy()
        rest[:, columns] = 0
        shares[name] = float(np.isfinite(model.posterior.deviations(rest)).mean())
    return shares


def _parts(model: ArmModel) -> Iterator[tuple[str, Ids]]:
    """Yield the name of every part, and its columns among those that are uncertain."""
    unknowns, structure = model.unknowns, model.structure
    for key, name in (("geometry", "geometry"), ("errors", "joint errors")):
        inside = np.arange(unknowns.size)[unknowns.columns(key)]
        yield name, np.flatnonzero(np.isin(model.columns, inside))
    first, links = unknowns.starts["elastic"], [link.name for link in model.arm.links]
    joints = [joint.name for joint in model.arm.joints]
    laws = model.vjm.laws
    of_laws = [] if laws is None else [joints[k] for k in laws.joints]  # they count as their joint's
    names = [*np.repeat(links, 6), *joints, *of_laws]
    owner = np.array(names)[structure.a]
    for name in dict.fromkeys(owner.tolist()):
        inside = first + np.flatnonzero(owner == name)
        yield name, np.flatnonzero(np.isin(model.columns, inside))
