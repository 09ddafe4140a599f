"""Least squares of all links and joints with the prior; the readings tell how wrong it is."""

import testbench as tb


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    return tb.with_prior(tb.least_squares, prior)(kinematics, structure, data).pi
