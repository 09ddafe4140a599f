"""GCO with a log-determinant prior: no compliance becomes zero, however little the readings ask for it."""

import testbench as tb
from testbench.identify.prior import PriorUncertainty, rescale_to_data, scale_by_prior
from testbench.studies.intervals import gco_stein


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    regression = tb.reduce(kinematics, structure, data)
    own = rescale_to_data(scale_by_prior(prior, kinematics, structure), regression)
    return gco_stein(regression, own, PriorUncertainty(0.3)).pi
