"""One structure fitted to all cells of a trial: least squares, GCO, and what lies between them.

GCO and least squares of one structure differ in three things, and each is set apart here. The weights of
positions and rotations: least squares takes those at which GCO ends (with one term there are none). The
directions that no reading sees: `equal` fills them so that least squares is conservative, if it can be, and
`lent` takes them from GCO. And the cone's own work on what is seen: what then is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import Estimate
from testbench.identify.least_squares import complete_conservatively, free_directions
from testbench.identify.metric import WeightedPrior, rescale_to_data, scale_by_prior
from testbench.identify.prior import Prior, Strength
from testbench.identify.regression import Regression, regression_of
from testbench.identify.solve import solve
from testbench.model.vjm import Vjm

TAKEN = 0.05
"""Chi squared a seen direction that GCO adds, beyond which no conservative model of equal fit is sought.

GCO fits best of all conservative models but for its trace weight. That was seen to cost up to 0.015 where
there is a model of equal fit.
"""
LEAST_NORM = 1e-2  #: Share of the largest norm of a term that weighs as one less: a term may fit exactly.


@dataclass(frozen=True)
class Compared:
    """Least squares and GCO of one structure, with the same prior or both without, from every dataset."""

    ls: Sequence[Estimate]
    gco: Sequence[Estimate]
    equal: Sequence[Estimate] | None = None  #: Least squares, conservative if it can be; None with a prior.
    lent: Sequence[Estimate] | None = None  #: Least squares with GCO's free directions; None with a prior.

    @property
    def binds(self) -> list[bool]:
        """Whether the cone changes the fit: no model that fits as well as least squares is conservative."""
        return [not estimate.conservative for estimate in self.equal or self.ls]


def without_prior(regressions: Sequence[Regression]) -> Compared:
    """Least squares, GCO, and least squares with other free directions."""
    gco = [solve(regression, "psd") for regression in regressions]
    ls = [solve(weighed_as(estimate), "none") for estimate in gco]
    pairs = list(zip(ls, gco, strict=True))
    return Compared(
        ls, gco, [_equal(*estimates) for estimates in pairs], [_lent(*estimates) for estimates in pairs]
    )


def with_prior(vjm: Vjm, regressions: Sequence[Regression], prior: Prior, strength: Strength) -> Compared:
    """Both with the same prior, which leaves no direction free."""
    scaling = scale_by_prior(prior, vjm, regressions[0].structure)
    pairs = [(r, WeightedPrior(rescale_to_data(scaling, r), strength)) for r in regressions]
    return Compared(
        *(
            [solve(r, constraint, weighted_prior) for r, weighted_prior in pairs]
            for constraint in ("none", "psd")
        )
    )


def weighed_as(gco: Estimate) -> Regression:
    """The runs of GCO, weighed such that it is the conservative least squares fit of them.

    F_M is a sum of norms n_k, with the gradient of sum |r_k|^2 / (2 n_k) at its optimum: over a convex cone
    one C minimises both. Least squares weighs terms by their equations N_k, so rows go by 1 / sqrt(N_k n_k).
    """
    terms = gco.regression.terms
    norms = np.array([np.sqrt(np.sum((t.R @ gco.pi - t.z) ** 2) + t.unexplained) for t in terms])
    size = np.maximum(norms, LEAST_NORM * norms.max()) * [t.equations for t in terms]
    shares = np.sqrt(size.mean() / size)
    weighed = (
        replace(t, R=c * t.R, z=c * t.z, unexplained=c**2 * t.unexplained)
        for c, t in zip(shares, terms, strict=True)
    )
    return regression_of(gco.regression.structure, tuple(weighed)) if len(terms) > 1 else gco.regression


def added(ls: Estimate, gco: Estimate) -> float:
    """Chi squared of GCO less that of least squares, as least squares weighs, over the rank [1]."""
    more = 0.0
    for term in ls.regression.terms:
        theirs, ours = (term.R @ estimate.pi - term.z for estimate in (ls, gco))
        more += term.equations / 3 * float(ours @ ours - theirs @ theirs)
    return more / ls.regression.rank


def _equal(ls: Estimate, gco: Estimate) -> Estimate:
    return ls if added(ls, gco) > TAKEN else complete_conservatively(ls.regression)


def _lent(ls: Estimate, gco: Estimate) -> Estimate:
    """The fit of least squares, the free directions of GCO: what differs from GCO is seen by the data."""
    if ls.regression.rank == ls.structure.n:
        return ls
    free = free_directions(ls.regression, ls.pi)
    twice = np.where(ls.structure.mirrored, 2.0, 1.0)  # entries that stand at two places of C
    w: Array = free.N.T @ (twice * (gco.pi / free.unit - free.x))
    pi = ls.pi + free.unit * (free.N @ w)
    return replace(ls, pi=pi, C_theta=ls.structure.matrix(pi))
