"""What makes a plan good: information functions of the information matrix M, each with its certificate.

Every criterion Phi is concave in M and positively homogeneous (Pukelsheim 1993, ch. 5), so that its
efficiency Phi(plan) / Phi(best) is a share. `after(M, rows)` is Phi with one more candidate, for every
candidate, by updates of rank k; 0 where it was not worth computing. `tangent(M)` is a plane above Phi: what
the equivalence theorem needs to bound all plans at once. M is (r, r), rows (candidates, k, r).

D: det(M)^(1/r). A: 1 / tr(M^-1). E: least eigenvalue. I and the test-pose criterion (Klimchik et al.,
Robotics and CIM 2014; Wu et al. 2015): 1 / tr(W M^-1), W the mean of the prediction rows' squares. G: 1 /
largest prediction variance. Formulas: Fedorov (1972), Pukelsheim (1993); for calibration poses Sun and
Hollerbach (ICRA 2008).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.design.rows import Problem, times
from testbench.errors import Array, BenchError

CRITERIA = ("D", "A", "E", "G", "I", "test")  #: All, by name; absolute readings have no tasks to test.
POWER = 24  #: Sharpness of the smooth stand-in for a largest value, G and E.
SHORTLIST = 32  #: Candidates for which G and E are computed exactly; the stand-in ranks the others.


@dataclass(frozen=True)
class Tangent:
    """A plane above Phi, taken at some M."""

    Z: Array  #: Phi(M') <= <Z, M'> for every M', symmetric, (r, r).
    #: What the relaxation climbs: Phi(M), or a stand-in with a gradient everywhere.
    height: float
    #: Curvature of log det (1) or of a weighted mean of M^-1 (2) over <Z, S M^-1 S>; 0 for a stand-in.
    bend: float = 0.0


@dataclass(frozen=True)
class Determinant:
    """D: det(M)^(1/r), the volume of the confidence ellipsoid."""

    def information(self, M: Array) -> float:
        """det(M)^(1/r)."""
        sign, size = np.linalg.slogdet(M)
        return float(np.exp(size / len(M))) if sign > 0 else 0.0

    def after(self, M: Array, rows: Array) -> Array:
        """By det(M + F^T F) = det(M) det(1 + F M^-1 F^T)."""
        seen = times(rows, np.asarray(np.linalg.inv(M))) @ rows.swapaxes(1, 2)
        growth = np.linalg.slogdet(np.eye(rows.shape[1]) + seen)[1]
        return np.asarray(self.information(M) * np.exp(growth / len(M)))

    def tangent(self, M: Array) -> Tangent:
        """Phi(M) M^-1 / r: the arithmetic mean of eigenvalues is no less than the geometric."""
        value = self.information(M)
        return Tangent(value * np.linalg.inv(M) / len(M), value, bend=1.0)


@dataclass(frozen=True)
class Linear:
    """1 / tr(W M^-1): A with W = 1, I with the workspace's W, the test-pose criterion with the tasks'."""

    W: Array  #: Symmetric, positive semi-definite, (r, r).

    def information(self, M: Array) -> float:
        """1 / tr(W M^-1)."""
        return float(1 / np.trace(np.linalg.solve(M, self.W)))

    def after(self, M: Array, rows: Array) -> Array:
        """By Woodbury's formula."""
        return np.asarray(1 / (1 / self.information(M) - _gain(M, rows, self.W)))

    def tangent(self, M: Array) -> Tangent:
        """M^-1 W M^-1 / tr(W M^-1)^2: that of a concave function that is homogeneous."""
        return _tangent(M, self.W)


@dataclass(frozen=True)
class Largest:
    """G and E: 1 / the largest of several costs, each a `Linear` one.

    The stand-in is their power mean. It weights every cost by its size to the power `POWER` - 1; a weighted
    mean is no larger than the maximum, so that the tangent of the weighted criterion bounds this one too.
    """

    costs: Callable[[Array], Array]  #: At any M, (..., r, r) to (..., k).
    #: W of their weighted mean at M, from weights whose sum is one, (k,) to (r, r).
    mix: Callable[[Array, Array], Array]

    def information(self, M: Array) -> float:
        """1 / largest cost."""
        return float(1 / self.costs(M).max())

    def after(self, M: Array, rows: Array) -> Array:
        """Exact for the candidates that the stand-in ranks first."""
        found = np.zeros(len(rows))
        first = np.arange(len(rows))
        if len(rows) > SHORTLIST:
            gain = _gain(M, rows, self._weighted(M, self.costs(M)))
            first = np.argpartition(-gain, SHORTLIST)[:SHORTLIST]
        few = rows[first]
        found[first] = 1 / self.costs(M + few.swapaxes(1, 2) @ few).max(axis=-1)
        return found

    def tangent(self, M: Array) -> Tangent:
        """That of the weighted mean, and 1 / power mean of the costs."""
        costs = self.costs(M)
        most = costs.max()
        height = 1 / (most * np.mean((costs / most) ** POWER) ** (1 / POWER))
        return Tangent(_tangent(M, self._weighted(M, costs)).Z, float(height))

    def _weighted(self, M: Array, costs: Array) -> Array:
        share = (costs / costs.max()) ** (POWER - 1)
        return self.mix(M, share / share.sum())


Criterion = Determinant | Linear | Largest  #: An information function.


def check_criterion(name: str, *, absolute: bool = False) -> None:
    """Refuse what is not in `CRITERIA`; of absolute readings also "test"."""
    known = CRITERIA[: len(CRITERIA) - absolute]
    if name not in known:
        what = " of absolute readings" if absolute else ""
        raise BenchError(f"no criterion {name!r}{what}; criteria are {', '.join(known)}")


def criterion_of(name: str, problem: Problem, workspace: Array, tasks: Array | None = None) -> Criterion:
    """A criterion by its name in `CRITERIA`.

    Of predictions per unit of x, (poses, 3 m, n) [m]: I and G over the workspace, "test" at the tasks.
    """
    if name == "D":
        return Determinant()
    if name == "A":
        return Linear(np.eye(problem.r) / problem.r)
    if name == "E":
        return criterion_e()
    wanted = (workspace if tasks is None or name != "test" else tasks) @ problem.lift
    return criterion_g(wanted) if name == "G" else Linear(mean_square(wanted))


def criterion_e() -> Largest:
    """E-optimality: least eigenvalue of M; the costs are the eigenvalues of M^-1."""

    def costs(M: Array) -> Array:
        return np.asarray(1 / np.linalg.eigvalsh(M))

    def mix(M: Array, share: Array) -> Array:
        V = np.linalg.eigh(M)[1]
        return np.asarray((V * share) @ V.T)

    return Largest(costs, mix)


def criterion_g(rows: Array) -> Largest:
    """G-optimality: worst mean square error of a pose, of predictions per unit of a, (poses, k, r) [m]."""
    every = squares(rows / math.sqrt(_points(rows)))

    def costs(M: Array) -> Array:
        I = np.linalg.inv(M)  # noqa: E741 - as in the books
        return np.asarray(I.reshape(*I.shape[:-2], -1) @ every.T)

    return Largest(costs, lambda M, share: (share @ every).reshape(M.shape))


def mean_square(rows: Array) -> Array:
    """W of predictions (poses, 3 m, r) [m]: tr(W M^-1) is a target's mean square distance [m^2]."""
    A = rows.reshape(-1, rows.shape[-1])
    return np.asarray(A.T @ A / (len(rows) * _points(rows)))


def _points(rows: Array) -> float:
    """Targets a pose."""
    return float(rows.shape[1] / 3)


def squares(rows: Array) -> Array:
    """F^T F of every F, (count, k, r), flat, (count, r^2)."""
    return np.asarray((rows.swapaxes(1, 2) @ rows).reshape(len(rows), -1))


def _gain(M: Array, rows: Array, W: Array) -> Array:
    """What each candidate (candidates, k, r) takes from tr(W M^-1), tr((1 + F I F^T)^-1 F I W I F^T).

    By elimination row by row for all candidates together: LAPACK, one by one, takes three times as long.
    """
    r, I = len(M), np.linalg.inv(M)  # noqa: E741
    P, columns = times(rows, np.hstack([I, I @ W @ I])), rows.swapaxes(1, 2)
    K = np.eye(rows.shape[1])[:, :, None] + (P[:, :, :r] @ columns).transpose(1, 2, 0)
    N = np.ascontiguousarray((P[:, :, r:] @ columns).transpose(1, 2, 0))
    found = N[0, 0] / K[0, 0]
    while len(K) > 1:
        factor = K[1:, 0] / K[0, 0]
        mixed = factor[:, None] * (N[1:, 0] - factor * (N[0, 0] / 2))
        K, N = K[1:, 1:] - factor[:, None] * K[0, 1:], N[1:, 1:] - mixed - mixed.swapaxes(0, 1)
        found = found + N[0, 0] / K[0, 0]
    return np.asarray(found)


def _tangent(M: Array, W: Array) -> Tangent:
    I = np.linalg.inv(M)  # noqa: E741 - used thrice
    value = float(1 / (I * W).sum())
    return Tangent(value**2 * (I @ W @ I), value, bend=2.0)
