"""Algebraic reduction of a structure to non-redundant parameters: MLS56 becomes MLS32."""

import numpy as np
from scipy.linalg import qr

from testbench.errors import Array
from testbench.identify.regression import rank
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, chain, observation, rotation_observation

GENERIC_RUNS = 60  #: Random runs of a full wrench, read in full pose: they see all that any experiment can.


def generic_rows(vjm: Vjm, structure: Structure) -> Array:
    """Observation matrix, Eq. (12), of an experiment that sees all that any can: positions, then rotations.

    Random poses within the joint limits, a random full wrench at a random point, the full pose read, (rows,
    n). Its rank is generic: it does not depend on the draw.
    """
    rng = np.random.Generator(np.random.Philox(0))
    lower, upper = vjm.arm.limits
    q = rng.uniform(lower, upper, (GENERIC_RUNS, vjm.arm.n_joints))
    wrench, point = rng.standard_normal((GENERIC_RUNS, 6)), rng.standard_normal((GENERIC_RUNS, 3))
    args = (chain(vjm, q), structure, wrench, point)
    moved, turned = observation(*args, vjm.markers), rotation_observation(*args)
    return np.concatenate([rows.reshape(-1, structure.n) for rows in (moved, turned)])


def non_redundant(vjm: Vjm, structure: Structure, *, name: str) -> Structure:
    """The structure without the parameters whose columns the others span in every experiment.

    Columns are chosen by QR with pivoting of a generic observation matrix; a dropped parameter is zero, and
    what it did is regrouped into the kept ones (Klimchik et al.; Khalil and Gautier's base parameters).
    """
    A = generic_rows(vjm, structure)
    A = A / np.linalg.norm(A, axis=0)
    _, order = qr(A, mode="r", pivoting=True)
    return structure.keep(np.sort(order[: rank(A)]), name)
