"""Identification: least squares and GCO, one call shape (vjm, structure, dataset) -> Estimate."""

from testbench.identify.certify import certify
from testbench.identify.conic import gco
from testbench.identify.estimate import Certificate, Constraint, Estimate, Estimator, make_estimate
from testbench.identify.factorised import gco_factorised
from testbench.identify.least_squares import least_squares
from testbench.identify.regression import Regression, reduce
from testbench.identify.search import Budget, gco_paper

__all__ = [
    "Budget",
    "Certificate",
    "Constraint",
    "Estimate",
    "Estimator",
    "Regression",
    "certify",
    "gco",
    "gco_factorised",
    "gco_paper",
    "least_squares",
    "make_estimate",
    "reduce",
]
