"""A robust loss: outliers are found and left out; with the prior where there is one."""

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,): of straight beams without a prior."""
    if not isinstance(data, tb.Dataset):
        raise NotImplementedError("needs single readings")
    method = tb.robust(tb.least_squares)
    if prior is not None:
        return tb.with_prior(method, prior)(kinematics, structure, data).pi
    beams = template56(kinematics.arm)
    return structure.parameters_of(beams.C_theta_of(method(kinematics, beams, data).pi))
