"""Information functions after one more candidate, for every candidate at once, by updates of rank k.

With I = M^-1, a candidate F needs of M its leverage F I F^T and its worth F I W I F^T (Woodbury). When a pose
G joins M or leaves it, both change by products with a few columns: with I of the smaller matrix,
U = I G^T (1 + G I G^T)^-1/2 and T = I W U - U U^T W U / 2, the smaller one's inverse is larger by U U^T and
its I W I by U T^T + T U^T. Sums of both signs lose no digits unless M is all but singular.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.rows import Ids
from testbench.errors import Array


@dataclass(frozen=True)
class Seen:
    """A matrix M as candidates see it."""

    leverage: Array  #: F M^-1 F^T, (candidates, k, k).
    worth: Array  #: F M^-1 W M^-1 F^T; without W the leverage again, (candidates, k, k).

    def __sub__(self, other: "Seen") -> "Seen":
        return Seen(self.leverage - other.leverage, self.worth - other.worth)

    def __add__(self, other: "Seen") -> "Seen":
        return Seen(self.leverage + other.leverage, self.worth + other.worth)

    def of(self, some: Ids) -> "Seen":
        """What some of the candidates see."""
        return Seen(self.leverage[some], self.worth[some])

    def gain(self) -> Array:
        """What each candidate takes from tr(W M^-1), tr((1 + leverage)^-1 worth), (candidates,).

        By elimination row by row for all candidates together: LAPACK, one by one, takes three times as long.
        """
        K = np.eye(self.leverage.shape[1])[:, :, None] + self.leverage.transpose(1, 2, 0)
        N = np.ascontiguousarray(self.worth.transpose(1, 2, 0))
        found = N[0, 0] / K[0, 0]
        while len(K) > 1:
            factor = K[1:, 0] / K[0, 0]
            mixed = factor[:, None] * (N[1:, 0] - factor * (N[0, 0] / 2))
            K, N = K[1:, 1:] - factor[:, None] * K[0, 1:], N[1:, 1:] - mixed - mixed.swapaxes(0, 1)
            found = found + N[0, 0] / K[0, 0]
        return np.asarray(found)

    def growth(self) -> Array:
        """Logarithm of what each candidate multiplies det M by, (candidates,)."""
        return np.asarray(np.linalg.slogdet(np.eye(self.leverage.shape[1]) + self.leverage)[1])


def look(M: Array, rows: Array, W: Array | None) -> Seen:
    """M as candidates (candidates, k, r) see it, W symmetric or None."""
    r, I = len(M), np.linalg.inv(M)  # noqa: E741 - as in the books
    P = rows.reshape(-1, r) @ (I if W is None else np.hstack([I, I @ W @ I]))
    P, columns = P.reshape(*rows.shape[:2], -1), rows.swapaxes(1, 2)
    leverage = P[:, :, :r] @ columns
    return Seen(leverage, leverage if W is None else P[:, :, r:] @ columns)


def apart(smaller: Array, pose: Array, rows: Array, W: Array | None) -> Seen:
    """What candidates see of a matrix beyond the one with a pose (k, r) more; rows and W as in `look`."""
    I = np.linalg.inv(smaller)  # noqa: E741
    value, V = np.linalg.eigh(pose @ I @ pose.T)
    U = I @ pose.T @ (V / np.sqrt(1 + np.maximum(value, 0.0)))
    k = U.shape[1]
    T = np.empty((len(I), 0)) if W is None else I @ (W @ U) - U @ (U.T @ W @ U) / 2
    P = (rows.reshape(-1, len(I)) @ np.hstack([U, T])).reshape(*rows.shape[:2], -1)
    columns = P.swapaxes(1, 2)
    leverage = P[:, :, :k] @ columns[:, :k]
    if W is None:
        return Seen(leverage, leverage)
    cross = P[:, :, :k] @ columns[:, k:]
    return Seen(leverage, cross + cross.swapaxes(1, 2))
