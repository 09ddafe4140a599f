"""A method is a value: what it asks of the blocks, which prior it believes, which loss it has.

A method is called like an estimator of your own: method(vjm, structure, data) -> Estimate.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify.average import averaged, of_two_priors
from testbench.identify.crossval import divided
from testbench.identify.estimate import Constraint, Estimate, Estimator, Penalty
from testbench.identify.fold import Parts, reduce, reduce_parts
from testbench.identify.huber import without_outliers
from testbench.identify.metric import Belief, metric, rescaled
from testbench.identify.prior import Prior, Strength, softened
from testbench.identify.regression import Regression, some_columns
from testbench.identify.solve import solve
from testbench.identify.trace import learnt, weighed
from testbench.model.laws import without_laws
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

ROBUST_UNCERTAINTY = 0.3  #: Relative uncertainty of a prior beside a robust loss, where none is given.


@dataclass(frozen=True)
class Method:
    """How to identify."""

    #: "none" for least squares, "psd" for GCO, "free" for least squares completed, which takes no prior.
    constraint: Constraint = "psd"
    prior: Prior | None = None  #: Expected compliances, their common scale left to the data; None for none.
    #: How firmly the prior is believed; None to learn it from the readings, with the scale of every link and
    #: joint, or `ROBUST_UNCERTAINTY` with a robust loss: outliers would teach it.
    strength: Strength | None = None
    loss: Literal["plain", "robust"] = "plain"  #: "robust" looks for outliers and does without them.
    #: Weight w of the trace term beside F_M in GCO without a prior [N m/rad]: F_M + w <W, C> is least, see
    #: `trace`. It is an exponential prior on compliances, of mean 1 / (w F_M N) rad/(N m) each for N points,
    #: those of joints nearly free. None to learn it from poses held out; 0 for the paper's GCO, which takes
    #: the least trace only among models that fit alike.
    trace_weight: float | None = None

    def __post_init__(self) -> None:
        """Refuse by BenchError a prior where it would leave nothing to complete, or a negative weight."""
        if self.prior is not None and self.constraint == "free":
            raise BenchError(
                "prior: expected least squares or GCO; with a prior no direction is free to be completed"
            )
        if self.trace_weight is not None and not 0 <= self.trace_weight < np.inf:
            raise BenchError(f"trace_weight [N m/rad]: expected 0 or more, got {self.trace_weight}")

    def __call__(self, vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        """Identify a structure from a dataset.

        Args:
            vjm: The model.
            structure: The unknowns; with a prior, or GCO with a robust loss, of whole blocks.
            data: The runs.

        Returns:
            Compliances, and what there is to say of them.

        Raises:
            BenchError: When the dataset is empty or names a marker that the arm lacks, the structure is not
                symmetric where it must be, or the prior does not fit the structure or the data.
        """
        unknowns = structure if self.learns else without_laws(structure)
        reduced: Parts | Regression
        if self.penalised and isinstance(data, Dataset):  # poses are held out
            [reduced] = reduce_parts(vjm, [unknowns], data, divided(data))
        else:
            reduced = reduce(vjm, unknowns, data)
        if self.loss == "plain":
            return self.of(vjm, reduced)
        regression = reduced.together() if isinstance(reduced, Parts) else reduced
        held = self.belief(vjm, regression) or self.penalty(vjm, reduced)
        return without_outliers(vjm, data, regression, self.constraint, held)

    def of(self, vjm: Vjm, reduced: Parts | Regression, *, widths: bool = True) -> Estimate:
        """Identify from a dataset that was reduced before, outliers among it.

        Args:
            vjm: The model.
            reduced: The dataset; in parts where poses are to be held out, as a trace weight is learnt.
            widths: False where poses are held out: links are as coupled as the prior's.

        Returns:
            The estimate.
        """
        regression = reduced.together() if isinstance(reduced, Parts) else reduced
        if self.learns and self.prior is not None:
            own = metric(self.prior, vjm, regression.structure)
            if not widths or not regression.structure.laws:
                return averaged(regression, self.constraint, own, widths=widths)
            other = metric(softened(self.prior), vjm, regression.structure)
            return of_two_priors(regression, self.constraint, own, other)
        if regression.structure.laws:
            reduced = regression = some_columns(regression, without_laws(regression.structure))
        held = self.belief(vjm, regression) or self.penalty(vjm, reduced)
        return solve(regression, self.constraint, held)

    @property
    def learns(self) -> bool:
        """Whether the readings teach how firmly the prior is believed, and how much laws of joints count."""
        return self.prior is not None and self.strength is None and self.loss == "plain"

    @property
    def penalised(self) -> bool:
        """Whether a trace term stands in for a prior, and its weight is to be learnt."""
        return self.constraint == "psd" and self.prior is None and self.trace_weight is None

    def penalty(self, vjm: Vjm, reduced: Parts | Regression) -> Penalty | None:
        """The trace term of GCO without a prior; None for none."""
        if self.penalised:
            return learnt(vjm, reduced)
        if self.constraint != "psd" or self.prior is not None or not self.trace_weight:
            return None
        return weighed(vjm, reduced.structure, self.trace_weight)

    def belief(self, vjm: Vjm, regression: Regression) -> Belief | None:
        """The prior in the scale of a dataset, and how firmly it is believed; None without a prior.

        Raises:
            BenchError: When the prior does not fit the structure or the data.
        """
        if self.prior is None:
            return None
        own = metric(self.prior, vjm, regression.structure)
        return Belief(rescaled(own, regression), self.strength or Strength(ROBUST_UNCERTAINTY))


least_squares = Method("none")
"""Weighted least squares, Eq. (14)-(15); of minimum norm where the data leave directions free."""

completed_least_squares = Method("free")
"""Weighted least squares whose free directions make it conservative where that is possible.

Of all conservative models that fit as well as `least_squares`, it is the one nearest to its solution of
minimum norm, in the units of sensitivity. Where there is none, it is that solution: `Estimate.status`
says so. It shows what the choice of one of many equal fits does, and what GCO does beyond."""

gco = Method("psd")
"""GCO to global optimality: the conservative model of least F_M, Eq. (19), and trace, with a certificate.

The weight of the trace is learnt from poses held out, see `Method.trace_weight`."""

paper_gco = Method("psd", trace_weight=0.0)
"""GCO as in the paper: the conservative model of least F_M, Eq. (19); of equal fits that of least trace."""


def with_prior(estimator: Estimator, prior: Prior, strength: Strength | None = None) -> Method:
    """A method that fills with a prior what the data cannot see.

    Args:
        estimator: A method; not an estimator of your own.
        prior: Expected compliances.
        strength: How firmly they are believed; None to learn it from the readings, see `hierarchy`.

    Returns:
        The method with the prior; call it as any other.

    Raises:
        BenchError: When the estimator is your own, or the prior is none.
    """
    if not isinstance(prior, Prior):
        raise BenchError(f"prior: expected one, such as cad_prior(arm), got {type(prior).__name__}")
    return replace(_method(estimator, "prior"), prior=prior, strength=strength)


def robust(estimator: Estimator) -> Method:
    """A method that looks for outliers and does without them.

    Args:
        estimator: A method; not an estimator of your own.

    Returns:
        The method with a robust loss; `Estimate.rejected` lists what it does without.

    Raises:
        BenchError: When the estimator is your own.
    """
    return replace(_method(estimator, "robust loss"), loss="robust")


def _method(estimator: Estimator, what: str) -> Method:
    if isinstance(estimator, Method):
        return estimator
    name = getattr(estimator, "__name__", type(estimator).__name__)
    raise BenchError(f"{name}: an estimator of your own runs as it is, it cannot be given a {what}")
