"""Masses of the links from measured joint torques.

    sign torque_j = sum over bodies of (load of joint j per unit of p) p + load of the wrench + offset_j

p holds mass and first moments of every body. Torques in static poses do not determine all of them: the masses
of rigid.xml are their prior. Friction of unknown direction counts as noise, and outliers are bounded by
Huber's loss. The arm is taken as undeflected, which costs a thousandth of a torque.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Series
from testbench.errors import Array
from testbench.model.load import Weights, weight_columns
from testbench.model.vjm import Vjm, chain, generalised_load

MASS = 0.3  #: Prior standard deviation of a mass, relative to rigid.xml's [1].
CENTRE = 0.1  #: Of a first moment, over the mass: how far a centre may be off [m].
LIMIT = 3.0
"""Bound on each parameter in prior standard deviations: no mass falls below a tenth."""
EXPLAINED = 0.3
"""Largest share of the torques' standard deviation that gravity may leave unexplained [1]."""
HUBER = 1.345
"""Bend of Huber's loss in standard deviations: 95 % efficiency for normal errors."""
EXACT = 1e-4
"""Least noise of a joint's torques, relative to their standard deviation [1]."""
REWEIGHTINGS = 10
POSES_AT_ONCE = 1000  #: Poses whose columns of all virtual joints are in memory at a time.


@dataclass(frozen=True)
class MassFit:
    """Hold masses from joint torques, and how well they explain the torques."""

    weights: Weights  #: Fitted masses; the given ones if gravity does not explain the torques.
    poses: int  #: Poses with measured torques.
    before: float  #: RMS residual of the given masses over all joints [N m, N].
    rest: float  #: RMS residual of the fitted masses [N m, N].
    spread: float  #: RMS deviation of the torques without those of the wrenches [N m, N].
    limited: tuple[str, ...]  #: Links and tool with a parameter at its bound.
    #: Whether torques are the motors' against the weight, or the weight's on the joints.
    motors: bool = False

    @property
    def explained(self) -> bool:
        """Tell whether gravity explains the torques."""
        return self.rest <= EXPLAINED * self.spread


def fit_weights(vjm: Vjm, weights: Weights, series: tuple[Series, ...]) -> MassFit | None:
    """Fit the masses of the links to the joint torques of all series that have some.

    Mathematics: `abs-12`.

    Args:
        vjm: The arm.
        weights: Masses of rigid.xml; bodies without mass there stay massless.
        series: Readings; torques may have either sign, and each joint a constant offset.

    Returns:
        The masses, and how well they fit; None if no series has torques.
    """
    parts = list(_rows(vjm, series))
    if not parts:
        return None
    A, known, torque = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    names = [*(link.name for link in vjm.arm.links[1:]), vjm.arm.tool]
    carries, carried = (_fit(weights, names, A, sign * torque - known) for sign in (1, -1))
    best = min(carries, replace(carried, motors=True), key=lambda fit: fit.rest)
    return best if best.explained else replace(best, weights=weights, limited=())


def _rows(vjm: Vjm, series: tuple[Series, ...]) -> Iterator[tuple[Array, Array, Array]]:
    """Compute columns, (n, runs, 4 (bodies - 1)), wrench loads and torques, (n, runs), of some poses."""
    n = vjm.arm.n_joints
    for one, torque in ((one, one.torque) for one in series if one.torque is not None):
        for start in range(0, one.rows, POSES_AT_ONCE):
            some = slice(start, start + POSES_AT_ONCE)
            where = chain(vjm, one.q[some])
            columns = weight_columns(where)[-n:, :, 1:]
            known = generalised_load(where, one.wrench[some], one.point[some])[-n:]
            yield columns.reshape(*columns.shape[:2], -1), known, torque[some].T


def _fit(weights: Weights, names: Sequence[str], A: Array, y: Array) -> MassFit:
    """Fit masses by least squares with a prior, reweighted; offsets are removed as weighted means.

    Args:
        weights: The prior.
        names: Names of all bodies but the base.
        A: Load of every joint per unit of each parameter, (n, runs, 4 (bodies - 1)).
        y: Load of every joint by gravity, with an offset, (n, runs) [N m, N].
    """
    prior = weights.parameters[1:].ravel()
    sd = (weights.mass[1:, None] * np.array([MASS, CENTRE, CENTRE, CENTRE])).ravel()
    y_0, A = y - A @ prior, A * sd  # from here on steps from the prior, in its standard deviations
    ones = np.ones_like(y)
    spread, left = _scatter(_off_mean(y, ones)), _off_mean(y_0, ones)
    before, x = _scatter(left), np.zeros_like(sd)
    for _ in range(REWEIGHTINGS):
        sigma = np.maximum(_scatter(left), EXACT * spread)[:, None]
        sigma = np.where(sigma > 0, sigma, 1.0)  # a joint without torques
        w = np.minimum(1, HUBER * sigma / np.maximum(np.abs(left), 1e-300)) / sigma**2
        x = _step(_off_mean(A, w), _off_mean(y_0, w), w)
        left = _off_mean(y_0 - A @ x, w)
    limited = (np.abs(x) > LIMIT * (1 - 1e-9)).reshape(-1, 4).any(axis=1)
    p = np.vstack([weights.parameters[:1], (prior + sd * x).reshape(-1, 4)])
    return MassFit(
        weights=Weights(p[:, 0], p[:, 1:] / np.where(p[:, :1] > 0, p[:, :1], 1)),
        poses=y.shape[1],
        before=_rms(before),
        rest=_rms(_scatter(left)),
        spread=_rms(spread),
        limited=tuple(name for name, on in zip(names, limited, strict=True) if on),
    )


def _step(A: Array, y: Array, w: Array) -> Array:
    """Minimise the sum of w (A x - y)^2 and x^2 within the bounds, (4 (bodies - 1),) [1]."""
    from scipy.optimize import lsq_linear  # here: it takes long to import, and few runs have torques

    size = A.shape[2]
    rows = np.column_stack([A.reshape(-1, size), y.ravel()]) * np.sqrt(w).reshape(-1, 1)
    R: Array = np.asarray(np.linalg.qr(np.vstack([rows, np.eye(size, size + 1)]), mode="r"))
    return np.asarray(lsq_linear(R[:, :-1], R[:, -1], (-LIMIT, LIMIT), method="bvls").x)


def _off_mean(x: Array, w: Array) -> Array:
    """Subtract the weighted mean of every joint from its values, (n, runs, ...)."""
    share = w / w.sum(axis=1, keepdims=True)
    return np.asarray(x - np.einsum("jr...,jr->j...", x, share)[:, None])


def _scatter(x: Array) -> Array:
    """Estimate the standard deviation of values about zero by their median, (n,)."""
    return np.asarray(1.4826 * np.median(np.abs(x), axis=1))


def _rms(x: Array) -> float:
    return float(np.sqrt((x**2).mean()))
