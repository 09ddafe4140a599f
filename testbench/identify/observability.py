"""Observability by the readings: unobservable directions, and unknowns that cannot be separated.

A null space has no axes of its own. It is searched from small sets of unknowns to large ones: one link or
joint, then neighbours along the chain. Elimination with pivots chosen by size gives a basis of circuits: each
direction has the fewest parameters that can compensate each other, all in units of their expectation.

With a prior, a quantity is undetermined if much of its prior variance remains after the readings. If little
of it would remain once all other unknowns were known, it is confounded: with those unknowns that, once known,
would remove most of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, Ids, Mask
from testbench.identify.posterior import conditional_covariance
from testbench.identify.regression import RANK_TOLERANCE, ZERO_COLUMN

PARTICIPATION_SHARE = 0.15
"""Least change of a parameter, relative to the largest change, that counts as part of a direction [1]."""
ZERO_ENTRY = 1e-7
"""Share of the largest entry below which an entry of a direction counts as zero [1]."""
MIN_NEW_SHARE = 1e-5
"""Share of a direction outside those found before from which it counts as new [1]."""
NEIGHBOURS = (1, 2, 3, 5)
"""Numbers of neighbouring links and joints that are searched together, before all are."""
UNDETERMINED_SHARE = 0.5
"""Share of the prior variance that remains from which a quantity counts as undetermined [1]."""
CONFOUNDED_SHARE = 0.5
"""Share of the remaining variance, once all others or the confounded ones were known, below which a quantity
counts as confounded [1]; otherwise it is unobservable, or confounded with a little of everything."""
MIN_EXPLAINED, MAX_CONFOUNDERS = 0.7, 3
"""Share of the remaining variance that must vanish with the confounded quantities [1], and most of those."""
HELPFUL_SHARE = 0.8
"""Share of the remaining variance after one joint was turned below which turning it helps [1]."""
STRUCTURAL_INFORMATION = 1e8
"""Information that fixes structural directions, in units of the prior."""
NEGLIGIBLE_OUTSIDE = 0.01
"""Share of a quantity's prior variance outside structural directions that counts as zero [1]."""


@dataclass(frozen=True)
class Direction:
    """Describe parameters that compensate each other: they can change together without changing a reading."""

    #: Their indices, the largest change first, relative to their expectation.
    parameters: tuple[int, ...]
    #: Those that change as well, but less than `PARTICIPATION_SHARE` of it, in the same order.
    minor_parameters: tuple[int, ...]


@dataclass(frozen=True)
class ObservedQuantity:
    """Describe a quantity that can be named in reports."""

    name: str  #: Name, such as "joint_3's offset".
    H: Array  #: Jacobian of its k numbers with respect to the unknowns, (k, size).
    #: Whether it belongs to the arm; otherwise arm quantities are only confounded with it.
    belongs_to_arm: bool = True


@dataclass(frozen=True)
class UndeterminedQuantity:
    """Describe a quantity that the readings leave undetermined."""

    name: str  #: Name of the quantity.
    #: Quantities with which it is confounded, most important first; empty if it is unobservable.
    confounded_with: tuple[str, ...] = ()
    share: float = 1.0  #: Share of its prior variance that remains [1].
    correlation: float = 0.0  #: Multiple correlation with these quantities, given the readings [1].
    #: Joint to turn; the number of joints if no single one suffices, -1 if no joint helps; None if
    #: it was not requested.
    joint_to_turn: int | None = None


def null_space(A: Array) -> Array:
    """Compute a basis of the null space, (n, n - rank), of rows whose columns differ in unit, (rows, n).

    Mathematics: `obs-5`.
    """
    n = A.shape[1]
    seen = np.flatnonzero(~zero_columns(A))
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


def directions(A: Array, unit: Array, groups: Sequence[Ids], known_directions: Array) -> Array:
    """Find a sparse basis of the unobservable directions of a matrix, beyond those that are known.

    Args:
        A: Rows, (rows, n).
        unit: Expected size of every parameter, (n,) [m/N, rad/(N m), rad/N].
        groups: Parameters of every link and joint, in the order of the chain.
        known_directions: Unobservable directions that are known already, (m, n).

    Returns:
        Further directions, (k, n).
    """
    R: Array = np.array(np.linalg.qr(A, mode="r"))
    R[:, zero_columns(A)] = 0
    missing = null_space(R).shape[1] - len(known_directions)
    basis = np.zeros((0, A.shape[1]))
    Q = np.linalg.qr(known_directions.T)[0].T  # orthonormal rows: known, then found
    for window in _neighbouring_groups(groups):
        if len(basis) >= missing:
            break
        rows = circuits(null_space(R[:, window]), unit[window])
        T = np.zeros((len(rows), A.shape[1]))
        T[:, window] = rows
        for row in T[np.argsort((np.abs(T) > ZERO_ENTRY).sum(axis=1), kind="stable")]:
            new = row / np.linalg.norm(row)
            for _ in range(2):  # twice is enough
                new = new - (Q @ new) @ Q
            if np.linalg.norm(new) > MIN_NEW_SHARE:
                basis = np.vstack([basis, row])
                Q = np.vstack([Q, new / np.linalg.norm(new)])
    return basis


def zero_columns(A: Array) -> Mask:
    """Tell which columns of rows are zero up to rounding, (n,)."""
    norm = np.linalg.norm(A, axis=0)
    return np.asarray(norm <= ZERO_COLUMN * norm.max(initial=0))


def _neighbouring_groups(groups: Sequence[Ids]) -> Iterator[Ids]:
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


def participants(row: Array) -> Direction:
    """Describe a direction, (n,), by its unknowns, the one that changes most first."""
    size = np.abs(row) / np.abs(row).max()
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] > ZERO_ENTRY]
    return Direction(
        tuple(k for k in order if size[k] >= PARTICIPATION_SHARE),
        tuple(k for k in order if size[k] < PARTICIPATION_SHARE),
    )


def participation(N: Array, within: Array, unit: Array) -> Array:
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


def undetermined_quantities(
    quantities: Sequence[ObservedQuantity],
    L: Array,
    M: Array,
    structural: Array,
    further: Sequence[Array] = (),
) -> tuple[UndeterminedQuantity, ...]:
    """Find the quantities that the readings leave undetermined, the most uncertain first.

    Mathematics: `obs-8`.

    Args:
        quantities: Quantities that may be named.
        L: Root of the prior's covariance L L^T, (size, size).
        M: Information of the readings in units of the prior, L^T A^T A L, (size, size).
        structural: Structural directions, orthonormal, in units of the prior, (size, k); they count as known.
        further: Information that further readings would add: one joint turned after the other, then all of
            them.

    Returns:
        The quantities; of those that compensate each other the most uncertain.
    """
    H = np.vstack([quantity.H for quantity in quantities]) @ L
    ends = np.cumsum([len(quantity.H) for quantity in quantities])
    parts = [np.arange(end - len(quantity.H), end) for end, quantity in zip(ends, quantities, strict=True)]
    # Covariance of all quantities, structural directions held.
    pins = STRUCTURAL_INFORMATION * structural @ structural.T
    K = H @ _covariance(M + pins) @ H.T
    after = [_covariance(M + extra + pins) for extra in further]
    hidden = []
    # Of every quantity of the arm that is left open: what hides it, and which joint helps.
    for k, (quantity, at) in enumerate(zip(quantities, parts, strict=True)):
        unit = _unit_combinations(H[at], structural)
        if not quantity.belongs_to_arm or not len(unit):
            continue
        share = _mean_variance(unit, K[np.ix_(at, at)])
        if share < UNDETERMINED_SHARE:
            continue
        helps = _joint_to_turn(unit @ H[at], after, share)
        confounded = _share_if_all_known(quantity.H, L, M) < CONFOUNDED_SHARE * share
        behind, rest = _confounders(K, parts, k, unit) if confounded else ([], share)
        if rest > CONFOUNDED_SHARE * share:
            hidden.append(UndeterminedQuantity(quantity.name, share=share, joint_to_turn=helps))
            continue
        correlation = float(np.sqrt(max(0.0, 1 - rest / share)))
        names = tuple(quantities[i].name for i in behind)
        hidden.append(UndeterminedQuantity(quantity.name, names, share, correlation, helps))
    return _most_uncertain(hidden)


def _most_uncertain(hidden: Sequence[UndeterminedQuantity]) -> tuple[UndeterminedQuantity, ...]:
    """Keep the most uncertain one of quantities that hide behind each other."""
    kept: dict[frozenset[str], UndeterminedQuantity] = {}
    for quantity in sorted(hidden, key=lambda quantity: (not quantity.confounded_with, -quantity.share)):
        kept.setdefault(frozenset((quantity.name, *quantity.confounded_with)), quantity)
    return tuple(kept.values())


def _covariance(M: Array) -> Array:
    return np.asarray(np.linalg.inv(np.eye(len(M)) + M))


def _unit_combinations(H: Array, structural: Array) -> Array:
    """Combine a quantity's numbers to unit prior variance, outside structural directions."""
    free = H - (H @ structural) @ structural.T
    values, V = np.linalg.eigh(free @ free.T)
    kept = values > NEGLIGIBLE_OUTSIDE * np.square(H).sum() / len(H)
    return np.asarray((V[:, kept] / np.sqrt(values[kept])).T)


def _share_if_all_known(H: Array, L: Array, M: Array) -> float:
    """Compute the share of a quantity's prior variance that remains once all others are known."""
    move = np.linalg.solve(L + np.diag(np.where(np.diag(L) > 0, 0.0, 1.0)), H.T)
    left, before = np.linalg.inv(move.T @ move + move.T @ M @ move), (H @ L) @ (H @ L).T
    return float(np.trace(np.linalg.solve(before, left)) / len(H))


def _confounders(K: Array, parts: Sequence[Ids], k: int, unit: Array) -> tuple[list[int], float]:
    """Find the quantities that, once known, remove most of quantity k, and the share that remains."""
    confounders: list[int] = []
    share = first = _mean_variance(unit, K[np.ix_(parts[k], parts[k])])
    while len(confounders) < MAX_CONFOUNDERS and share > (1 - MIN_EXPLAINED) * first:
        others = [i for i in range(len(parts)) if i != k and i not in confounders]
        known = [np.concatenate([parts[j] for j in (*confounders, i)]) for i in others]
        rest = [_mean_variance(unit, conditional_covariance(K, parts[k], at)) for at in known]
        best = int(np.argmin(rest))
        confounders, share = [*confounders, others[best]], rest[best]
    return confounders, share


def _joint_to_turn(H: Array, after: Sequence[Array], share: float) -> int | None:
    """Find the joint to turn, for numbers of unit prior variance, (k, size)."""
    if not after:
        return None
    *shares, everywhere = (float((H @ S * H).sum() / len(H)) for S in after)
    best = int(np.argmin(shares))
    if shares[best] < HELPFUL_SHARE * share:
        return best
    return len(shares) if everywhere < HELPFUL_SHARE * share else -1


def _mean_variance(unit: Array, K: Array) -> float:
    """Average the variance of combinations, (k, n), of numbers with a covariance, (n, n)."""
    return float(np.trace(unit @ K @ unit.T) / len(unit))
