"""The equilibrium of a weightless arm under a load by Newton's method with Eq. (7), and whether it is stable.

The judge of the study and of the tests: products take `equilibrium`, whose fixed-point steps need no tangent.
"""

import numpy as np
import numpy.typing as npt

from testbench.errors import Array, NoEquilibrium, check_array
from testbench.model.loaded import geometric_stiffness, solve_springs
from testbench.model.vjm import Chain, Vjm, chain, generalised_load

STEP_TOLERANCE = 1e-10
"""A pose is in equilibrium after a Newton step below this [m, rad]; the next would be rounding."""
MAX_ITERATIONS = 50
MAX_STEP = 0.5  #: A Newton step beyond this [m, rad] leads to no elastic deflection.


def loaded_equilibrium(vjm: Vjm, C_theta: Array, q: Array, wrench: Array, point: Array) -> Array:
    """The non-linear VJM of a weightless arm: theta = C_theta J_theta(theta)^T w, by Newton with Eq. (7).

    Returns:
        Virtual joint coordinates at rest, (runs, n_theta) [m, rad].

    Raises:
        NoEquilibrium: When Newton does not converge, or to an unstable pose only; names the pose.
    """
    n_theta = vjm.arm.n_theta
    q = check_array(q, (None, vjm.arm.n_joints), "q [rad, m]")
    C = check_array(C_theta, (n_theta, n_theta), "C_theta [m/N, rad/(N m)]")
    wrench = check_array(wrench, (len(q), 6), "wrench [N, N m]")
    point = check_array(point, (len(q), 3), "point [m]")
    theta, step = np.zeros((len(q), n_theta)), np.zeros(len(q))
    iterations = np.zeros(len(q), dtype=int)
    moving = np.arange(len(q))
    while len(moving):
        where = chain(vjm, q[moving], theta[moving])
        left = _newton_step(where, C, wrench[moving], point[moving], theta[moving])
        theta[moving] += left
        step[moving] = np.linalg.norm(left, axis=1)
        iterations[moving] += 1
        lost = moving[~(step[moving] < MAX_STEP) | (iterations[moving] >= MAX_ITERATIONS)]
        if len(lost):
            problem = f"no static equilibrium in {iterations[lost[0]]} Newton steps"
            raise _no_equilibrium(problem, vjm.arm.words(q[lost[0]]), wrench[lost[0]])
        moving = moving[step[moving] >= STEP_TOLERANCE]
    buckled = np.flatnonzero(~_stable(chain(vjm, q, theta), C, wrench, point))
    if len(buckled):
        raise _no_equilibrium(
            "only an unstable equilibrium", vjm.arm.words(q[buckled[0]]), wrench[buckled[0]]
        )
    return theta


def _newton_step(where: Chain, C: Array, wrench: Array, point: Array, theta: Array) -> Array:
    """(I - C_theta K_w)^-1 (C_theta J_theta^T w - theta), (runs, n_theta) [m, rad]."""
    unbalanced = (C @ generalised_load(where, wrench, point)).T - theta
    return solve_springs(C, geometric_stiffness(where, wrench, point), unbalanced[..., None])[..., 0]


def _stable(where: Chain, C: Array, wrench: Array, point: Array) -> npt.NDArray[np.bool_]:
    """Whether K_theta - K_w has only eigenvalues above zero, (runs,); I - C_theta K_w shares their signs."""
    K_w = geometric_stiffness(where, wrench, point)
    eigenvalues = np.linalg.eigvals(np.eye(len(C)) - C @ K_w)
    return np.asarray(eigenvalues.real.min(axis=1, initial=np.inf) > 0)


def _no_equilibrium(problem: str, q: str, wrench: Array) -> NoEquilibrium:
    return NoEquilibrium(
        f"{problem} at q = {q} under wrench "
        f"{wrench.round(1).tolist()} N, N m: too soft for its load, or buckled"
    )
