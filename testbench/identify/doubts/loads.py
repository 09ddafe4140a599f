"""Which single mistake in the loads, or between the two readings, would make the deflections fit the prior.

The model is linear with a prior that learns from the readings (`hierarchy`): y ~ N(A s e, S). A mistake b,
such as a constant force that nobody recorded, adds D b to what is expected, D by differences of the residual
under changed data, b ~ N(0, tau^2): how much likelier it makes the readings is a Bayes factor in closed form
(Kass and Raftery 1995).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.evidence import greatest, posterior
from testbench.identify.fold import reduce
from testbench.identify.hierarchy import evidence
from testbench.identify.metric import Metric
from testbench.identify.weighed import Readings, marker_points, one_by_one, white
from testbench.model.vjm import Vjm, chain, generalised_load, translation_rows

Change = Callable[[Dataset, Array], Dataset]
"""A dataset with a mistake of a size mended, (k,), of units of tau."""
PLAY, STIFFER = 6e-5, 200.0
"""Half width of a joint's play or friction [rad, m], and the share by which it turns less, a radian [1/rad].

Typical sizes, as of `plant.TYPICAL`, and a little more."""
EVERY = slice(None)
STEP = 1e-3  #: Of a mistake, for derivatives: mistakes enter almost linearly [tau].


@dataclass(frozen=True)
class Fitted:
    """The learnt model of a dataset, reading by reading."""

    vjm: Vjm
    metric: Metric
    data: Dataset
    read: Readings  #: Its readings one by one.
    loss: float  #: Minus the logarithm of its evidence.
    pi: Array  #: Expected parameters after the readings, (n,).
    #: The inverse of the readings' covariance is I / misfit^2 - shared shared^T, (k, r): readings share few
    #: unknowns, so that nothing is as large as the readings squared.
    shared: Array
    surprise: Array  #: That inverse times readings minus what is expected before them, (k,) [1].
    h: Array  #: Hyperparameters.

    @property
    def misfit(self) -> float:
        """How much more than their noise the readings scatter [1]."""
        return float(np.exp(self.h[-1]))


def learnt(vjm: Vjm, metric: Metric, data: Dataset) -> Fitted:
    """Learn the prior from a dataset; its readings against it."""
    structure = metric.structure
    seen = evidence(reduce(vjm, structure, data), metric)
    h = greatest(seen.problem, seen.start)
    read = one_by_one(vjm, structure, data)
    G = read.A.reshape(-1, structure.n) @ seen.metric.L
    s, kappa = np.exp(h[: seen.blocks])[seen.block], np.exp(h[-1])
    width = s * np.exp(np.where(seen.metric.couplings, h[-2], h[-3]))
    residual = read.y.ravel() - G @ (s * seen.metric.expected)
    half = G * width
    expected = np.concatenate([residual, np.zeros(len(width))])
    x = np.linalg.lstsq(np.vstack([half, kappa * np.eye(len(width))]), expected)[0]
    pi = seen.metric.L @ (s * seen.metric.expected + width * x)
    if vjm.arm.joints:
        half = np.hstack([half, allowed(vjm, data, structure.matrix(pi))])
    U, size, _ = np.linalg.svd(half, full_matrices=False)
    shared = U * (size / np.hypot(size, kappa) / kappa)
    surprise = residual / kappa**2 - shared @ (shared.T @ residual)
    return Fitted(vjm, seen.metric, data, read, posterior(seen.problem, h).loss, pi, shared, surprise, h)


def allowed(vjm: Vjm, data: Dataset, C: Array) -> Array:
    """What joints of sound arms do beyond springs, (rows, 2 n) [standard deviations]: play, and stiffening.

    Args:
        vjm: The model.
        data: The runs.
        C: Compliance about which, (n_theta, n_theta).
    """
    where, first = chain(vjm, data.q), 6 * len(vjm.arm.links)
    own = np.diag(C)[first:, None] * generalised_load(where, data.wrench, data.point)[first:]
    moved = translation_rows(where, marker_points(vjm, data.markers))[:, first:]
    moved = moved.reshape(-1, 3, *moved.shape[1:])  # marker, axis, joint, run
    columns = []
    for k, turn in enumerate(own):
        for size in (PLAY * np.sign(turn), STIFFER * turn * np.abs(turn)):
            turned = (where.J_theta[3:, first + k] * size).T
            columns.append(white(data, (moved[:, :, k] * size).transpose(2, 0, 1), turned))
    return np.array(columns).reshape(len(columns), -1).T


def rows(fitted: Fitted, data: Dataset) -> Array:
    """Readings minus predictions of a changed dataset, (k,)."""
    read = one_by_one(fitted.vjm, fitted.metric.structure, data)
    return np.asarray((read.y - read.A @ fitted.pi).ravel())


@dataclass(frozen=True)
class Size:
    """How large a mistake looks, and how much likelier it makes the readings."""

    b: Array  #: Expected size, (k,) [tau].
    gain: float  #: Logarithm of the Bayes factor [nats].


def sized(fitted: Fitted, change: Change, k: int) -> Size:
    """A mistake of k numbers."""
    start = rows(fitted, fitted.data)
    D = np.column_stack([(start - rows(fitted, change(fitted.data, STEP * e))) / STEP for e in np.eye(k)])
    return of_columns(fitted, D)


def of_columns(fitted: Fitted, D: Array, rows: slice = EVERY) -> Size:
    """A mistake that adds D, (rows, k) [standard deviations a tau], to what is expected of some rows."""
    own, v = fitted.shared[rows].T @ D, D.T @ fitted.surprise[rows]
    P = D.T @ D / fitted.misfit**2 - own.T @ own + np.eye(len(v))
    b = np.asarray(np.linalg.solve(P, v))
    return Size(b, float(v @ b - np.linalg.slogdet(P)[1]) / 2)
