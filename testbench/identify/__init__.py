"""Identification: least squares and GCO, one call shape (vjm, structure, dataset) -> Estimate."""

from testbench.identify.certify import certify
from testbench.identify.estimate import Certificate, Constraint, Estimate, Estimator, make_estimate
from testbench.identify.fold import reduce
from testbench.identify.method import Method, completed_least_squares, gco, least_squares, robust, with_prior
from testbench.identify.posterior import intervals
from testbench.identify.regression import Regression

__all__ = [
    "Certificate",
    "Constraint",
    "Estimate",
    "Estimator",
    "Method",
    "Regression",
    "certify",
    "completed_least_squares",
    "gco",
    "intervals",
    "least_squares",
    "make_estimate",
    "reduce",
    "robust",
    "with_prior",
]
