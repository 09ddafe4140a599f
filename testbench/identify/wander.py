"""Link compliances that vary from pose to pose: the size of the variation, learnt from the readings.

No linear model contains it, and its prior would explain it by links that are far off. In pose p every link k
has (1 + rho e_pk) times its compliance, e_pk standard normal. With W the rows pi_k of a fit, one per link,
the rows A_p of a pose have the covariance

    S_p = 1 + rho^2 A_p W^T W A_p^T

in units of the noise, and multiplied by S_p^-1/2 they are those of a linear model again. rho maximises the
evidence under the prior that was learnt without it; it is 0 unless the evidence gains enough. In new poses
links vary as much, which is added to the noise of predictions.
"""

import math
from dataclasses import replace

import numpy as np

from testbench.errors import Array
from testbench.identify.estimate import Estimate
from testbench.identify.hierarchy import MISFIT_DEVIATION
from testbench.identify.metric import WeightedPrior, precision_root
from testbench.identify.regression import (
    Regression,
    regression_of,
    restrict_to,
    term_from_triangle,
    triangular_factor,
)

TRIED_SCATTERS = 0.0, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.56
"""Values of rho that are tried [1]."""
MIN_LOG_EVIDENCE = math.log(10)
"""Log evidence that rho must gain. Of 19 arms of the family with all disturbances none gains it, of 13
undisturbed ones one, which then errs 5 % more (`kr500_l480`, seeds 5000 on, 8 poses)."""
EVIDENCE_BACKOFF = 1.5
"""Log evidence that a larger rho may lose against the best one: the learnt prior explains some of it
already."""
ROUNDING_SHARE = 1e-9
"""Rows below this share of the largest are rounding [1]."""


def stiffness_scatter(r: Regression, estimate: Estimate, back: float = 0.0) -> float:
    """Find the relative change rho of link compliances between poses of greatest evidence.

    Args:
        r: The dataset, with its rows pose by pose.
        estimate: A fit to it with a learnt prior.
        back: Log evidence that a larger rho may lose against the best.

    Returns:
        rho, 0 if the evidence does not gain enough [1].
    """
    fit = _uncoupled(estimate)
    belief = fit.weighted_prior
    assert belief is not None
    r = restrict_to(r, fit.structure)
    poses = [_along(rows, _by_link(r, fit.pi)) for rows in r.poses]
    lost = r.equations - sum(len(w) for w, _ in poses)
    left = math.fsum(t.equations / 3 * (t.unexplained + float(t.z @ t.z)) for t in r.terms)
    left -= math.fsum(float(y @ y) for y in _readings(poses))
    gains = np.array([_log_evidence(rho, belief, poses, lost, left) for rho in TRIED_SCATTERS])
    if gains.max() - gains[0] < MIN_LOG_EVIDENCE:
        return 0.0
    return TRIED_SCATTERS[np.flatnonzero(gains >= gains.max() - back)[-1]]


def _uncoupled(estimate: Estimate) -> Estimate:
    """Return the fit of links and joints, with laws if these are more probable: links explain the rest."""
    if estimate.average is None:
        return estimate
    lawful = estimate.average.with_laws
    return lawful if lawful is not None and estimate.average.laws_weight > 0.5 else estimate.average.all_parts


def _by_link(r: Regression, pi: Array) -> Array:
    """Rows of the parameters of every link, (links, n), zero for those of all others."""
    own = np.arange(r.structure.links)[:, None] == r.structure.a // 6
    return np.asarray(own * np.pad(pi, (0, r.structure.n - len(pi))))


def _along(rows: Array, links: Array) -> tuple[Array, Array]:
    """Compute variances of a pose's rows per rho^2, (k,), and the rows along uncorrelated directions."""
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    long = np.abs(R).max(axis=1)
    R = R[long > ROUNDING_SHARE * long.max(initial=0)]
    G = R[:, :-1] @ links.T
    values, Q = np.linalg.eigh(G @ G.T)
    return np.maximum(values, 0), Q.T @ R


def _log_evidence(
    rho: float, belief: WeightedPrior, poses: list[tuple[Array, Array]], lost: int, left: float
) -> float:
    """Compute the log density of the readings, up to a constant; their noise is as stated or as learnt."""
    B, c = (own / belief.misfit for own in precision_root(belief.scaling, belief.strength))
    prior, L, best = np.c_[B, c].T @ np.c_[B, c], belief.scaling.L, -math.inf
    for kappa in {1.0, belief.misfit}:
        H, spread = prior.copy(), 2 * lost * math.log(kappa)
        for values, rows in poses:
            variance = kappa**2 + rho**2 * values
            own = np.c_[rows[:, :-1] @ L, rows[:, -1]] / np.sqrt(variance)[:, None]
            H += own.T @ own
            spread += float(np.log(variance).sum())
        _, size_of = np.linalg.slogdet(H[:-1, :-1])
        chi = float(H[-1, -1] - H[-1, :-1] @ np.linalg.solve(H[:-1, :-1], H[:-1, -1])) + left / kappa**2
        best = max(best, -(chi + spread + float(size_of) + (math.log(kappa) / MISFIT_DEVIATION) ** 2) / 2)
    return best


def with_scatter(r: Regression, pi: Array, rho: float) -> Regression:
    """Weigh a dataset as if every link's compliance varied from pose to pose by a share rho.

    Mathematics: `prior-13`.

    Args:
        r: The reduced dataset, with its rows pose by pose.
        pi: Parameters of a fit, (n,) or the first of them [m/N, rad/(N m), rad/N].
        rho: Relative standard deviation of a link's compliance over poses [1].

    Returns:
        The weighted regression.
    """
    links, [term] = _by_link(r, pi), r.terms
    poses, points = [_along(rows, links) for rows in r.poses], term.equations / 3
    weighed = [rows / np.sqrt(1 + rho**2 * values)[:, None] for values, rows in poses]
    rest = term.unexplained + float(term.z @ term.z) - sum(float(y @ y) for y in _readings(poses)) / points
    own = term_from_triangle(
        triangular_factor(np.vstack(weighed) / math.sqrt(points)), max(0.0, rest), term.equations
    )
    return replace(regression_of(r.structure, (own,)), wander=rho * links)


def _readings(poses: list[tuple[Array, Array]]) -> list[Array]:
    """Those of every pose that its rows can explain, (k,) each."""
    return [rows[:, -1] for _, rows in poses]
