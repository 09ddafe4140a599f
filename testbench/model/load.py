"""Loads on the virtual joints: hung weights, process forces, own weight; stiffness under load, Eq. (7).

A `Load` is a wrench w and the point where it acts. `sum_generalised_loads` converts loads to the
generalised loads J^T w of Eq. (10), for the linear model and for the equilibrium.

Own weight loads every virtual joint before a body in the chain by J^T m g. Masses and centres of mass come
from rigid.xml. J^T m g is linear in each body's mass and first moments, mass times centre, so that
calibration can fit them too.

The stiffness under load is that of an arm of weightless links under one wrench at the tool. Its springs are
relaxed at theta = 0, and it rests where K_theta theta = J_theta(theta)^T w. The tangent there is
K_theta - K_w, with K_w the derivative of the generalised load with respect to theta. Formulas use compliances
and never invert C_theta, because a rigid direction is a zero in C_theta.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY, angle_unit, attribute_numbers, find_body, read_mjcf
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, InputError, NoEquilibrium, check_array, check_type
from testbench.model.kinematics import body_pose
from testbench.model.vjm import (
    ChainState,
    Vjm,
    append_law_unit_deflections,
    cross,
    evaluate_chain,
    generalised_load,
    generalised_load_without_laws,
    translational_jacobian,
)

# --- Loads at the tool, and their generalised loads on the virtual joints -----------------------------------


@dataclass(frozen=True, repr=False)
class Load(Displayed):
    """Describe a wrench at the tool: one for all poses, or one per pose.

    `wrench`, (6,) or (poses, 6) [N, N m], is in world axes, force first. It acts at `point` of the tool's
    frame, (3,) or (poses, 3) [m].
    """

    wrench: Array  #: Force and moment, world axes, (6,) or (poses, 6) [N, N m].
    point: Array  #: Where it acts, in the tool's frame, (3,) or (poses, 3) [m].

    def for_poses(self, n_poses: int) -> "Load":
        """Expand the load to one row per pose.

        Args:
            n_poses: Number of poses.

        Returns:
            Load with wrench (poses, 6) [N, N m] and point (poses, 3) [m].

        Raises:
            BenchError: When it has rows for another number of poses, or a number that is not finite.
        """
        try:
            wrench, point = (
                np.broadcast_to(self.wrench, (n_poses, 6)),
                np.broadcast_to(self.point, (n_poses, 3)),
            )
        except ValueError:
            shapes = f"{np.shape(self.wrench)} and {np.shape(self.point)}"
            problem = f"expected a wrench and a point, or one for each of {n_poses} poses, got {shapes}"
            raise BenchError(f"load: {problem}") from None
        check_array(wrench, (n_poses, 6), "wrench [N, N m]")
        check_array(point, (n_poses, 3), "point [m]")
        return Load(wrench, point)

    def select(self, pose_indices: slice | Ids) -> "Load":
        """Select some poses from a load that has one row per pose.

        Args:
            pose_indices: Indices of the poses, (k,), or a slice.

        Returns:
            Load with one row for each of them.
        """
        return Load(self.wrench[pose_indices], self.point[pose_indices])


def weight(vjm: Vjm, mass: float | Array) -> Load:
    """Make the load of a mass hung from the arm's load point: force -m g along world z.

    Args:
        vjm: Kinematics, for the load point.
        mass: Mass, one number or one per pose, (poses,) [kg].

    Returns:
        The load: wrench (6,) or (poses, 6) [N, N m], point (3,) or (poses, 3) [m].

    Raises:
        BenchError: When an argument has another type, or a mass is negative or not finite.
    """
    check_type(vjm, Vjm, "vjm")
    mass = check_array(mass, (None,) * np.ndim(mass), "mass [kg]")
    if (mass < 0).any():
        raise BenchError(f"mass [kg]: expected 0 or more, got {mass.min():g}")
    wrench = np.zeros((*np.shape(mass), 6))
    wrench[..., 2] = -GRAVITY * mass
    return Load(wrench, np.broadcast_to(vjm.load_point, (*np.shape(mass), 3)))


def resultant_wrench(tool_rotation: Array, loads: Sequence[Load]) -> Array:
    """Sum all loads to one wrench, its moment about the tool's origin.

    Args:
        tool_rotation: Orientation of the tool, world from tool, (poses, 3, 3) [1].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Force and moment, world axes, (poses, 6) [N, N m].

    Raises:
        BenchError: When a load has rows for another number of poses.
    """
    total = np.zeros((len(tool_rotation), 6))
    for load in loads:
        expanded = load.for_poses(len(total))
        lever = np.matvec(tool_rotation, expanded.point)
        total[:, :3] += expanded.wrench[:, :3]
        total[:, 3:] += expanded.wrench[:, 3:] + np.cross(lever, expanded.wrench[:, :3])
    return total


def sum_generalised_loads(chain: ChainState, loads: Sequence[Load]) -> Array:
    """Sum the generalised loads J_F^T w of all loads on every virtual joint, Eq. (10).

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        loads: Loads that act together, each with one row per run.

    Returns:
        Load of every virtual joint, (n_theta, runs) [N, N m]; for a joint law the deflection per unit of its
        size [rad, m].

    Raises:
        BenchError: When a load does not have one row per run.
    """
    u = np.zeros((7 * len(chain.body_frames) - 8, len(chain.tool_position)))
    for load in loads:
        u += generalised_load_without_laws(chain, load.wrench, load.point)
    return append_law_unit_deflections(chain, u)


@dataclass(frozen=True)
class BodyMasses:
    """Hold masses and centres of mass of the arm's n + 2 bodies: links from the base on, then the tool.

    The mass of a body includes everything that is fixed to it.
    """

    mass: Array  #: Mass, (bodies,) [kg].
    centre_of_mass: Array  #: Centre of mass in the body's own axes, (bodies, 3) [m].

    @property
    def inertial_parameters(self) -> Array:
        """Return mass and first moments m, m c_x, m c_y, m c_z of every body, (bodies, 4) [kg, kg m]."""
        return np.column_stack([self.mass, self.mass[:, None] * self.centre_of_mass])


def massless_bodies(arm: Arm) -> BodyMasses:
    """Make masses and centres of mass of zero for all n + 2 bodies of an arm."""
    return BodyMasses(np.zeros(arm.n_joints + 2), np.zeros((arm.n_joints + 2, 3)))


def read_body_masses(arm: Arm) -> BodyMasses:
    """Read masses and centres of mass from an arm's MJCF.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        Masses and centres of the links and the tool, with all bodies fixed to them.

    Raises:
        InputError: When MuJoCo would compute a mass from shapes, which this function does not do.
    """
    root = read_mjcf(arm.mjcf_path)
    from_shapes = [c.get("inertiafromgeom", "auto") for c in root.iter("compiler")][-1:] or ["auto"]
    if from_shapes == ["true"]:
        problem = "expected masses in <inertial>, got inertiafromgeom='true'"
        raise InputError(arm.mjcf_path, "<compiler>", problem)
    names = [*(link.name for link in arm.links), arm.tool]
    bodies = [find_body(arm.mjcf_path, root, name) for name in names]
    light = _light_shapes(arm, root) if from_shapes == ["auto"] else set(root.iter("geom"))
    every = [
        sum(
            (_mass_and_moments(arm, part, light, T) for part, T in _fixed_bodies(arm, root, body, bodies)),
            np.zeros(4),
        )
        for body in bodies
    ]
    mass, moment = np.split(np.array(every), [1], axis=1)
    return BodyMasses(mass[:, 0], moment / np.where(mass > 0, mass, 1))


def read_body_masses_with_note(arm: Arm) -> tuple[BodyMasses, list[str]]:
    """Read masses and centres of mass of an arm; if they cannot be read, return zeros and a note about it."""
    try:
        return read_body_masses(arm), []
    except InputError as err:
        return massless_bodies(arm), [f"Own weight is left out: {err}"]


def _fixed_bodies(
    arm: Arm, root: ET.Element, body: ET.Element, chain_bodies: list[ET.Element]
) -> Iterator[tuple[ET.Element, Array]]:
    """Yield a body and all bodies fixed to it, each with its pose in the body, (4, 4) [1, m]."""
    pending = [(body, np.eye(4))]
    while pending:
        part, pose = pending.pop()
        yield part, pose
        children = [child for child in part.findall("body") if child not in chain_bodies]
        pending += [(child, pose @ body_pose(arm, child, angle_unit(root))) for child in children]


def _mass_and_moments(arm: Arm, body: ET.Element, light: set[ET.Element], pose: Array) -> Array:
    """Read mass and first moments of one body in the axes of the one it is fixed to, (4,) [kg, kg m]."""
    inertial = body.find("inertial")
    if inertial is not None:
        [mass] = attribute_numbers(arm.mjcf_path, inertial, "mass", 1)
        centre = pose @ [*attribute_numbers(arm.mjcf_path, inertial, "pos", 3), 1.0]
        return mass * np.array([1.0, *centre[:3]])
    if not light.issuperset(body.findall("geom")):
        problem = "expected an <inertial>, or shapes of mass 0: MuJoCo would take the mass from its shapes"
        raise InputError(arm.mjcf_path, f"<body name={body.get('name')!r}>", problem)
    return np.zeros(4)


def _light_shapes(arm: Arm, root: ET.Element) -> set[ET.Element]:
    """Find the shapes whose mass is zero, by their own attribute or by that of their class."""
    above = {child: parent for parent in root.iter() for child in parent}
    classes = {d.get("class", "main"): d for d in root.iter("default")}

    def mass_element(geom: ET.Element) -> ET.Element | None:
        """Find the element that states the mass of a shape: itself, its class, or a parent class."""
        if "mass" in geom.attrib:
            return geom
        body = above[geom]
        while "childclass" not in body.attrib and body in above:
            body = above[body]
        default = classes.get(geom.get("class", body.get("childclass", "main")))
        while default is not None and default.tag == "default":
            if (class_geom := default.find("geom")) is not None and "mass" in class_geom.attrib:
                return class_geom
            default = above.get(default)
        return None

    where = {geom: mass_element(geom) for geom in root.iter("geom")}
    return {
        geom
        for geom, e in where.items()
        if e is not None and attribute_numbers(arm.mjcf_path, e, "mass", 1) == [0.0]
    }


def own_weight_matrix(chain: ChainState) -> Array:
    """Compute the generalised load of own weight per unit of mass and of first moment of every body.

    For a virtual joint t that carries body k with origin p and axes R these are J_t(p)^T g, and (omega_t x R
    e)^T g for e = x, y, z. All others are zero, also those of joint laws.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.

    Returns:
        Columns, (n_theta, runs, bodies, 4) [N/kg, N m/kg; N/(kg m), N m/(kg m)]; their sum times
        `BodyMasses.inertial_parameters` is `own_weight_load`.
    """
    _, n_theta, runs = chain.J_theta.shape
    # runs last: every product is one long loop
    columns = np.zeros((len(chain.body_frames), 4, n_theta, runs))
    for k, (p, R) in enumerate(chain.body_frames):
        # the Jacobian at the body's origin: v_z(p) = v_z + (omega x (p - tool))_z
        arm = p - chain.tool_position.T
        for rows in _carrying_joints(k, chain):
            v_z, (x, y) = chain.J_theta[2, rows], chain.J_theta[3:5, rows]
            columns[k, 0, rows] = v_z + x * arm[1] - y * arm[0]
            for axis in range(3):
                columns[k, 1 + axis, rows] = x * R[1, axis] - y * R[0, axis]
    columns *= -GRAVITY
    return columns.transpose(2, 3, 0, 1)


def _carrying_joints(body: int, chain: ChainState) -> tuple[slice, slice]:
    """Return slices of the virtual joints that carry a body: those of links, and those of joints."""
    links, joints = 6 * (len(chain.body_frames) - 1), len(chain.body_frames) - 2
    return slice(0, 6 * body), slice(links, links + min(body, joints))


def own_weight_load(chain: ChainState, body_masses: BodyMasses) -> Array:
    """Compute the load of every virtual joint under the arm's own weight, sum_k J_k^T m_k g.

    Everything behind a virtual joint pulls as one body: masses and moments are summed from the tool on. The
    base link lies before every virtual joint, so its mass loads none. Loads of joint laws are zero.

    Mathematics: `vjm-6`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        body_masses: Masses and centres of the bodies.

    Returns:
        Generalised loads, (n_theta, runs) [N, N m].
    """
    _, n_theta, runs = chain.J_theta.shape
    load = np.zeros((n_theta, runs))
    mass = 0.0
    moment = np.zeros((3, runs))
    for k in range(len(chain.body_frames) - 1, 0, -1):
        p, R = chain.body_frames[k]
        mass += body_masses.mass[k]
        moment += body_masses.mass[k] * (p - chain.tool_position.T + body_masses.centre_of_mass[k] @ R)
        links, joints = _carrying_joints(k, chain)
        for rows in (slice(links.stop - 6, links.stop), slice(joints.stop - 1, joints.stop)):
            v_z, (x, y) = chain.J_theta[2, rows], chain.J_theta[3:5, rows]
            load[rows] = -GRAVITY * (mass * v_z + x * moment[1] - y * moment[0])
    return load


# --- Stiffness of the loaded arm, Eq. (7), on the model side, batched over runs -----------------------------


def geometric_stiffness(chain: ChainState, wrench: Array, point: Array) -> Array:
    """Compute the force term K_w = d(J_theta^T w) / d theta of Eq. (7), in closed form.

    A virtual joint i carries everything behind it in the chain. So for i before j in the chain, or i = j, the
    column J_v,j turns with i: d J_v,j / d theta_i = omega_i x J_v,j. The derivative of J_v,i with respect to
    theta_j is the same. A force of fixed direction therefore has a symmetric K_w, the Hessian of its
    potential g^T f. A moment of fixed direction has none: omega_j turns with i, but omega_i does not turn
    with j. Such a moment is not conservative, and its part of K_w is not symmetric.

    Mathematics: `loaded-3`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`, without joint laws.
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].

    Returns:
        K_w, (runs, n_theta, n_theta) [N/m, N, N m]; row j, column i holds d(J_j^T w) / d theta_i.

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    runs = len(chain.tool_position)
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


def load_jacobian(chain: ChainState, point: Array) -> Array:
    """Compute the Jacobian J_theta = dg / d theta of Eq. (2) at the point where the load acts.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        point: Where the load acts, in the tool's frame, (runs, 3) [m].

    Returns:
        J_theta, translation rows first, world axes, (runs, 6, n_theta) [1, m].

    Raises:
        BenchError: When point has another shape or is not finite.
    """
    point = check_array(point, (len(chain.tool_position), 3), "point [m]")
    arm, (v, omega) = np.einsum("rxy,ry->xr", chain.tool_rotation, point), np.split(chain.J_theta, 2)
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


def one_step_theta(
    chain: ChainState, C_theta: Array, wrench: Array, point: Array, K_w: Array | None = None
) -> Array:
    """Compute virtual joint coordinates by one Newton step from theta = 0, Eq. (5) to (7).

    Without K_w, theta = C_theta J^T w, Eq. (6). With it, theta = (I - C_theta K_w)^-1 C_theta J^T w, Eq. (7).

    Mathematics: `loaded-5`, `vjm-7`.

    Args:
        chain: Poses and Jacobian of the chain at theta = 0 in every run, from `evaluate_chain`.
        C_theta: Compliance of the virtual joints, (n_theta, n_theta) [m/N, rad/N, rad/(N m)].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Where the wrench acts, in the tool's frame, (runs, 3) [m].
        K_w: Force term of Eq. (7), (runs, n_theta, n_theta) [N/m, N, N m]; None for Eq. (6).

    Returns:
        Virtual joint coordinates, (runs, n_theta) [m, rad]; `first_order_deflection` uses them.

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


def first_order_deflection(chain: ChainState, theta: Array, targets: Array) -> Array:
    """Compute deflections of points of the tool to first order, dp = J_p theta.

    Mathematics: `vjm-8`.

    Args:
        chain: Poses and Jacobian of the chain in every run, from `evaluate_chain`.
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad].
        targets: Points in the tool's frame, (m, 3) [m].

    Returns:
        Deflections, world axes, (runs, m, 3) [m].

    Raises:
        BenchError: When targets have another shape or are not finite.
    """
    targets = check_array(targets, (None, 3), "targets [m]")
    moved = np.einsum("ptr,rt->rp", translational_jacobian(chain, targets), theta)
    return np.asarray(moved.reshape(len(theta), len(targets), 3))


def nonlinear_deflection(vjm: Vjm, q: Array, theta: Array, targets: Array) -> Array:
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
    start, end = evaluate_chain(vjm, q), evaluate_chain(vjm, q, theta)
    turned = np.einsum("rxy,py->rpx", end.tool_rotation - start.tool_rotation, targets)
    return np.asarray((end.tool_position - start.tool_position)[:, None] + turned)
