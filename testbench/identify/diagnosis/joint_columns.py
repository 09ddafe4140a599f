"""Joint columns of a file that are not the arm's joints: in another order, or counting another joint too.

Of six joints there are 720 orders. Each is screened first: with the joints in that order, the tool's pose
R, p by the kinematics and a target m on the tool, readings y fit some frame where

    A y + b = R m + p

The form is linear in A, b and, where it is not known, m; its residual is small for the right order alone. The
few orders that fit it best are then fitted as a frame that can only turn and move.
"""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from testbench.errors import Array, Ids
from testbench.identify.diagnosis.place import Free, Seen, losses
from testbench.model.vjm import tool_pose

MOST_JOINTS = 7  #: Up to which every order is tried; of more joints, every exchange and cycle of three.
ROWS, TARGETS = 30, 2  #: Poses, evenly out of more, and first targets that orders are screened by.
FITTED = 6  #: Orders that are fitted, the best of all.
ROUNDS = 3  #: Weightings of the linear form: a wild reading must not choose the order.
TOGETHER = 720  #: Orders whose equations are in memory at a time.
RIDGE = 1e-9  #: Of the normal equations, over their mean diagonal: a direction may be open.


def orders(seen: Seen, free: Free) -> Iterator[Ids]:
    """Orders of the joints that fit the readings best, the best first: joint k is of column order[k]."""
    every = _every(len(seen.vjm.arm.joints))
    rows = np.flatnonzero(seen.there.any(axis=1))
    some = rows[np.unique(np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).astype(int))]
    parts = np.array_split(every, -(-len(every) // TOGETHER)) if len(every) else []
    cost = np.concatenate([_screened(seen, free, some, part) for part in parts]) if parts else np.zeros(0)
    for k in np.argsort(cost, kind="stable")[:FITTED]:
        yield every[k]


def _every(n: int) -> Ids:
    """All orders of n joints but their own, (orders, n)."""
    own = tuple(range(n))
    if n <= MOST_JOINTS:
        found = [order for order in permutations(own) if order != own]
    else:
        found = [own[::-1]]
        for one in product(range(n), repeat=3):
            order = list(own)
            i, j, k = one
            if i < min(j, k) and j != k:
                order[i], order[j], order[k] = j, k, i
            elif i < j == k:
                order[i], order[j] = j, i
            else:
                continue
            found.append(tuple(order))
    return np.array(found, dtype=int).reshape(-1, n)


def _screened(seen: Seen, free: Free, rows: Ids, every: Ids) -> Array:
    """Loss of the linear form in every order, (orders,) [nats]."""
    p, R = tool_pose(seen.vjm, seen.q[rows][:, every].swapaxes(0, 1).reshape(-1, every.shape[1]))
    p, R = p.reshape(len(every), len(rows), 3), R.reshape(len(every), len(rows), 3, 3)
    row, target = np.nonzero(seen.there[rows, :TARGETS])
    y, at = seen.read[rows][row, target], np.eye(3)
    p, R, markers = p[:, row], R[:, row], seen.markers[target]
    fixed = np.zeros((len(row), 3, 12))  # of A, by rows, and of b: the same in every order
    fixed[:, np.arange(3), 9 + np.arange(3)] = 1
    for axis in range(3):
        fixed[:, axis, 3 * axis : 3 * axis + 3] = y
    of = np.equal(target[:, None], np.arange(seen.there[:, :TARGETS].shape[1]))
    columns, right = np.broadcast_to(fixed, (len(every), *fixed.shape)), p + np.matvec(R, markers)
    if free.targets:
        own = -R[:, :, :, None, :] * of[None, :, None, :, None]
        columns = np.concatenate([columns, own.reshape(*own.shape[:3], -1)], axis=3)
    elif not free.frame:
        columns, right = np.broadcast_to(at[:, :0], (*right.shape, 0)), right - y
    return _left(columns, right, seen.scale)


def _left(columns: Array, right: Array, scale: float) -> Array:
    """What the linear form leaves, robustly weighted, (orders,) [nats].

    Args:
        columns: Of its unknowns, (orders, readings, 3, k).
        right: What they are to explain, (orders, readings, 3) [m].
        scale: How far a sound reading may lie off [m].
    """
    weight, left = np.ones(right.shape[:2]), right
    for _ in range(ROUNDS if columns.shape[3] else 0):
        held = columns * weight[..., None, None]
        H, g = (
            np.einsum("orxa,orxb->oab", held, columns, optimize=True),
            np.einsum("orxa,orx->oa", held, right),
        )
        size = RIDGE * np.trace(H, axis1=1, axis2=2) / H.shape[1]
        H[:, np.arange(H.shape[1]), np.arange(H.shape[1])] += size[:, None]
        x = np.linalg.solve(H, g[..., None])
        left = right - (columns @ x[:, None])[..., 0]
        off = np.linalg.norm(left, axis=2)
        typical = np.maximum(np.median(off, axis=1, keepdims=True), scale)
        weight = 1 / (1 + (off / typical) ** 2)
    return np.asarray(losses(left, scale).sum(axis=1))


def couplings(seen: Seen) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Usual couplings: of each joint that counts another its name, "+" or "-" and the other's; the angles.

    A pendant's third joint counts the second one where a linkage drives it, or where its angle is that
    against the floor (FANUC, ABB, Yaskawa); motors of a wrist turn the joints behind it along.
    """
    joints, n = seen.vjm.arm.joints, len(seen.vjm.arm.joints)
    hinge, wrist = [not joint.prismatic for joint in joints], n - 3
    single: list[tuple[tuple[int, int], ...]] = [((2, 1),)] if n > 2 else []
    if n > 4:
        single += [((wrist + 1, wrist),), ((wrist + 2, wrist),), ((wrist + 2, wrist + 1),)]
        single += [((wrist + 1, wrist), (wrist + 2, wrist))]
    for pairs in single:
        if not all(hinge[k] for pair in pairs for k in pair):
            continue
        for signs in product((1, -1), repeat=len(pairs)):
            q, where = seen.q.copy(), list[str]()
            for (j, i), sign in zip(pairs, signs, strict=True):
                q[:, j] += sign * seen.q[:, i]
                where += [joints[j].name, "+" if sign > 0 else "-", joints[i].name]
            yield tuple(where), q
