"""Identification of link and joint compliances from deflections: least squares, GCO, priors, intervals.

Every method has one call shape, (vjm, structure, dataset) -> Estimate. It stands between the readings
(`testbench.data`) and predictions or corrections (`testbench.correct`).
"""

from testbench.identify.conic import certify as certify
from testbench.identify.estimate import Constraint as Constraint
from testbench.identify.estimate import Estimate as Estimate
from testbench.identify.estimate import Estimator as Estimator
from testbench.identify.estimate import make_estimate as make_estimate
from testbench.identify.method import Method as Method
from testbench.identify.method import completed_least_squares as completed_least_squares
from testbench.identify.method import gco as gco
from testbench.identify.method import least_squares as least_squares
from testbench.identify.method import paper_gco as paper_gco
from testbench.identify.method import robust as robust
from testbench.identify.method import with_prior as with_prior
from testbench.identify.posterior import intervals as intervals
from testbench.identify.regression import Regression as Regression
from testbench.identify.regression import reduce as reduce
