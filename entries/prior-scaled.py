"""The prior times one factor, which the readings tell: one unknown."""

import testbench as tb


def estimate(kinematics, structure, data, prior):
    """What is expected, in the scale of the readings, (n,)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    A, y = tb.reduce(kinematics, structure, data).weighted_equations
    expected = structure.parameters_of(prior.C_theta)
    moved = A @ expected
    return expected * (moved @ y) / (moved @ moved)
