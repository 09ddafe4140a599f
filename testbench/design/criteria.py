"""What makes a plan good: information functions of the information matrix M, each with its certificate.

Every criterion Phi is concave in M and positively homogeneous (Pukelsheim 1993, ch. 5), so that its
efficiency Phi(plan) / Phi(best) is a share. `dual(M)` is a matrix Z with Phi(M') <= <Z, M'> for every M':
what the equivalence theorem needs to bound all plans at once. `after(M, rows)` is Phi with one more
candidate, for every candidate, by updates of rank k; 0 where it was not worth computing. `smooth(M)` is what
the relaxation climbs: Phi, or a stand-in with a gradient everywhere. M is (r, r), rows (candidates, k, r).

D: det(M)^(1/r). A: 1 / tr(M^-1). E: least eigenvalue. I and the test-pose criterion (Klimchik et al.,
Robotics and CIM 2014; Wu et al. 2015): 1 / tr(W M^-1), W the mean of the prediction rows' squares. G: 1 /
largest prediction variance. Formulas: Fedorov (1972), Pukelsheim (1993); for calibration poses Sun and
Hollerbach (ICRA 2008).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array

POWER = 24  #: Sharpness of the smooth stand-in for a largest value, G and E.
SHORTLIST = 32  #: Candidates for which G and E are computed exactly; the stand-in ranks the others.


@dataclass(frozen=True)
class Determinant:
    """D: det(M)^(1/r), the volume of the confidence ellipsoid."""

    name: str = "D"

    def information(self, M: Array) -> float:
        """det(M)^(1/r)."""
        sign, size = np.linalg.slogdet(M)
        return float(np.exp(size / len(M))) if sign > 0 else 0.0

    smooth = information

    def after(self, M: Array, rows: Array) -> Array:
        """By det(M + F^T F) = det(M) det(1 + F M^-1 F^T)."""
        K = _leverage(rows @ np.linalg.inv(M), rows)
        return np.asarray(self.information(M) * np.exp(np.linalg.slogdet(K)[1] / len(M)))

    def dual(self, M: Array) -> Array:
        """Phi(M) M^-1 / r: the arithmetic mean of eigenvalues is no less than the geometric."""
        return np.asarray(self.information(M) * np.linalg.inv(M) / len(M))


@dataclass(frozen=True)
class Linear:
    """1 / tr(W M^-1): A with W = 1, I with the workspace's W, the test-pose criterion with the tasks'."""

    name: str  #: For reports.
    W: Array  #: Symmetric, positive semi-definite, (r, r).

    def information(self, M: Array) -> float:
        """1 / tr(W M^-1)."""
        return float(1 / np.trace(np.linalg.solve(M, self.W)))

    smooth = information

    def after(self, M: Array, rows: Array) -> Array:
        """By Woodbury's formula."""
        return np.asarray(1 / _cost_after(M, rows, self.W))

    def dual(self, M: Array) -> Array:
        """M^-1 W M^-1 / tr(W M^-1)^2: a tangent of a concave function that is homogeneous."""
        return _tangent(M, self.W)


@dataclass(frozen=True)
class Largest:
    """G and E: 1 / the largest of several costs, each a `Linear` one.

    The stand-in is their power mean. It weights every cost by its size to the power `POWER` - 1; a weighted
    mean is no larger than the maximum, so that the tangent of the weighted criterion bounds this one too.
    """

    name: str  #: For reports.
    costs: Callable[[Array], Array]  #: At M, (k,).
    #: W of their weighted mean at M, from weights whose sum is one, (k,) to (r, r).
    mix: Callable[[Array, Array], Array]

    def information(self, M: Array) -> float:
        """1 / largest cost."""
        return float(1 / self.costs(M).max())

    def smooth(self, M: Array) -> float:
        """1 / power mean of the costs."""
        costs = self.costs(M)
        most = costs.max()
        return float(1 / (most * np.mean((costs / most) ** POWER) ** (1 / POWER)))

    def after(self, M: Array, rows: Array) -> Array:
        """Exact for the candidates that the stand-in ranks first."""
        found = np.zeros(len(rows))
        first = np.arange(len(rows))
        if len(rows) > SHORTLIST:
            cost = _cost_after(M, rows, self._weights(M))
            first = np.argpartition(cost, SHORTLIST)[:SHORTLIST]
        found[first] = [self.information(M + F.T @ F) for F in rows[first]]
        return found

    def dual(self, M: Array) -> Array:
        """That of the weighted mean."""
        return _tangent(M, self._weights(M))

    def _weights(self, M: Array) -> Array:
        costs = self.costs(M)
        share = (costs / costs.max()) ** (POWER - 1)
        return self.mix(M, share / share.sum())


Criterion = Determinant | Linear | Largest  #: An information function, by name.


def criterion_e() -> Largest:
    """E-optimality: least eigenvalue of M; the costs are the eigenvalues of M^-1."""

    def costs(M: Array) -> Array:
        return np.asarray(1 / np.linalg.eigvalsh(M))

    def mix(M: Array, share: Array) -> Array:
        V = np.linalg.eigh(M)[1]
        return np.asarray((V * share) @ V.T)

    return Largest("E", costs, mix)


def criterion_g(rows: Array) -> Largest:
    """G-optimality: worst mean square error of a pose, of predictions per unit of a, (poses, k, r) [m]."""

    def costs(M: Array) -> Array:
        half = rows @ np.linalg.inv(np.linalg.cholesky(M)).T
        return np.asarray((half**2).sum(axis=(1, 2)) / _points(rows))

    def mix(_: Array, share: Array) -> Array:
        A = (np.sqrt(share / _points(rows))[:, None, None] * rows).reshape(-1, rows.shape[2])
        return np.asarray(A.T @ A)

    return Largest("G", costs, mix)


def mean_square(rows: Array) -> Array:
    """W of predictions (poses, 3 m, r) [m]: tr(W M^-1) is a target's mean square distance [m^2]."""
    A = rows.reshape(-1, rows.shape[-1])
    return np.asarray(A.T @ A / (len(rows) * _points(rows)))


def _points(rows: Array) -> float:
    """Targets a pose."""
    return float(rows.shape[1] / 3)


def _leverage(P: Array, rows: Array) -> Array:
    """1 + F M^-1 F^T of every candidate, (candidates, k, k)."""
    return np.asarray(np.eye(rows.shape[1]) + P @ rows.swapaxes(1, 2))


def _cost_after(M: Array, rows: Array, W: Array) -> Array:
    """tr(W (M + F^T F)^-1) for each F, (candidates,)."""
    I = np.linalg.inv(M)  # noqa: E741 - of rank k updates, as in the books
    P = rows @ I
    gain = np.linalg.solve(_leverage(P, rows), (P @ W) @ P.swapaxes(1, 2))
    return np.asarray(np.trace(I @ W) - np.trace(gain, axis1=1, axis2=2))


def _tangent(M: Array, W: Array) -> Array:
    half = np.linalg.solve(M, W)
    return np.asarray(np.linalg.solve(M, half.T) / np.trace(half) ** 2)
