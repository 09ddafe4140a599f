"""Random poses of an arm, and the payload that hangs from it in them."""

import numpy as np

GRAVITY = 9.81


def random_q(cell, rng, runs):
    return rng.uniform(*cell.arm.limits, (runs, cell.arm.n_joints))


def hung(cell, runs, mass=460.3):
    """A hung mass as the truth has it: wrench, (runs, 6) [N, N m], and where it acts, (runs, 3) [m]."""
    wrench = np.zeros((runs, 6))
    wrench[:, 2] = -GRAVITY * mass
    return wrench, np.tile(cell.plant.load, (runs, 1))
