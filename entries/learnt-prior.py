"""GCO of all links and joints with a learnt prior: the default of identify without laws of joints."""

import numpy as np

import testbench as tb
from testbench.identify.posterior import posterior_of_estimate


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,), and their covariance, (n, n)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    found = tb.with_prior(tb.gco, prior)(kinematics, structure, data)
    return found.pi, posterior_of_estimate(found).covariance(np.eye(structure.n_parameters))
