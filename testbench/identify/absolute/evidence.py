"""How large errors of every kind are, learnt from the readings: type-II maximum likelihood.

Every group of unknowns, such as a band of the joints' harmonics, has a Gaussian prior of one standard
deviation. It is the one of greatest evidence (MacKay 1992), held by a few imagined unknowns; so is the
scatter of every kind of equations. A kind of error that is not there is drawn to nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from testbench.errors import Array, BenchError
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.metric import Metric, precision_root
from testbench.identify.prior import Strength
from testbench.model.structure import Ids

USUAL: Mapping[str, float] = {
    "geometry shift": 1e-3,
    "geometry turn": 1e-3,
    "harmonics": 3e-5,
    "ratio": 1e-4,
    "play": 3e-5,
    "stiffening": 3e-5,
}
"""Standard deviations before any reading [m, rad; rad a rad]."""
MOST = 10.0  #: Times the usual size beyond which no error is: it stands for one that was left out.
HELD = 2.0  #: Imagined unknowns of the usual size in every small group.
LARGE, SHARE = 40, 1 / 6
"""Unknowns above which a group is large, and the size of its one imagined unknown over the usual one: a
large group tells its size, and orders that the joints lack are drawn to nothing however many are tried."""
SPARE = 2.0
"""Imagined equations of every kind, scattered as expected: unknowns may spend all there are."""
ROUNDS, SAME = 12, 1e-3
LOOSE = Strength(3.0)
"""What is believed of compliances while the sizes of all other errors are learnt."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Some of the unknowns: what else there might be is zero."""

    unknowns: Unknowns  #: All that there might be.
    columns: Ids  #: Columns that are on, compliances last, (c,).
    elastic: Metric | None  #: Prior of the compliances that are on; None where the arm is rigid.

    @property
    def rigid(self) -> int:
        """Columns that are no compliances."""
        return len(self.columns) - (0 if self.elastic is None else len(self.elastic.expected))


def choice(unknowns: Unknowns, kinds: frozenset[str], elastic: Metric | None) -> Choice:
    """The columns of some kinds of errors, and of the structure of a metric.

    Raises:
        BenchError: When the structure has compliances that the unknowns lack.
    """
    first = unknowns.starts["geometry"]
    on = [np.arange(first), *(c for kind, c in unknowns.groups if kind in kinds)]
    rigid = np.sort(np.concatenate(on))
    if elastic is None:
        return Choice(unknowns, rigid, None)
    place = {pair: k for k, pair in enumerate(zip(unknowns.structure.a, unknowns.structure.b, strict=True))}
    wanted = list(zip(elastic.structure.a, elastic.structure.b, strict=True))
    if not all(pair in place for pair in wanted):
        raise BenchError(f"{elastic.structure.name}: expected a part of {unknowns.structure.name}")
    own = unknowns.starts["elastic"] + np.array([place[pair] for pair in wanted])
    return Choice(unknowns, np.concatenate([rigid, own]), elastic)


@dataclass(frozen=True)
class Learnt:
    """Sizes of errors and scatters of greatest evidence."""

    deviation: Array  #: Prior standard deviation of every unknown, (size,); infinite of those that have none.
    factor: Array  #: Scatter of every kind of equations that there is over what was expected, (kinds,) [1].


def usual(unknowns: Unknowns, kinds: int) -> Learnt:
    """The usual sizes, and scatters as expected of some kinds of equations."""
    deviation = np.full(unknowns.size, np.inf)
    for kind, columns in unknowns.groups:
        deviation[columns] = USUAL[kind]
    return Learnt(deviation, np.ones(kinds))


def squares(own: Choice, gram: Array) -> Array:
    """Sums of squares of a choice, compliances in the metric of their prior, (kinds, c + 1, c + 1)."""
    some = np.r_[own.columns, gram.shape[1] - 1]
    found = gram[np.ix_(range(len(gram)), some, some)]
    if own.elastic is not None:
        e, L = slice(own.rigid, -1), own.elastic.L
        found[:, :, e] = found[:, :, e] @ L
        found[:, e, :] = L.T @ found[:, e, :]
    return np.asarray(found)


def prior(own: Choice, learnt: Learnt, strength: Strength) -> tuple[Array, Array]:
    """Precision that priors add, (c, c), and what it pulls towards, (c,)."""
    c = len(own.columns)
    P, b = np.zeros((c, c)), np.zeros(c)
    held = np.arange(own.rigid)
    P[held, held] = learnt.deviation[own.columns[: own.rigid]] ** -2.0
    if own.elastic is not None:
        B, towards = precision_root(own.elastic, strength)
        P[own.rigid :, own.rigid :], b[own.rigid :] = B.T @ B, B.T @ towards
    return P, b


@dataclass(frozen=True)
class Solution:
    """The most likely unknowns."""

    x: Array  #: Of the choice, compliances in the metric, (c,).
    covariance: Array | None  #: (c, c), where it was asked for.
    variance: Array | None = None  #: Of those columns for which it was asked, (k,).


def solve(  # noqa: PLR0913
    own: Choice,
    S: Array,
    learnt: Learnt,
    strength: Strength,
    *,
    covariance: bool = False,
    columns: Ids | None = None,
) -> Solution:
    """Most likely unknowns by `squares` S of the readings; their covariance, or variances of some columns."""
    H = np.tensordot(learnt.factor**-2.0, S, 1)
    P, b = prior(own, learnt, strength)
    P += H[:-1, :-1]
    size = np.sqrt(np.diag(P))
    if not (size > 0).all():
        raise BenchError("calibration: the readings leave a frame or target open; expected more poses")
    try:
        root = cho_factor(P / size / size[:, None])
    except np.linalg.LinAlgError:
        raise BenchError(
            "calibration: the readings leave a frame or target open; expected more poses"
        ) from None
    x = cho_solve(root, (H[:-1, -1] + b) / size) / size
    if columns is not None:
        some = np.eye(len(size))[:, columns]
        return Solution(x, None, (some * cho_solve(root, some)).sum(axis=0) / size[columns] ** 2)
    if not covariance:
        return Solution(x, None)
    inverse = np.triu(dpotri(root[0], lower=0)[0])
    inverse += np.triu(inverse, 1).T
    return Solution(x, inverse / size / size[:, None])


def learn(own: Choice, S: Array, counts: Array, start: Learnt) -> Learnt:
    """Sizes and scatters of greatest evidence.

    Args:
        own: The unknowns.
        S: Their `squares`.
        counts: Equations of every kind, (kinds,).
        start: Where to begin.
    """
    learnt = start
    for _ in range(ROUNDS):
        found = solve(own, S, learnt, LOOSE, covariance=True)
        assert found.covariance is not None
        deviation = _sizes(own, found.x, found.covariance, learnt.deviation)
        factor = _scatters(found, S, counts, learnt.factor)
        moved = np.abs(np.log(factor / learnt.factor)).max()
        learnt = Learnt(deviation, factor)
        if moved < SAME:
            break
    return learnt


def _sizes(own: Choice, x: Array, V: Array, deviation: Array) -> Array:
    """Standard deviations that the unknowns of every group show, (size,)."""
    deviation, place = deviation.copy(), np.full(own.unknowns.size, -1)
    place[own.columns] = np.arange(len(own.columns))
    for kind, columns in own.unknowns.groups:
        at = place[columns]
        if (at < 0).any():
            continue
        known = max(0.0, len(at) - V[at, at].sum() / deviation[columns[0]] ** 2)
        held, size = (1.0, SHARE * USUAL[kind]) if len(at) > LARGE else (HELD, USUAL[kind])
        deviation[columns] = min(
            MOST * USUAL[kind], np.sqrt((x[at] @ x[at] + held * size**2) / (known + held))
        )
    return deviation


def _scatters(found: Solution, S: Array, counts: Array, factor: Array) -> Array:
    """Scatter of every kind of equations over what was expected, (kinds,)."""
    assert found.covariance is not None
    v, factor = np.r_[found.x, -1.0], factor.copy()
    for kind in np.flatnonzero(counts):
        spent = np.sum(found.covariance * S[kind, :-1, :-1]) / factor[kind] ** 2
        left, free = max(float(v @ S[kind] @ v), 0.0), max(counts[kind] - spent, 0.0)
        factor[kind] = np.sqrt((left + SPARE) / (free + SPARE))
    return factor
