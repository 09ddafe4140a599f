"""The prior alone: no reading is used."""


def estimate(kinematics, structure, data, prior):
    """What is expected, (n,)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    return structure.parameters_of(prior.C_theta)
