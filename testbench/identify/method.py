"""Identification methods: least squares or GCO, with a prior or without, with a plain or a robust loss.

A method reduces a dataset to its weighted equations (13) and solves them for the compliances of a structure.
It is called like an estimator of your own: method(vjm, structure, data) -> Estimate.
"""

from dataclasses import dataclass, replace
from types import NoneType
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import BenchError, check_type
from testbench.identify.average import average_models, average_two_priors
from testbench.identify.equations import check_deflections
from testbench.identify.estimate import Constraint, Estimate, Estimator, TracePenalty
from testbench.identify.prior import (
    Prior,
    PriorUncertainty,
    WeightedPrior,
    rescale_to_data,
    scale_by_prior,
    with_weaker_coupling,
)
from testbench.identify.regression import (
    GroupedRegression,
    Regression,
    reduce,
    reduce_by_group,
    restrict_regression,
)
from testbench.identify.solve import solve, without_outliers
from testbench.identify.trace import cross_validation_groups, learn_trace_penalty, trace_penalty
from testbench.model.laws import remove_law_parameters
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

ROBUST_PRIOR_UNCERTAINTY = 0.3
"""Relative standard deviation of a prior in a robust fit if the user states none [1]."""


@dataclass(frozen=True)
class Method:
    """Identify compliances from a dataset by least squares or GCO, with a prior or without.

    With A pi = y the weighted equations (13) and F_M the cost of Eq. (19), a method solves one of::

        least squares    min |A pi - y|^2,               Eq. (14)-(15)
        GCO              min F_M(C) + w <W, C>           over C_i = V_i^T V_i, Eq. (16)-(19)
        with a prior     min |A pi - y|^2 + |x - s e|^2 / u^2,   GCO over C_i positive semi-definite

    with x the compliances in units of the prior, e their expectation, s their common scale and u their
    relative uncertainty. `testbench.identify.regression.f_m` computes F_M, and
    `testbench.identify.trace.learn_trace_penalty` learns the weight w of the trace <W, C>. The call
    `method(vjm, structure, data)` returns an `Estimate`. `least_squares`, `gco`, `paper_gco` and
    `completed_least_squares` are methods; `with_prior` and `robust` make a new method from one.
    """

    #: "none" for least squares, "psd" for GCO, "free" for least squares whose unobservable directions are
    #: chosen so that the model is conservative; "free" takes no prior.
    constraint: Constraint = "psd"
    prior: Prior | None = None  #: Expected compliances, up to a common scale; None for no prior.
    #: Relative uncertainty of the prior. None to learn it from the readings, with a scale per link and joint;
    #: with a robust loss None means `ROBUST_PRIOR_UNCERTAINTY`, since outliers would distort what is learnt.
    uncertainty: PriorUncertainty | None = None
    #: "robust" finds outliers by Huber's loss and fits without them.
    loss: Literal["plain", "robust"] = "plain"
    #: Weight w of the trace term w <W, C> that GCO without a prior adds to F_M [N m/rad]. The term acts as an
    #: exponential prior on compliances of links, of mean 1 / (w F_M N) rad/(N m) each for N points. None to
    #: learn w from held-out poses; 0 for the paper's GCO, which takes the least trace only among models that
    #: fit equally well.
    trace_weight: float | None = None

    def __post_init__(self) -> None:
        """Check that the constraint takes a prior, and the trace weight is at least 0; else BenchError."""
        if self.prior is not None and self.constraint == "free":
            raise BenchError(
                "prior: expected least squares or GCO; with a prior, no direction is left to complete"
            )
        if self.trace_weight is not None and not 0 <= self.trace_weight < np.inf:
            raise BenchError(f"trace_weight [N m/rad]: expected 0 or more, got {self.trace_weight}")

    def __call__(self, vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        """Identify the compliances of a structure from a dataset.

        Args:
            vjm: The arm's virtual joint model.
            structure: Structure of the unknown entries of C_theta. A prior, and GCO with a robust loss, need
                all entries of its blocks.
            data: The dataset: joints, loads, and positions without and with load [m].

        Returns:
            The estimate: parameters pi, C_theta, F_M, rank, status and certificate.

        Raises:
            BenchError: When an argument has another type, the dataset is empty or names a marker that the arm
                lacks, joints are not in radians or deflections not in metres, the structure is not symmetric
                where it must be, or the prior does not fit the structure or the data.
        """
        check_type(vjm, Vjm, "vjm")
        check_type(structure, Structure, "structure")
        check_type(data, (Dataset, Regression), "data")
        if isinstance(data, Dataset):
            check_deflections(vjm, data)
        unknowns = structure if self.learns_prior else remove_law_parameters(structure)
        reduced: GroupedRegression | Regression
        # To learn the trace weight, poses are held out: the equations stay in groups of poses.
        if self.learns_trace_weight and isinstance(data, Dataset):
            [reduced] = reduce_by_group(vjm, [unknowns], data, cross_validation_groups(data))
        else:
            reduced = reduce(vjm, unknowns, data)
        if self.loss == "plain":
            return self.fit_reduced(vjm, reduced)
        # Robust loss: the prior or the trace term is determined first, from all readings.
        regression = reduced.to_regression() if isinstance(reduced, GroupedRegression) else reduced
        held = self.scaled_prior(vjm, regression) or self.trace_penalty(vjm, reduced)
        return without_outliers(vjm, data, regression, self.constraint, held)

    def fit_reduced(
        self, vjm: Vjm, equations: GroupedRegression | Regression, *, for_intervals: bool = True
    ) -> Estimate:
        """Identify compliances from weighted equations (13); a robust loss is not applied.

        Args:
            vjm: The arm's virtual joint model.
            equations: The weighted equations; in groups of poses if a trace weight is learnt.
            for_intervals: Whether intervals are needed. If not, the uncertainty of a learnt prior is not
                computed, and a second prior with weaker coupling is not averaged with the first.

        Raises:
            BenchError: When the prior does not fit the structure or the data.
        """
        regression = equations.to_regression() if isinstance(equations, GroupedRegression) else equations
        if self.learns_prior and self.prior is not None:
            # Learnt prior: average models by their evidence, also over a prior with weaker coupling.
            scaling = scale_by_prior(self.prior, vjm, regression.structure)
            if not for_intervals or not regression.structure.n_laws:
                return average_models(regression, self.constraint, scaling, for_intervals=for_intervals)
            other = scale_by_prior(with_weaker_coupling(self.prior), vjm, regression.structure)
            return average_two_priors(regression, self.constraint, scaling, other)
        # With a stated uncertainty, or no prior, there is no evidence for joint laws: they are left out.
        if regression.structure.n_laws:
            equations = regression = restrict_regression(
                regression, remove_law_parameters(regression.structure)
            )
        held = self.scaled_prior(vjm, regression) or self.trace_penalty(vjm, equations)
        return solve(regression, self.constraint, held)

    @property
    def learns_prior(self) -> bool:
        """Tell whether the uncertainty of the prior and the sizes of joint laws are learnt from readings."""
        return self.prior is not None and self.uncertainty is None and self.loss == "plain"

    @property
    def learns_trace_weight(self) -> bool:
        """Tell whether the trace weight of GCO without a prior is learnt from held-out poses."""
        return self.constraint == "psd" and self.prior is None and self.trace_weight is None

    def trace_penalty(self, vjm: Vjm, equations: GroupedRegression | Regression) -> TracePenalty | None:
        """Return the trace term w <W, C> of GCO without a prior; learn its weight w if none is stated.

        Args:
            vjm: The arm's virtual joint model.
            equations: The weighted equations; in groups of poses if w is learnt.

        Returns:
            The term with w [N m/rad]; None where the method has no such term or w = 0.
        """
        if self.learns_trace_weight:
            return learn_trace_penalty(vjm, equations)
        if self.constraint != "psd" or self.prior is not None or not self.trace_weight:
            return None
        return trace_penalty(vjm, equations.structure, self.trace_weight)

    def scaled_prior(self, vjm: Vjm, regression: Regression) -> WeightedPrior | None:
        """Return the prior times the factor that fits the data best, with its stated uncertainty.

        Args:
            vjm: The arm's virtual joint model.
            regression: The weighted equations, which determine the factor.

        Returns:
            The prior for the parameters of the equations; None without a prior.

        Raises:
            BenchError: When the prior does not fit the structure or the data.
        """
        if self.prior is None:
            return None
        scaling = scale_by_prior(self.prior, vjm, regression.structure)
        return WeightedPrior(
            rescale_to_data(scaling, regression),
            self.uncertainty or PriorUncertainty(ROBUST_PRIOR_UNCERTAINTY),
        )


least_squares = Method("none")
"""Weighted least squares, Eq. (14)-(15): min |A pi - y|^2, of minimum norm along unobservable directions.

Call it as least_squares(vjm, structure, data) -> Estimate. Its matrices need not be conservative.
"""

completed_least_squares = Method("free")
"""Least squares made conservative along its unobservable directions, where that is possible.

Of all conservative models that fit as well as `least_squares`, it is the nearest to the solution of minimum
norm, in units of sensitivity. If there is none, it is that solution, and `Estimate.status` says so. It
separates two effects: the choice among equal fits, and the constraint of GCO.
"""

gco = Method("psd")
"""Gramian-constrained optimisation, solved to its global optimum with a certificate.

Call it as gco(vjm, structure, data) -> Estimate. It minimises F_M + w <W, C>, Eq. (19) and a weighted trace,
over conservative compliances C_i = V_i^T V_i. It learns w from held-out poses, see `Method.trace_weight`.
"""

paper_gco = Method("psd", trace_weight=0.0)
"""GCO as in the paper: min F_M, Eq. (19), over conservative compliances; of equal fits the least trace."""


def with_prior(estimator: Estimator, prior: Prior, uncertainty: PriorUncertainty | None = None) -> Method:
    """Make a method that combines the data with a prior: expected compliances and their uncertainty.

    Args:
        estimator: A `Method`, such as `gco`; an estimator of your own takes no prior.
        prior: Expected compliances, such as `cad_prior(arm)`.
        uncertainty: Relative uncertainty of the prior; None to learn it from the readings.

    Returns:
        The new method, which is called in the same way.

    Raises:
        BenchError: When the estimator is not a `Method`, or the prior or its uncertainty has another type.
    """
    if not isinstance(prior, Prior):
        raise BenchError(f"prior: expected one, such as cad_prior(arm), got {type(prior).__name__}")
    check_type(uncertainty, (PriorUncertainty, NoneType), "uncertainty")
    return replace(_as_method(estimator, "prior"), prior=prior, uncertainty=uncertainty)


def robust(estimator: Estimator) -> Method:
    """Make a method that finds outliers by Huber's loss and fits without them.

    Args:
        estimator: A `Method`, such as `gco`; an estimator of your own takes no other loss.

    Returns:
        A new method; `Estimate.rejected_readings` lists the readings that it leaves out.

    Raises:
        BenchError: When the estimator is not a `Method`.
    """
    return replace(_as_method(estimator, "robust loss"), loss="robust")


def _as_method(estimator: Estimator, what: str) -> Method:
    if isinstance(estimator, Method):
        return estimator
    name = getattr(estimator, "__name__", type(estimator).__name__)
    raise BenchError(f"{name}: your own estimator cannot be given a {what}")
