"""Stiffness of the loaded arm, Eq. (7), on the model side, batched over runs.

The springs are at rest at theta = 0, links weigh nothing, and the load is one wrench at the tool. Under it
the arm rests where K_theta theta = J_theta(theta)^T w. The tangent there is K_theta - K_w, with K_w the
derivative of the generalised load with respect to theta. Formulas use compliances and never invert C_theta: a
rigid direction is a zero in C_theta.
"""

import numpy as np

from testbench.errors import Array, Ids, NoEquilibrium, check_array
from testbench.model.vjm import Chain, Vjm, chain, cross, generalised_load, translation_rows


def geometric_stiffness(chain: Chain, wrench: Array, point: Array) -> Array:
    """Compute the force term K_w = d(J_theta^T w) / d theta of Eq. (7), in closed form.

    A virtual joint i carries everything behind it in the chain. So for i before j in the chain, or i = j, the
    column J_v,j turns with i: d J_v,j / d theta_i = omega_i x J_v,j. The derivative of J_v,i with respect to
    theta_j is the same. A force of fixed direction therefore has a symmetric K_w, the Hessian of its
    potential g^T f. A moment of fixed direction has none: omega_j turns with i, but omega_i does not turn
    with j. Such a moment is not conservative, and its part of K_w is not symmetric.

    Mathematics: `loaded-3`.

    Args:
        chain: Tool and Jacobian of every run, without joint laws.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].

    Returns:
        K_w, (runs, n_theta, n_theta) [N/m, N, N m]; row j, column i holds d(J_j^T w) / d theta_i.

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    runs = len(chain.position)
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    J, turns = load_jacobian(chain, point), chain.J_theta[3:]
    v, omega = J[:, :3], J[:, 3:].swapaxes(1, 2)
    of_force, of_moment = (cross(part.T[:, None], turns).transpose(2, 1, 0) for part in np.hsplit(wrench, 2))
    forces = of_force @ v  # [i, j]: f . (omega_i x J_v,j)
    moments = omega @ of_moment.swapaxes(1, 2)  # [j, i]: m . (omega_i x omega_j)
    # joint j behind i: column j turns with i, so row j also holds f . (omega_i x J_v,j) and the moment's part
    rank = _rank_in_chain(J.shape[2])
    behind = rank[:, None] > rank
    return np.where(behind, forces.swapaxes(1, 2) + moments, forces)


def _rank_in_chain(n_theta: int) -> Ids:
    """Return the place of every virtual joint in the chain, (n_theta,).

    In theta the springs of the actuated joints come last; in the chain each stands between two links.
    """
    n = (n_theta - 6) // 7
    links = 7 * np.arange(n + 1)[:, None] + np.arange(6)
    return np.concatenate([links.ravel(), 7 * np.arange(n) + 6])


def load_jacobian(chain: Chain, point: Array) -> Array:
    """Compute the Jacobian J_theta = dg / d theta of Eq. (2) at the point where the load acts.

    Args:
        chain: Tool and Jacobian of every run.
        point: Where the load acts, in the tool's frame, (runs, 3) [m].

    Returns:
        J_theta, translation rows first, world axes, (runs, 6, n_theta) [1, m].

    Raises:
        BenchError: When point has another shape or is not finite.
    """
    point = check_array(point, (len(chain.position), 3), "point [m]")
    arm, (v, omega) = np.einsum("rxy,ry->xr", chain.rotation, point), np.split(chain.J_theta, 2)
    J = np.concatenate([v + cross(omega, arm[:, None]), omega])
    return np.ascontiguousarray(J.transpose(2, 0, 1))


def loaded_compliance(J_theta: Array, C_theta: Array, K_w: Array) -> Array:
    """Compute the Cartesian compliance of the loaded arm, Eq. (7) as C = J (I - C_theta K_w)^-1 C_theta J^T.

    This equals J (K_theta - K_w)^-1 J^T where K_theta exists. With J and K_w at the loaded equilibrium it is
    the tangent there: d(twist) = C d(wrench). With K_w = 0 it is Eq. (6), C = J C_theta J^T.

    Mathematics: `loaded-4`.

    Args:
        J_theta: Jacobian of the virtual joints, translation first, (runs, 6, n_theta) [1, m].
        C_theta: Compliance of the virtual joints, (n_theta, n_theta) or (runs, n_theta, n_theta) [m/N, rad/N,
            rad/(N m)].
        K_w: Force term of Eq. (7), (runs, n_theta, n_theta) [N/m, N, N m].

    Returns:
        Compliance C, (runs, 6, 6) [m/N, rad/N, rad/(N m)].

    Raises:
        NoEquilibrium: When K_theta - K_w is exactly singular: the load is a buckling load.
        BenchError: When an array has another shape or is not finite.
    """
    J = check_array(J_theta, (None, 6, None), "J_theta [1, m]")
    runs, _, n_theta = J.shape
    every = np.shape(C_theta)[:-2]
    C = check_array(C_theta, (*every, n_theta, n_theta), "C_theta [m/N, rad/(N m)]")
    K_w = check_array(K_w, (runs, n_theta, n_theta), "K_w [N/m, N, N m]")
    return np.asarray(J @ _solve_springs(C, K_w, C @ J.swapaxes(1, 2)))


def _solve_springs(C_theta: Array, K_w: Array, right: Array) -> Array:
    """Solve (I - C_theta K_w) x = right, (runs, n_theta, columns)."""
    try:
        return np.asarray(np.linalg.solve(np.eye(C_theta.shape[-1]) - C_theta @ K_w, right))
    except np.linalg.LinAlgError:
        raise NoEquilibrium("K_theta - K_w is singular: the arm buckles under this load") from None


def secant(chain: Chain, C_theta: Array, wrench: Array, point: Array, K_w: Array | None = None) -> Array:
    """Compute virtual joints as if the stiffness of theta = 0 held for the whole load, Eq. (5) to (7).

    Without K_w, theta = C_theta J^T w, Eq. (6). With it, theta = (I - C_theta K_w)^-1 C_theta J^T w, Eq. (7).

    Mathematics: `loaded-5`, `vjm-7`.

    Args:
        chain: Tool and Jacobian of every run, the springs at zero.
        C_theta: Compliance of the virtual joints, (n_theta, n_theta) [m/N, rad/N, rad/(N m)].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].
        K_w: Force term of Eq. (7), (runs, n_theta, n_theta) [N/m, N, N m]; None for Eq. (6).

    Returns:
        Virtual joint coordinates, (runs, n_theta) [m, rad]; `displacement` makes deflections of them.

    Raises:
        NoEquilibrium: When K_theta - K_w is exactly singular: the load is a buckling load.
        BenchError: When an array has another shape or is not finite.
    """
    n_theta, runs = chain.J_theta.shape[1:]
    C = check_array(C_theta, (n_theta, n_theta), "C_theta [m/N, rad/(N m)]")
    theta = (C @ generalised_load(chain, wrench, point)).T
    if K_w is not None:
        K_w = check_array(K_w, (runs, n_theta, n_theta), "K_w [N/m, N, N m]")
        theta = _solve_springs(C, K_w, theta[..., None])[..., 0]
    return np.asarray(theta)


def displacement(chain: Chain, theta: Array, targets: Array) -> Array:
    """Compute deflections of points of the tool to first order, dp = J_p theta.

    Mathematics: `vjm-8`.

    Args:
        chain: Tool and Jacobian of every run.
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad].
        targets: Points in the tool's frame, (m, 3) [m].

    Returns:
        Deflections, world axes, (runs, m, 3) [m].

    Raises:
        BenchError: When targets have another shape or are not finite.
    """
    targets = check_array(targets, (None, 3), "targets [m]")
    moved = np.einsum("ptr,rt->rp", translation_rows(chain, targets), theta)
    return np.asarray(moved.reshape(len(theta), len(targets), 3))


def loaded_deflection(vjm: Vjm, q: Array, theta: Array, targets: Array) -> Array:
    """Compute deflections of points of the tool from theta = 0 to theta by Eq. (2), without linearisation.

    Mathematics: `loaded-2`.

    Args:
        vjm: Kinematics of the extended chain.
        q: Actuated joints, (runs, n) [rad, m].
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad].
        targets: Points in the tool's frame, (m, 3) [m].

    Returns:
        Deflections, world axes, (runs, m, 3) [m].

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    targets = check_array(targets, (None, 3), "targets [m]")
    start, end = chain(vjm, q), chain(vjm, q, theta)
    turned = np.einsum("rxy,py->rpx", end.rotation - start.rotation, targets)
    return np.asarray((end.position - start.position)[:, None] + turned)
