"""A prior that learns from the readings how wrong it is, before it fills what they do not see.

In the metric of the prior a block is x_k = s_k (e_k + d xi): its scale s_k, and entries that scatter around
what was expected, by u those of a beam template and by c the couplings that no beam has. The scales of links,
and those of joints, scatter around a factor of each kind, as a Student distribution does: most are alike, a
few are far off. With readings y = A x + noise of covariance kappa^2, all this makes
    y ~ N(A s e, kappa^2 + A D A^T),    D = diag((s_k u)^2 or (s_k c)^2),
and the hyperparameters (log s, factors, log u, log c, log kappa) are those of greatest evidence, type-II
maximum likelihood with weak priors (MacKay 1992, The evidence framework). A CAD model whose joints, or one of
whose links, are ten times off costs little then, where the readings show it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from testbench.errors import Array, BenchError
from testbench.identify.cone import triangle
from testbench.identify.metric import Belief, Metric, Scale, rescaled, whitened
from testbench.identify.prior import Strength
from testbench.identify.regression import RANK_TOLERANCE, Regression
from testbench.model.structure import Ids

SCATTER, TAIL = 0.4, 4.0
"""Scale and degrees of freedom of the Student distribution of log s around the factor of its kind [1]."""
GAP = 1.5  #: Standard deviation of the logarithm of the joints' factor over the links' [1].
SHAPE = 0.5, 0.4  #: Median of u, and standard deviation of its logarithm [1].
COUPLING = 0.15, 0.7  #: The same of c.
ALONE = math.hypot(SCATTER, SHAPE[0])
"""How far a joint's compliance is from a common scale where links are rigid [1]: its scale and its entry."""
MISFIT = 0.7  #: Standard deviation of log kappa above zero [1].
KIND = "joints"  #: Name of the scale of all joints beside the links.
FURTHEST, NOISIEST = 6.0, 30.0
"""Largest logarithm of a scale, a factor of 400, and of kappa: misfits have no end."""
STEP = 1e-4  #: Of a hyperparameter, for second derivatives: rounding and curvature cost 1e-7 both.
WIDEST = 1.5  #: Largest standard deviation of a hyperparameter that intervals count with: linear no more.


@dataclass(frozen=True)
class Evidence:
    """What the readings say of the hyperparameters h, (K + kinds + 3,): log s, factors, log u, c, kappa."""

    metric: Metric  #: Of the prior, in the scale of the data.
    A: Array  #: Readings in the r directions that they span, [standard deviations], (r, n).
    y: Array  #: (r,).
    rest: float  #: Squared length of the readings outside these.
    equations: int  #: How many readings are behind `rest`.
    block: Ids  #: Block of every entry of x, (n,).
    kind: Ids  #: Of every block: 0 for the first of links and joints that there is, (K,).
    moved: Array  #: A e of every block, (r, K).
    scatter: Array  #: A A^T of the entries of a template, then of the couplings, of every block, (2 K, r r).

    @property
    def blocks(self) -> int:
        """How many there are, K."""
        return len(self.kind)

    @property
    def start(self) -> Array:
        """The medians of all hyperparameters."""
        levels = np.log([SHAPE[0], COUPLING[0], 1.0])
        return np.concatenate([np.zeros(self.blocks + self.kind.max() + 1), levels])


def evidence(regression: Regression, metric: Metric) -> Evidence:
    """What a dataset says of a prior.

    Raises:
        BenchError: When the data want a common scale of the prior that is not above 0, or no load moves it.
    """
    metric = rescaled(metric, regression)
    rows, y = whitened(regression, metric)
    U, s, Vt = np.linalg.svd(rows, full_matrices=False)
    r = int((s > RANK_TOLERANCE * s[0]).sum()) if s[0] > 0 else 0
    if r == 0:
        raise BenchError(f"prior {metric.prior}: expected runs under load, none moves the model")
    A, own = s[:r, None] * Vt[:r], U[:, :r].T @ y
    block = np.repeat(np.arange(len(metric.sizes)), [triangle(n) for n in metric.sizes])
    places = [block == k for k in range(len(metric.sizes))]
    parts = [A[:, at & own_kind] for own_kind in (~metric.couplings, metric.couplings) for at in places]
    outside = math.fsum(t.equations / 3 * t.rest for t in regression.terms)
    return Evidence(
        metric=metric,
        A=A,
        y=own,
        rest=outside + max(0.0, float(y @ y - own @ own)),
        equations=max(0, regression.equations - r),
        block=block,
        kind=np.unique(metric.joints, return_inverse=True)[1],
        moved=np.stack([A[:, at] @ metric.expected[at] for at in places], axis=1),
        scatter=np.array([(part @ part.T).ravel() for part in parts]),
    )


@dataclass(frozen=True)
class Weighed:
    """The readings under some hyperparameters."""

    variances: Array  #: Prior variance of the entries of a template, then of the couplings, a block, (2 K,).
    inverse: Array  #: Of the readings' covariance S, (r, r).
    log_size: float  #: Logarithm of its determinant.
    e: Array  #: Readings minus what is expected, (r,).
    v: Array  #: S^-1 e, (r,).


def weigh(seen: Evidence, h: Array) -> Weighed:
    """Readings over their covariance, S = kappa^2 + A D A^T: at least one, so that it has a root.

    Raises:
        BenchError: When rounding leaves it none, as with sizes of 1e16 standard deviations.
    """
    s2, kappa2 = np.exp(2 * h[: seen.blocks]), np.exp(2 * h[-1])
    variances = np.concatenate([np.exp(2 * h[-3]) * s2, np.exp(2 * h[-2]) * s2])
    r = len(seen.y)
    S = (variances @ seen.scatter).reshape(r, r)
    S.flat[:: r + 1] += kappa2
    root, _ = dpotrf(S, lower=1)
    half, failed = dpotri(root, lower=1)  # all of the inverse is in the gradient
    if failed:
        name = seen.metric.prior
        raise BenchError(
            f"prior {name}: expected readings that compare with it, their covariance has no root"
        )
    inverse = np.where(np.tri(r, dtype=bool), half, half.T)
    e = seen.y - seen.moved @ np.sqrt(s2)
    return Weighed(variances, inverse, 2 * float(np.log(np.diag(root)).sum()), e, inverse @ e)


def loss(seen: Evidence, h: Array) -> tuple[float, Array]:
    """Minus the logarithm of the evidence and of the hyperparameters' density, and its gradient in h."""
    return _loss(seen, h, weigh(seen, h))


def _loss(seen: Evidence, h: Array, own: Weighed) -> tuple[float, Array]:
    K, s, kappa2 = seen.blocks, np.exp(h[: seen.blocks]), np.exp(2 * h[-1])
    variances, v = own.variances, own.v
    value = (own.e @ v + own.log_size + seen.rest / kappa2) / 2 + seen.equations * h[-1]
    slope = (own.inverse - np.outer(v, v)) / 2
    by_variance = 2 * variances * (seen.scatter @ slope.ravel())
    g = np.zeros_like(h)
    g[:K] = by_variance[:K] + by_variance[K:] - s * (seen.moved.T @ v)
    g[-3:] = (
        by_variance[:K].sum(),
        by_variance[K:].sum(),
        2 * kappa2 * np.trace(slope) - seen.rest / kappa2 + seen.equations,
    )
    return _with_priors(seen, h, float(value), g)


def _with_priors(seen: Evidence, h: Array, value: float, g: Array) -> tuple[float, Array]:
    """Adds minus the logarithm of the hyperparameters' density, and its gradient, in place."""
    K = seen.blocks
    z = (h[:K] - h[K:-3][seen.kind]) / SCATTER
    value += scatter(z)
    pull = (TAIL + 1) * z / (TAIL + z**2) / SCATTER
    g[:K] += pull
    g[K:-3] -= np.bincount(seen.kind, weights=pull)
    if len(g[K:-3]) > 1:
        gap = (h[K + 1] - h[K]) / GAP
        value += gap**2 / 2
        g[K : K + 2] += np.array([-1, 1]) * gap / GAP
    widths = np.array([SHAPE[1], COUPLING[1], MISFIT])
    off = (h[-3:] - seen.start[-3:]) / widths
    g[-3:] += off / widths
    return float(value + off @ off / 2), g


def learn(regression: Regression, metric: Metric, *, widths: bool = True) -> Belief:
    """The prior as a dataset corrects it, and what the dataset leaves open of it.

    Args:
        regression: The reduced dataset.
        metric: Of the structure and the prior.
        widths: Whether intervals or doubts are asked for; else what the dataset leaves open stays unknown.

    Returns:
        The metric with the scale of every block, how firmly each entry is believed, and by how much the
        parameters move with the hyperparameters.

    Raises:
        BenchError: When the data want a common scale of the prior that is not above 0.
    """
    seen = evidence(regression, metric)
    h = greatest(seen, seen.start)
    u, c, kappa = np.exp(h[-3:])
    scale = np.exp(h[: seen.blocks])[seen.block]
    both = 0 < metric.joints.sum() < len(metric.joints)
    belief = Belief(
        metric=replace(seen.metric, L=seen.metric.L * scale),
        strength=Strength(float(u / kappa), 0.0, coupling=float(c / kappa)),
        misfit=float(kappa),
        log_evidence=log_evidence(seen, h) if both else None,
    )
    if not widths:
        return belief
    covariance, moves = _left_open(seen, h)
    return replace(belief, moves=moves @ seen.metric.L.T, scales=_scales(seen, h, covariance))


def scatter(z: Array) -> float:
    """Minus the logarithm of Student's density, but for a constant."""
    return float((TAIL + 1) / 2 * np.log1p(np.square(z) / TAIL).sum())


def greatest(seen: Evidence, start: Array, held: int | None = None) -> Array:
    """The hyperparameters of greatest evidence from a start on; the scale of one block may be held."""
    from scipy.optimize import minimize  # here: importing it takes longer than most fits

    ends = [(-FURTHEST, FURTHEST)] * (len(start) - 1) + [(0.0, NOISIEST)]
    if held is not None:
        ends[held] = (start[held], start[held])

    def cost(h: Array) -> tuple[float, Array]:
        return loss(seen, h)

    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=ends)
    return np.asarray(found.x)


def _mean(seen: Evidence, h: Array, own: Weighed) -> Array:
    """The expectation of x after the readings, (n,)."""
    expected = np.exp(h[: seen.blocks])[seen.block] * seen.metric.expected
    variances = own.variances[seen.block + seen.blocks * seen.metric.couplings]
    return np.asarray(expected + variances * (seen.A.T @ own.v))


def _left_open(seen: Evidence, h: Array) -> tuple[Array, Array]:
    """Covariance of the hyperparameters but kappa, Laplace's, and a standard deviation's moves of x, each.

    Second derivatives are differences of the gradient; where the evidence is flat a hyperparameter counts
    as known to WIDEST.
    """
    m = len(h) - 1
    H, J = np.empty((m, m)), np.empty((m, len(seen.block)))
    for i in range(m):
        ends = [h + sign * STEP * np.eye(m + 1)[i] for sign in (1, -1)]
        own = [weigh(seen, end) for end in ends]
        (_, up), (_, down) = (_loss(seen, end, one) for end, one in zip(ends, own, strict=True))
        H[i] = (up - down)[:m] / (2 * STEP)
        further, nearer = (_mean(seen, end, one) for end, one in zip(ends, own, strict=True))
        J[i] = (further - nearer) / (2 * STEP)
    values, Q = np.linalg.eigh((H + H.T) / 2)
    root = Q / np.sqrt(np.maximum(values, WIDEST**-2))
    return root @ root.T, root.T @ J


def log_evidence(seen: Evidence, h: Array) -> float:
    """Laplace's logarithm of the density of the readings, of links and joints; kappa stays where it is best.

    The densities of the hyperparameters are normalised by Laplace too, so that readings which say nothing
    of them weigh nothing; what all models share, such as powers of 2 pi, is left out.
    """
    m, K = len(h) - 1, seen.blocks
    steps = STEP * np.eye(m + 1)[:m]
    H = np.array([loss(seen, h + d)[1] - loss(seen, h - d)[1] for d in steps])[:, :m] / (2 * STEP)
    values = np.linalg.eigvalsh((H + H.T) / 2)
    prior = K * math.log((TAIL + 1) / TAIL / SCATTER**2) / 2 - math.log(GAP * SHAPE[1] * COUPLING[1])
    return prior - loss(seen, h)[0] - float(np.log(np.maximum(values, WIDEST**-2)).sum()) / 2


def log_evidence_alone(seen: Evidence) -> tuple[float, float]:
    """The same of joints alone, a normal distribution of width ALONE about a common scale; and kappa.

    The scale is integrated out: the readings say all of it.
    """
    from scipy.optimize import minimize_scalar  # here: importing it takes longer than most fits

    moved = seen.moved.sum(axis=1)

    def cost(log_kappa: float) -> float:
        h = np.zeros(len(seen.start))
        h[-3:] = math.log(ALONE), math.log(COUPLING[0]), log_kappa
        own = weigh(seen, h)
        pull = own.inverse @ moved
        size, along = float(moved @ pull), float(seen.y @ pull)
        left = seen.y @ own.inverse @ seen.y - along**2 / size + seen.rest * math.exp(-2 * log_kappa)
        noise = seen.equations * log_kappa + (log_kappa / MISFIT) ** 2 / 2
        return float((left + own.log_size + math.log(size)) / 2 + noise)

    found = minimize_scalar(cost, bounds=(0.0, NOISIEST), method="bounded")
    return -float(found.fun), math.exp(found.x)


def _scales(seen: Evidence, h: Array, covariance: Array) -> tuple[Scale, ...]:
    """The factor of every block over the others of its kind, and that of the joints over the links."""
    K, m = seen.blocks, len(h) - 1
    rows, names = np.zeros((K, m)), list(seen.metric.names)
    rows[range(K), range(K)] = 1
    rows[range(K), K + seen.kind] = -1
    if m > K + 3:
        rows = np.vstack([rows, (np.arange(m) == K + 1) * 1.0 - (np.arange(m) == K)])
        names.append(KIND)
    deviations = np.sqrt(np.einsum("ki,ij,kj->k", rows, covariance, rows))
    found = zip(names, np.exp(rows @ h[:m]), deviations, strict=True)
    return tuple(Scale(name, float(factor), float(deviation)) for name, factor, deviation in found)
