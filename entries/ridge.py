"""Ridge regression of straight beams: shrunk to zero, how much by generalised cross-validation."""

from testbench.model.structure import template56
from testbench.studies.intervals import ridge


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,)."""
    return structure.parameters_of(ridge(kinematics, template56(kinematics.arm), data).C_theta)
