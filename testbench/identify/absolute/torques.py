"""Masses of the links from measured joint torques.

    sign torque_j = sum over bodies of (load of joint j per unit of p) p + load of the wrench + offset_j

p has mass and first moments of every body. Torques of poses at rest do not tell all of them apart: the
masses of rigid.xml are their prior. Friction of unknown direction counts as noise; a wild torque pulls no
harder than a large one (Huber). The arm is taken as straight, which costs a thousandth of a torque.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.model.vjm import Vjm, chain, generalised_load
from testbench.model.weights import Weights, weight_columns

MASS = 0.3  #: Prior standard deviation of a mass, relative to rigid.xml's [1].
CENTRE = 0.1  #: Of a first moment, over the mass: how far a centre may be off [m].
LIMIT = 3.0  #: Prior standard deviations that nothing goes beyond: no mass falls below a tenth.
EXPLAINED = 0.3  #: Torques whose rest stays above this share of their spread are not those of the weight [1].
HUBER = 1.345  #: Standard deviations beyond which a torque pulls no harder: 95 % efficiency of normal ones.
EXACT = 1e-4  #: Least scatter of a joint's torques, relative to their spread [1].
REWEIGHTINGS = 10
BATCH = 1000  #: Poses whose columns of all virtual joints are in memory at a time.


@dataclass(frozen=True)
class MassFit:
    """Masses by joint torques, and how well these are explained."""

    weights: Weights  #: Fitted; those that were given where weight does not explain the torques.
    poses: int  #: Poses whose torques were read.
    before: float  #: Scatter that the given masses leave, root mean square over joints [N m, N].
    rest: float  #: Scatter that is left [N m, N].
    spread: float  #: Scatter of the torques without the wrenches' [N m, N].
    limited: tuple[str, ...]  #: Links and tool of which a number is as far from the given one as it may be.
    #: Whether torques are the motors' against the weight, or the weight's on the joints.
    motors: bool = False

    @property
    def explained(self) -> bool:
        """Whether the torques are those of the weight."""
        return self.rest <= EXPLAINED * self.spread


def fit_weights(vjm: Vjm, weights: Weights, series: tuple[Series, ...]) -> MassFit | None:
    """Masses that explain the torques of all series that have some.

    Mathematics: `abs-12`.

    Args:
        vjm: The arm.
        weights: What rigid.xml says; bodies without mass there stay without.
        series: Readings; torques may have either sign, and a constant offset a joint.

    Returns:
        The masses, and what they are from; None without torques.
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
    """Of some poses columns, (n, runs, 4 (bodies - 1)), the wrenches' load and the torques, (n, runs)."""
    n = vjm.arm.n_joints
    for one, torque in ((one, one.torque) for one in series if one.torque is not None):
        for start in range(0, one.rows, BATCH):
            some = slice(start, start + BATCH)
            where = chain(vjm, one.q[some])
            columns = weight_columns(where)[-n:, :, 1:]
            known = generalised_load(where, one.wrench[some], one.point[some])[-n:]
            yield columns.reshape(*columns.shape[:2], -1), known, torque[some].T


def _fit(weights: Weights, names: Sequence[str], A: Array, y: Array) -> MassFit:
    """Masses by least squares with a prior, reweighted; offsets are taken out as weighted means.

    Args:
        weights: The prior.
        names: Of all bodies but the base.
        A: Load of every joint per unit of each parameter, (n, runs, 4 (bodies - 1)).
        y: Load of every joint under the weight, with an offset, (n, runs) [N m, N].
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
    """Least sum of w (A x - y)^2 and x^2 inside the limits, (4 (bodies - 1),) [1]."""
    from scipy.optimize import lsq_linear  # here: it takes long to import, and few runs have torques

    size = A.shape[2]
    rows = np.column_stack([A.reshape(-1, size), y.ravel()]) * np.sqrt(w).reshape(-1, 1)
    R: Array = np.asarray(np.linalg.qr(np.vstack([rows, np.eye(size, size + 1)]), mode="r"))
    return np.asarray(lsq_linear(R[:, :-1], R[:, -1], (-LIMIT, LIMIT), method="bvls").x)


def _off_mean(x: Array, w: Array) -> Array:
    """Values of every joint, (n, runs, ...), less their mean by weights, (n, runs)."""
    share = w / w.sum(axis=1, keepdims=True)
    return np.asarray(x - np.einsum("jr...,jr->j...", x, share)[:, None])


def _scatter(x: Array) -> Array:
    """Standard deviation of values about zero, wild ones left aside, (n,)."""
    return np.asarray(1.4826 * np.median(np.abs(x), axis=1))


def _rms(x: Array) -> float:
    return float(np.sqrt((x**2).mean()))
