"""Loads at the tool: hung weights and process forces, and what they do to the virtual joints.

A `Load` is a wrench w and its point of action. `on_joints` turns loads into the generalised loads J^T w of
Eq. (10), which the linear model and the equilibrium take.

The arm's own weight on the virtual joints: masses and centres of mass, read from rigid.xml.

A body loads every virtual joint before it in the chain. The load J^T m g is linear in each body's mass and
first moments, mass times centre; so `identify` can take masses from the file or fit them. Joint laws and the
equilibrium under own weight use these loads.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY, angle_unit, find_body, numbers, read_mjcf
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, InputError, check_array, check_type
from testbench.model.kinematics import body_pose
from testbench.model.vjm import Chain, Vjm, append_law_loads, plain_load


@dataclass(frozen=True, repr=False)
class Load(Displayed):
    """Describe a wrench at the tool: one for all poses, or one per pose."""

    wrench: Array  #: Force and moment, world axes, (6,) or (poses, 6) [N, N m].
    point: Array  #: Where it acts, in the tool's frame, (3,) or (poses, 3) [m].

    def over(self, poses: int) -> "Load":
        """Expand the load to one row per pose: wrench (poses, 6) [N, N m] and point (poses, 3) [m].

        Raises:
            BenchError: When it has rows for another number of poses, or a number that is not finite.
        """
        try:
            wrench, point = np.broadcast_to(self.wrench, (poses, 6)), np.broadcast_to(self.point, (poses, 3))
        except ValueError:
            shapes = f"{np.shape(self.wrench)} and {np.shape(self.point)}"
            problem = f"expected a wrench and a point, or one for each of {poses} poses, got {shapes}"
            raise BenchError(f"load: {problem}") from None
        check_array(wrench, (poses, 6), "wrench [N, N m]")
        check_array(point, (poses, 3), "point [m]")
        return Load(wrench, point)

    def select(self, poses: slice | Ids) -> "Load":
        """Take the rows of some poses, by indices or a slice, from a load that has one row per pose."""
        return Load(self.wrench[poses], self.point[poses])


def weight(vjm: Vjm, mass: float | Array) -> Load:
    """Make the load of a mass hung from the arm's load point: force -m g along world z.

    Args:
        vjm: Kinematics, for the load point.
        mass: Mass, one number or one per pose, (poses,) [kg].

    Returns:
        The load: wrench (6,) or (poses, 6) [N, N m], point (3,) or (poses, 3) [m].

    Raises:
        BenchError: When an argument has another type, or a mass is not finite.
    """
    check_type(vjm, Vjm, "vjm")
    check_array(mass, (None,) * np.ndim(mass), "mass [kg]")
    wrench = np.zeros((*np.shape(mass), 6))
    wrench[..., 2] = -GRAVITY * mass
    return Load(wrench, np.broadcast_to(vjm.load, (*np.shape(mass), 3)))


def resultant(rotation: Array, loads: Sequence[Load]) -> Array:
    """Sum all loads to one wrench, its moment about the tool's origin.

    Args:
        rotation: Orientation of the tool, world from tool, (poses, 3, 3) [1].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Force and moment, world axes, (poses, 6) [N, N m].

    Raises:
        BenchError: When a load has rows for another number of poses.
    """
    total = np.zeros((len(rotation), 6))
    for load in loads:
        own = load.over(len(total))
        lever = np.matvec(rotation, own.point)
        total[:, :3] += own.wrench[:, :3]
        total[:, 3:] += own.wrench[:, 3:] + np.cross(lever, own.wrench[:, :3])
    return total


def on_joints(chain: Chain, loads: Sequence[Load]) -> Array:
    """Sum the generalised loads J_F^T w of all loads on every virtual joint, Eq. (10).

    Args:
        chain: Tool and Jacobian of every run.
        loads: Loads that act together, each with one row per run.

    Returns:
        Load of every virtual joint, (n_theta, runs) [N, N m]; for a joint law the turn per unit of its size
        [rad, m].

    Raises:
        BenchError: When a load does not have one row per run.
    """
    u = np.zeros((7 * len(chain.bodies) - 8, len(chain.position)))
    for load in loads:
        u += plain_load(chain, load.wrench, load.point)
    return append_law_loads(chain, u)


@dataclass(frozen=True)
class Weights:
    """Hold masses and centres of the n + 2 bodies: the links from the base on, and the tool.

    The mass of a body includes everything that is fixed to it.
    """

    mass: Array  #: Mass, (bodies,) [kg].
    centre: Array  #: Centre of mass in the body's own axes, (bodies, 3) [m].

    @property
    def parameters(self) -> Array:
        """Return mass and first moments m, m c_x, m c_y, m c_z of every body, (bodies, 4) [kg, kg m]."""
        return np.column_stack([self.mass, self.mass[:, None] * self.centre])


def no_weights(arm: Arm) -> Weights:
    """Make the weights of an arm whose links weigh nothing: zeros for all n + 2 bodies."""
    return Weights(np.zeros(arm.n_joints + 2), np.zeros((arm.n_joints + 2, 3)))


def read_weights(arm: Arm) -> Weights:
    """Read masses and centres of mass from an arm's MJCF.

    Args:
        arm: Description of the arm; its rigid.xml is read.

    Returns:
        Masses and centres of the links and the tool, with all bodies fixed to them.

    Raises:
        InputError: When MuJoCo would take a mass from shapes, which this reader does not weigh.
    """
    root = read_mjcf(arm.rigid)
    from_shapes = [c.get("inertiafromgeom", "auto") for c in root.iter("compiler")][-1:] or ["auto"]
    if from_shapes == ["true"]:
        problem = "expected masses in <inertial>, got inertiafromgeom='true'"
        raise InputError(arm.rigid, "<compiler>", problem)
    names = [*(link.name for link in arm.links), arm.tool]
    bodies = [find_body(arm.rigid, root, name) for name in names]
    light = _light_shapes(arm, root) if from_shapes == ["auto"] else set(root.iter("geom"))
    every = [
        sum(
            (_mass_and_moments(arm, part, light, T) for part, T in _fixed_bodies(arm, root, body, bodies)),
            np.zeros(4),
        )
        for body in bodies
    ]
    mass, moment = np.split(np.array(every), [1], axis=1)
    return Weights(mass[:, 0], moment / np.where(mass > 0, mass, 1))


def weights_with_note(arm: Arm) -> tuple[Weights, list[str]]:
    """Read what the links weigh; where the arm's file does not state it, nothing, and a note for the user."""
    try:
        return read_weights(arm), []
    except InputError as err:
        return no_weights(arm), [f"Own weight is left out: {err}"]


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
        [mass] = numbers(arm.rigid, inertial, "mass", 1)
        centre = pose @ [*numbers(arm.rigid, inertial, "pos", 3), 1.0]
        return mass * np.array([1.0, *centre[:3]])
    if not light.issuperset(body.findall("geom")):
        problem = "expected an <inertial>, or shapes of mass 0: MuJoCo would take the mass from its shapes"
        raise InputError(arm.rigid, f"<body name={body.get('name')!r}>", problem)
    return np.zeros(4)


def _light_shapes(arm: Arm, root: ET.Element) -> set[ET.Element]:
    """Find the shapes whose mass is zero, by their own attribute or by that of their class."""
    above = {child: parent for parent in root.iter() for child in parent}
    classes = {d.get("class", "main"): d for d in root.iter("default")}

    def stated(geom: ET.Element) -> ET.Element | None:
        """Find the element that states the mass of a shape: itself, its class, or a parent class."""
        if "mass" in geom.attrib:
            return geom
        body = above[geom]
        while "childclass" not in body.attrib and body in above:
            body = above[body]
        default = classes.get(geom.get("class", body.get("childclass", "main")))
        while default is not None and default.tag == "default":
            if (own := default.find("geom")) is not None and "mass" in own.attrib:
                return own
            default = above.get(default)
        return None

    where = {geom: stated(geom) for geom in root.iter("geom")}
    return {geom for geom, e in where.items() if e is not None and numbers(arm.rigid, e, "mass", 1) == [0.0]}


def weight_columns(chain: Chain) -> Array:
    """Compute the load of every virtual joint per unit of mass and of each first moment of every body.

    For a virtual joint t that carries body k with origin p and axes R these are J_t(p)^T g, and (omega_t x R
    e)^T g for e = x, y, z. All others are zero, also those of joint laws.

    Returns:
        Columns, (n_theta, runs, bodies, 4) [N/kg, N m/kg; N/(kg m), N m/(kg m)]; their sum times
        `Weights.parameters` is `own_weight`.
    """
    _, n_theta, runs = chain.J_theta.shape
    columns = np.zeros((len(chain.bodies), 4, n_theta, runs))  # runs last: every product is one long loop
    for k, (p, R) in enumerate(chain.bodies):
        # the Jacobian at the body's origin: v_z(p) = v_z + (omega x (p - tool))_z
        arm = p - chain.position.T
        for some in _carrying_joints(k, chain):
            v_z, (x, y) = chain.J_theta[2, some], chain.J_theta[3:5, some]
            columns[k, 0, some] = v_z + x * arm[1] - y * arm[0]
            for axis in range(3):
                columns[k, 1 + axis, some] = x * R[1, axis] - y * R[0, axis]
    columns *= -GRAVITY
    return columns.transpose(2, 3, 0, 1)


def _carrying_joints(body: int, chain: Chain) -> tuple[slice, slice]:
    """Return slices of the virtual joints that carry a body: those of links, and those of joints."""
    links, joints = 6 * (len(chain.bodies) - 1), len(chain.bodies) - 2
    return slice(0, 6 * body), slice(links, links + min(body, joints))


def own_weight(chain: Chain, weights: Weights) -> Array:
    """Compute the load of every virtual joint under the arm's own weight, sum_k J_k^T m_k g.

    Everything behind a virtual joint pulls as one body: masses and moments are summed from the tool on. The
    base link lies before every virtual joint, so its mass loads none. Loads of joint laws are zero.

    Mathematics: `vjm-6`.

    Args:
        chain: Tool, bodies and Jacobian of every run.
        weights: Masses and centres of the bodies.

    Returns:
        Generalised loads, (n_theta, runs) [N, N m].
    """
    _, n_theta, runs = chain.J_theta.shape
    load, mass, moment = np.zeros((n_theta, runs)), 0.0, np.zeros((3, runs))
    for k in range(len(chain.bodies) - 1, 0, -1):
        p, R = chain.bodies[k]
        mass += weights.mass[k]
        moment += weights.mass[k] * (p - chain.position.T + weights.centre[k] @ R)
        links, joints = _carrying_joints(k, chain)
        for some in (slice(links.stop - 6, links.stop), slice(joints.stop - 1, joints.stop)):
            v_z, (x, y) = chain.J_theta[2, some], chain.J_theta[3:5, some]
            load[some] = -GRAVITY * (mass * v_z + x * moment[1] - y * moment[0])
    return load
