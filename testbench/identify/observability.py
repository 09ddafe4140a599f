"""What readings tell of unknowns and what they do not: unseen directions, and which unknowns hide in which.

A null space has no axes of its own. It is searched from the small to the large: one link or joint, then
neighbours along the chain. Elimination with pivots chosen by size gives each find a basis of circuits: a
direction takes the fewest parameters that can trade against each other, all in units of what is expected.

With a prior, a quantity is open where the readings leave much of its prior variance. If little of that were
left, were all else known, it hides: behind what, once known, would take most of the rest away.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, Ids, Mask
from testbench.identify.posterior import conditional
from testbench.identify.regression import RANK_TOLERANCE, ROUNDING

SHARE = 0.15
"""A parameter takes part in a direction if it changes by this share of the one that changes most."""
ZERO = 1e-7  #: Below this share of the largest an entry of a direction is the rounding of a zero.
NEW = 1e-5  #: A direction is new if this share of it lies outside those found before.
NEIGHBOURS = (1, 2, 3, 5)  #: Links and joints along the chain that are searched together, before all are.
OPEN = 0.5  #: Share of the prior variance left from which on a quantity is open [1].
HIDES = 0.5
"""Share of what is left, were all else known and were what it hides behind, below which a quantity hides:
else it is unseen, or behind a little of everything."""
ENOUGH, MOST = 0.7, 3
"""Share of what is left that has to go with what it hides behind, and how many those may be."""
HELPS = 0.8  #: Share of what is left after a joint was turned below which turning it helps.
PINNED = 1e8  #: Information that holds structural directions, in units of the prior.
FLAT = 0.01  #: Share of a quantity's prior variance outside structural directions that does not count.


@dataclass(frozen=True)
class Direction:
    """Parameters that trade against each other: together they may change, and no reading does."""

    #: Their indices, the one that changes most first, relative to what is expected.
    parameters: tuple[int, ...]
    others: tuple[int, ...]  #: Those that change as well, but less than `SHARE` of it, in the same order.


@dataclass(frozen=True)
class Quantity:
    """Something that has a name."""

    name: str  #: Such as "joint_3's offset".
    H: Array  #: Its numbers per unit of every unknown, (k, size).
    own: bool = True  #: Whether it is the arm's; else it is only what others may hide behind.


@dataclass(frozen=True)
class Hidden:
    """A quantity that readings leave open."""

    name: str  #: Of the quantity.
    behind: tuple[str, ...] = ()  #: What it hides behind, the most important first; nothing where unseen.
    share: float = 1.0  #: Of its prior variance left [1].
    correlation: float = 0.0  #: With what it hides behind, after the readings, multiple [1].
    #: Which joint to turn; their number where several have to, -1 where hardly anything helps; None where
    #: nobody asked.
    helps: int | None = None


def null_space(A: Array) -> Array:
    """Basis of what rows, (rows, n), with columns of unlike units do not see, (n, n - rank).

    Mathematics: `obs-5`.
    """
    n = A.shape[1]
    seen = np.flatnonzero(~idle(A))
    norm = np.linalg.norm(A, axis=0)
    if not len(seen):
        return np.eye(n)
    triangular: Array = np.asarray(np.linalg.qr(A[:, seen] / norm[seen], mode="r"))
    _, s, Vt = np.linalg.svd(triangular)
    rank = int((s > RANK_TOLERANCE * s[0]).sum())
    N = np.zeros((n, n - rank))
    N[seen, : len(seen) - rank] = Vt[rank:].T / norm[seen, None]
    N[np.setdiff1d(np.arange(n), seen), np.arange(len(seen) - rank, n - rank)] = 1
    return N


def directions(A: Array, unit: Array, groups: Sequence[Ids], known: Array) -> Array:
    """Find a sparse basis of the unobservable directions of a matrix, beyond those that are known.

    Args:
        A: Rows, (rows, n).
        unit: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].
        groups: Parameters of every link and joint, in the order of the chain.
        known: Unobservable directions that are known already, (m, n).

    Returns:
        Further directions, (k, n).
    """
    R: Array = np.array(np.linalg.qr(A, mode="r"))
    R[:, idle(A)] = 0
    missing = null_space(R).shape[1] - len(known)
    found = np.zeros((0, A.shape[1]))
    Q = np.linalg.qr(known.T)[0].T  # orthonormal rows: known, then found
    for window in _windows(groups):
        if len(found) >= missing:
            break
        rows = circuits(null_space(R[:, window]), unit[window])
        T = np.zeros((len(rows), A.shape[1]))
        T[:, window] = rows
        for row in T[np.argsort((np.abs(T) > ZERO).sum(axis=1), kind="stable")]:
            new = row / np.linalg.norm(row)
            for _ in range(2):  # twice is enough
                new = new - (Q @ new) @ Q
            if np.linalg.norm(new) > NEW:
                found = np.vstack([found, row])
                Q = np.vstack([Q, new / np.linalg.norm(new)])
    return found


def idle(A: Array) -> Mask:
    """Columns that are zero, up to rounding, (n,)."""
    norm = np.linalg.norm(A, axis=0)
    return np.asarray(norm <= ROUNDING * norm.max(initial=0))


def _windows(groups: Sequence[Ids]) -> Iterator[Ids]:
    for length in NEIGHBOURS:
        for first in range(len(groups) - length + 1):
            yield np.concatenate(groups[first : first + length])
    yield np.concatenate(groups)


def circuits(N: Array, unit: Array) -> Array:
    """Compute the reduced echelon form of a null space, with pivots selected by size.

    Args:
        N: Basis of the null space, (n, k).
        unit: Expected size of every parameter, (n,).

    Returns:
        Directions relative to `unit`, (k, n) [1].
    """
    T = (N / unit[:, None]).T
    T = T / np.linalg.norm(T, axis=1, keepdims=True)
    pivots: list[int] = []
    for i in range(len(T)):
        size = np.abs(T[i:])
        size[:, pivots] = 0
        row, column = divmod(int(size.argmax()), T.shape[1])
        T[[i, i + row]] = T[[i + row, i]]
        T[i] /= T[i, column]
        others = np.arange(len(T)) != i
        T[others] -= np.outer(T[others, column], T[i])
        pivots.append(column)
    return np.asarray(T)


def direction(row: Array) -> Direction:
    """Who takes part in a direction, (n,)."""
    size = np.abs(row) / np.abs(row).max()
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] > ZERO]
    return Direction(tuple(k for k in order if size[k] >= SHARE), tuple(k for k in order if size[k] < SHARE))


def whereabouts(N: Array, within: Array, unit: Array) -> Array:
    """Compute how many directions of N beyond those of `within` each parameter holds.

    Args:
        N: Unobservable directions, (n, k + m).
        within: Some of them, (n, m).
        unit: Expected size of every parameter, (n,).

    Returns:
        Share of every parameter, summing to k, (n,) [1].
    """
    scaled = (within / unit[:, None], N / unit[:, None])
    inner, outer = (np.linalg.qr(M / np.linalg.norm(M, axis=0))[0] for M in scaled)
    values, V = np.linalg.eigh(np.eye(outer.shape[1]) - outer.T @ inner @ (inner.T @ outer))
    more = outer @ V[:, len(values) - (N.shape[1] - within.shape[1]) :]
    return np.asarray((more**2).sum(axis=1))


def hidden(
    quantities: Sequence[Quantity], L: Array, M: Array, never: Array, further: Sequence[Array] = ()
) -> tuple[Hidden, ...]:
    """Quantities that readings leave open, those that hide first, the most open before others.

    Mathematics: `obs-8`.

    Args:
        quantities: All that may be named.
        L: Unknowns per unit of their prior, L L^T its covariance, (size, size).
        M: Information of the readings in these units, L^T T^T T L of the root T of their equations.
        never: Structural directions, orthonormal, in these units, (size, k): they count as known.
        further: Information that turning one joint after the other would add, and turning all of them.

    Returns:
        Each once: of those that hide behind each other the most open.
    """
    H, names = np.vstack([one.H for one in quantities]) @ L, [one.name for one in quantities]
    ends = np.cumsum([len(one.H) for one in quantities])
    parts = [np.arange(end - len(one.H), end) for end, one in zip(ends, quantities, strict=True)]
    pins = PINNED * never @ never.T
    K = H @ _covariance(M + pins) @ H.T
    after = [_covariance(M + extra + pins) for extra in further]
    found = []
    for k, (one, at) in enumerate(zip(quantities, parts, strict=True)):
        unit = _unit(H[at], never)
        if not one.own or not len(unit) or (share := _mean(unit, K[np.ix_(at, at)])) < OPEN:
            continue
        helps, hides = _helps(unit @ H[at], after, share), _alone(one.H, L, M) < HIDES * share
        behind, rest = _behind(K, parts, k, unit) if hides else ([], share)
        if rest > HIDES * share:
            found.append(Hidden(one.name, share=share, helps=helps))
        else:
            correlation = float(np.sqrt(max(0.0, 1 - rest / share)))
            found.append(Hidden(one.name, tuple(names[i] for i in behind), share, correlation, helps))
    kept: dict[object, Hidden] = {}
    for left in sorted(found, key=lambda left: (not left.behind, -left.share)):
        kept.setdefault(frozenset((left.name, *left.behind)) if left.behind else left.name, left)
    return tuple(kept.values())


def _covariance(M: Array) -> Array:
    return np.asarray(np.linalg.inv(np.eye(len(M)) + M))


def _unit(H: Array, never: Array) -> Array:
    """Combinations of a quantity's numbers of unit prior variance beside structural directions."""
    free = H - (H @ never) @ never.T
    values, V = np.linalg.eigh(free @ free.T)
    own = values > FLAT * np.square(H).sum() / len(H)
    return np.asarray((V[:, own] / np.sqrt(values[own])).T)


def _alone(H: Array, L: Array, M: Array) -> float:
    """Share of a quantity's prior variance left, were all else known."""
    move = np.linalg.solve(L + np.diag(np.where(np.diag(L) > 0, 0.0, 1.0)), H.T)
    left, before = np.linalg.inv(move.T @ move + move.T @ M @ move), (H @ L) @ (H @ L).T
    return float(np.trace(np.linalg.solve(before, left)) / len(H))


def _behind(K: Array, parts: Sequence[Ids], k: int, unit: Array) -> tuple[list[int], float]:
    """What takes most away of quantity k, once known, and the share left then."""
    found: list[int] = []
    share = first = _mean(unit, K[np.ix_(parts[k], parts[k])])
    while len(found) < MOST and share > (1 - ENOUGH) * first:
        others = [i for i in range(len(parts)) if i != k and i not in found]
        known = [np.concatenate([parts[j] for j in (*found, i)]) for i in others]
        rest = [_mean(unit, conditional(K, parts[k], at)) for at in known]
        best = int(np.argmin(rest))
        found, share = [*found, others[best]], rest[best]
    return found, share


def _helps(H: Array, after: Sequence[Array], share: float) -> int | None:
    """Which joint to turn, by numbers of unit prior variance (k, size)."""
    if not after:
        return None
    *each, everywhere = (float((H @ S * H).sum() / len(H)) for S in after)
    best = int(np.argmin(each))
    if each[best] < HELPS * share:
        return best
    return len(each) if everywhere < HELPS * share else -1


def _mean(unit: Array, K: Array) -> float:
    """Mean variance of combinations (k, n) of numbers of a covariance (n, n)."""
    return float(np.trace(unit @ K @ unit.T) / len(unit))
