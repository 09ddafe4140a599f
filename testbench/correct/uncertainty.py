"""How sure a model is of where it has the tool, and which part of it keeps it unsure.

A position is linear in what is unknown as far as that is still open: its rows are those of the bent arm,
Eq. (12) for compliances. What two poses share in them cancels in their difference.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.correct.rest import Rest, batches, rest
from testbench.data.dataset import in_order
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import State
from testbench.identify.arm_model import ArmModel
from testbench.identify.posterior import CONFIDENCE, conditional, quantile
from testbench.identify.rows import jacobian, straight
from testbench.model.joint_errors import basis
from testbench.model.load import Load, on_joints
from testbench.model.loaded import displacement
from testbench.model.vjm import chain, tool_pose
from testbench.model.weights import own_weight

LOOKED_AT = 60  #: Poses in which the part that leaves most open is looked for, evenly picked.
MOST = 0.5  #: Share of the variance from which a part is named.
LEAD = 1.2  #: Times the next one's share that it must have.


@dataclass(frozen=True)
class Poses:
    """Poses of the arm and what acts in them."""

    q: Array  #: Joints as commanded, (poses, n) [rad, m].
    loads: Sequence[Load] = ()
    #: Whether own weight counts as one of the loads, to a model of compliances alone: deflections are then
    #: from the arm as drawn.
    heavy: bool = False
    rest: Rest | None = None  #: The tool under these loads, where that is known already.

    def __post_init__(self) -> None:
        """Give every load a row a pose; BenchError where it has another number of them."""
        object.__setattr__(self, "loads", [load.over(len(self.q)) for load in self.loads])

    def of(self, some: slice | Ids) -> "Poses":
        """Some of the poses."""
        known = None if self.rest is None else in_order(self.rest, some)
        return Poses(self.q[some], [load.of(some) for load in self.loads], self.heavy, known)

    def frees(self, other: "Poses") -> bool:
        """Whether these are the poses of the other, without its loads."""
        return not (self.loads or self.heavy) and np.array_equal(self.q, other.q)

    def at_rest(self, state: State) -> Rest:
        """The tool under these loads; NoEquilibrium where the arm cannot bear them."""
        return self.rest or rest(state, self.q, self.loads)


def half_widths(model: ArmModel, end: Poses, start: Poses | None, points: Array) -> Array:
    """Half the 95 % interval of where points of the tool are, or of how far they are from where they were.

    Args:
        model: The arm.
        end: Where the tool is.
        start: Where it was, as many poses; None for positions in the world, of an absolute model.
        points: In the tool's frame, (k, 3) [m].

    Returns:
        Along world x, y, z, (poses, k, 3) [m]; infinite where the model has not seen what decides.

    Raises:
        BenchError: When a model of compliances alone is asked for positions.
        NoEquilibrium: When the arm cannot bear a load.
    """
    if start is None and not model.absolute:
        raise BenchError("intervals: expected an absolute model for positions; this one knows deflections")
    scatter, found = _scatter(model), []
    for some in batches(len(end.q)):
        before = None if start is None else start.of(some)
        rows = rows_between(model, end.of(some), before, points)
        half = model.posterior.half_widths(rows.reshape(-1, rows.shape[-1])).reshape(rows.shape[:3])
        if not model.absolute:
            own = end.of(some)
            free = before if before is not None and before.frees(own) else Poses(own.q)
            half = np.hypot(half, curvature(model, own, free, points))
        elif start is None:
            half = np.hypot(half, scatter)
        found.append(half)
    return np.concatenate(found)


def _scatter(model: ArmModel) -> float:
    """Half the interval of how readings scatter about an absolute model [m]."""
    return quantile(math.inf, (1 + CONFIDENCE) / 2) * model.scatter


def fitted_half_widths(model: ArmModel, end: Poses, point: Array) -> Array:
    """Half 95 % intervals of where a point of the tool is, relative to its others: a frame fitted to them.

    Readings of a tracker do not tell where the base is from where its frame is: a calibrated arm knows places
    better beside each other than in its base. What a work frame measured by the tool takes up is taken out
    here: the rigid motion that fits all places best.

    Args:
        model: Absolute.
        end: At least 3 poses, not all in one place.
        point: In the tool's frame, (3,) [m].

    Returns:
        Along world x, y, z, (poses, 3) [m].
    """
    rows = rows_between(model, end, None, point[None])[:, 0]
    x = end.at_rest(model.state).at(point)
    x = x - x.mean(axis=0)
    turns = np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=2)
    F = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns], axis=2).reshape(-1, 6)
    A = rows.reshape(len(F), -1)
    A = A - F @ np.linalg.lstsq(F, A)[0]
    half = model.posterior.half_widths(A).reshape(x.shape)
    return np.asarray(np.hypot(half, _scatter(model)))


def rows_between(model: ArmModel, end: Poses, start: Poses | None, points: Array) -> Array:
    """Positions, or how far they are from where they were, per unit of every uncertain column.

    Returns:
        World x, y, z of every point, (poses, k, 3, c).
    """
    rows = _rows(model, end, points)
    if start is None or not (model.absolute or start.loads or start.heavy):  # nothing bends the drawn arm
        return rows
    return rows - _rows(model, start, points)


def _rows(model: ArmModel, poses: Poses, points: Array) -> Array:
    """Positions per unit of every uncertain column, (poses, k, 3, c).

    Of the bent arm; of a model of compliances alone as Eq. (12) identified it, of loads on the unbent arm.
    There bending and own weight would mix a little of every direction into every other; of one that the data
    have not seen that little would be infinite. What is left out is in `curvature`.
    """
    state, told = model.state, straight(model.vjm, poses.q, poses.loads)
    if model.absolute:
        theta = poses.at_rest(state).theta
        where = chain(model.vjm, poses.q, theta)
        told = replace(told, theta=theta, where=where, u=on_joints(where, poses.loads))
    if model.absolute or poses.heavy:
        told = replace(told, u=own_weight(told.where, state.weights) + told.u)
    phi = basis(state.errors, model.arm, poses.q, told.u[model.vjm.own], state.torque_scale)
    A = jacobian(model.unknowns, replace(told, phi=phi), points, turned=False)
    return A[:, :, model.columns].transpose(3, 0, 1, 2)


def curvature(model: ArmModel, poses: Poses, free: Poses, points: Array) -> Array:
    """What a linear model leaves out of deflections, (poses, k, 3) [m]: what its fit put elsewhere.

    Compliances are identified by Eq. (12), which is linear; the equilibrium is not. `free` are the same poses
    without loads.
    """
    state, loads = model.state, poses.loads
    where, after = chain(model.vjm, poses.q), poses.at_rest(state)
    u = on_joints(where, loads)
    if poses.heavy:
        (position, rotation), u = tool_pose(model.vjm, poses.q), u + own_weight(where, state.weights)
    else:
        before = free.at_rest(state)
        position, rotation = before.position, before.rotation
    bent = np.einsum("rxy,py->rpx", after.rotation - rotation, points) + (after.position - position)[:, None]
    return np.asarray(np.abs(bent - displacement(where, (state.C_theta @ u).T, points)))


@dataclass(frozen=True)
class Open:
    """The part of a model that leaves most open."""

    name: str  #: A link or a joint, "geometry" or "joint errors".
    share: float  #: Of the variance of all positions, what knowing it would take away [1].
    joint: bool  #: Whether it is the spring of a joint.


def most_open(model: ArmModel, q: Array, loads: Sequence[Load], point: Array, absolute: bool) -> Open | None:
    """The part whose knowledge would take most of what is open away; None where no single one stands out.

    Args:
        model: The arm.
        q: Joints, (poses, n) [rad, m].
        loads: What acts, each the same in all poses or with a row a pose.
        point: Of the tool, in its frame, (3,) [m].
        absolute: Whether positions count, or how far loads move them.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(LOOKED_AT, len(q))).round().astype(int))
    end = Poses(q, loads, heavy=absolute).of(some)
    rows = rows_between(model, end, None if absolute else Poses(q[some]), point[None])
    rows = rows.reshape(-1, rows.shape[-1])
    unseen = np.isinf(model.posterior.deviations(rows))
    shares = _unbound(model, rows[unseen]) if unseen.any() else _taken_away(model, rows)
    (best, share), (_, second) = sorted(((k, s) for k, s in shares.items()), key=lambda one: -one[1])[:2]
    if share < MOST or share < LEAD * second:
        return None
    return Open(best, share, best in [joint.name for joint in model.arm.joints])


def _taken_away(model: ArmModel, rows: Array) -> dict[str, float]:
    """Share of the variance of functionals, rows (k, c), that is gone where a part is known."""
    k, size = len(rows), np.linalg.norm(model.posterior.root, axis=0)
    K = model.posterior.covariance(np.vstack([rows, np.diag(1 / np.where(size > 0, size, 1))]))
    whole, every = float(np.trace(K[:k, :k])), np.arange(k)
    return {
        name: (whole - float(np.trace(conditional(K, every, k + columns)))) / (whole or 1.0)
        for name, columns in _parts(model)
        if len(columns)
    }


def _unbound(model: ArmModel, rows: Array) -> dict[str, float]:
    """Share of functionals without bound, rows (k, c), that have one where a part is known."""
    shares = {}
    for name, columns in _parts(model):
        rest = rows.copy()
        rest[:, columns] = 0
        shares[name] = float(np.isfinite(model.posterior.deviations(rest)).mean())
    return shares


def _parts(model: ArmModel) -> Iterator[tuple[str, Ids]]:
    """Name of every part, and its columns among those that are uncertain."""
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
