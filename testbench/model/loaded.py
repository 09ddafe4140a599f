"""The loaded stiffness of Eq. (7), on the model side, batched over runs.

The springs are at rest at theta = 0, links weigh nothing, and the load is one wrench at the tool. Under it
the arm rests where K_theta theta = J_theta(theta)^T w; the tangent there is K_theta - K_w, with K_w the
change of the load's generalised force with theta. Compliances are used, never their inverses: a stiff
direction is a zero in C_theta.
"""

import numpy as np

from testbench.errors import Array, Ids, NoEquilibrium, check_array
from testbench.model.vjm import Chain, Vjm, chain, cross, generalised_load, translation_rows


def geometric_stiffness(where: Chain, wrench: Array, point: Array) -> Array:
    """Force term K_w = d(J_theta^T w) / d theta of Eq. (7), in closed form.

    A joint i carries all that lies behind it. So for i before j in the chain, or i = j, the column J_v,j
    turns with i: d J_v,j / d theta_i = omega_i x J_v,j, and the change of J_v,i with theta_j is the same. A
    force of fixed direction therefore has a symmetric K_w, the Hessian of its potential g^T f. A moment of
    fixed direction has none: omega_j turns with i, but omega_i does not turn with j. Such a moment is not
    conservative, and its part of K_w is not symmetric.

    Returns:
        Row j, column i holds d(J_j^T w) / d theta_i, (runs, n_theta, n_theta) [N/m, N, N m].
    """
    runs = len(where.position)
    wrench = check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = check_array(point, (runs, 3), "point [m]")
    J, turns = load_jacobian(where, point), where.J_theta[3:]
    v, omega = J[:, :3], J[:, 3:].swapaxes(1, 2)
    of_force, of_moment = (cross(part.T[:, None], turns).transpose(2, 1, 0) for part in np.hsplit(wrench, 2))
    forces = of_force @ v  # [i, j]: f . (omega_i x J_v,j)
    moments = omega @ of_moment.swapaxes(1, 2)  # [j, i]: m . (omega_i x omega_j)
    rank = _rank_in_chain(J.shape[2])
    behind = rank[:, None] > rank
    return np.where(behind, forces.swapaxes(1, 2) + moments, forces)


def _rank_in_chain(n_theta: int) -> Ids:
    """Place of every virtual joint in the chain: the hinges of joints are last in theta, not in the chain."""
    n = (n_theta - 6) // 7
    links = 7 * np.arange(n + 1)[:, None] + np.arange(6)
    return np.concatenate([links.ravel(), 7 * np.arange(n) + 6])


def load_jacobian(where: Chain, point: Array) -> Array:
    """Jacobian J_theta at the point where the load acts, Eq. (3).

    Returns:
        Translation rows first, world axes, (runs, 6, n_theta) [1, m].
    """
    point = check_array(point, (len(where.position), 3), "point [m]")
    arm, (v, omega) = np.einsum("rxy,ry->xr", where.rotation, point), np.split(where.J_theta, 2)
    J = np.concatenate([v + cross(omega, arm[:, None]), omega])
    return np.ascontiguousarray(J.transpose(2, 0, 1))


def loaded_compliance(J_theta: Array, C_theta: Array, K_w: Array) -> Array:
    """Cartesian compliance of the loaded arm, Eq. (7) as J (I - C_theta K_w)^-1 C_theta J^T.

    Equal to J (K_theta - K_w)^-1 J^T where K_theta exists. With J and K_w at the loaded equilibrium it is the
    tangent there: d(twist) = C d(wrench). With K_w = 0 it is Eq. (6). C_theta may be one or one a run.

    Returns:
        (runs, 6, 6) [m/N, rad/N, rad/(N m)].

    Raises:
        NoEquilibrium: When the load is exactly a buckling load.
    """
    J = check_array(J_theta, (None, 6, None), "J_theta [1, m]")
    runs, _, n_theta = J.shape
    every = np.shape(C_theta)[:-2]
    C = check_array(C_theta, (*every, n_theta, n_theta), "C_theta [m/N, rad/(N m)]")
    K_w = check_array(K_w, (runs, n_theta, n_theta), "K_w [N/m, N, N m]")
    return np.asarray(J @ _solve_springs(C, K_w, C @ J.swapaxes(1, 2)))


def _solve_springs(C_theta: Array, K_w: Array, right: Array) -> Array:
    """(I - C_theta K_w)^-1 right, (runs, n_theta, columns)."""
    try:
        return np.asarray(np.linalg.solve(np.eye(C_theta.shape[-1]) - C_theta @ K_w, right))
    except np.linalg.LinAlgError:
        raise NoEquilibrium("K_theta - K_w is singular: the arm buckles under this load") from None


def secant(where: Chain, C_theta: Array, wrench: Array, point: Array, K_w: Array | None = None) -> Array:
    """Virtual joints if one stiffness held for the whole load: Eq. (6), or Eq. (7) where K_w is given.

    Returns:
        (runs, n_theta) [m, rad] of the unloaded chain; `displacement` makes deflections of them.

    Raises:
        NoEquilibrium: When the load is exactly a buckling load.
    """
    n_theta, runs = where.J_theta.shape[1:]
    C = check_array(C_theta, (n_theta, n_theta), "C_theta [m/N, rad/(N m)]")
    theta = (C @ generalised_load(where, wrench, point)).T
    if K_w is not None:
        K_w = check_array(K_w, (runs, n_theta, n_theta), "K_w [N/m, N, N m]")
        theta = _solve_springs(C, K_w, theta[..., None])[..., 0]
    return np.asarray(theta)


def displacement(where: Chain, theta: Array, targets: Array) -> Array:
    """How far points of the tool move to first order, world axes, (runs, m, 3) [m]."""
    targets = check_array(targets, (None, 3), "targets [m]")
    moved = np.einsum("ptr,rt->rp", translation_rows(where, targets), theta)
    return np.asarray(moved.reshape(len(theta), len(targets), 3))


def loaded_deflection(vjm: Vjm, q: Array, theta: Array, targets: Array) -> Array:
    """How far points of the tool have moved from theta = 0, without linearisation.

    Returns:
        World axes, (runs, m, 3) [m].
    """
    targets = check_array(targets, (None, 3), "targets [m]")
    start, end = chain(vjm, q), chain(vjm, q, theta)
    turned = np.einsum("rxy,py->rpx", end.rotation - start.rotation, targets)
    return np.asarray((end.position - start.position)[:, None] + turned)
