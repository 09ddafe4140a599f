"""Kinds of true arms that differ from the model, and plants with disturbances built in.

Model and prior remain those of the arm's folder; only the simulated arm differs. `true_arms` holds the kinds
by name. Add one by `true_arms["name"] = TrueArm(...)`, or by an entry point of the group
`testbench.true_arms`.

`disturb` builds disturbances into a plant. Own weight, geometry and foundation change the MuJoCo model.
Offsets and payload errors change its inputs. Compensator and joint laws change the forces and springs of its
equilibrium. The nominal plant stays unchanged. The foundation's six coordinates are part of C, not of theta.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from testbench.arm.elastic import check_compliance, rotated_compliance
from testbench.arm.folder import Arm, Link
from testbench.errors import Array, BenchError
from testbench.plant.build import (
    VIRTUAL_JOINT_AXES,
    Plant,
    compile_mjcf,
    elastic_mjcf,
    plant_from_model,
    weightless,
)
from testbench.plant.cast import cast_link
from testbench.plant.disturbance import FOUNDATION_COMPLIANCE, Disturbances, draw_gear_errors
from testbench.plant.equilibrium import compensator_bodies
from testbench.registry import Registry

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from testbench.plant.build import Plant
    from testbench.plant.disturbance import SpringEffects

# --- True arms outside the model's templates: one model, and families of truths to judge it by --------------

DrawSprings = Callable[[Arm, np.random.Generator], "SpringEffects"]
"""Function of an arm and a random number generator that draws elastic effects beyond constant compliances."""


@dataclass(frozen=True)
class TrueArm:
    """Describe a kind of true arm by the functions that draw such an arm at random."""

    #: Function of the arm of the folder that draws an arm of the same kinematics with other compliances.
    draw_arm: Callable[[Arm, np.random.Generator], Arm]
    #: Function of the drawn arm that draws elastic effects beyond constant compliances; None for no effect.
    draw_springs: DrawSprings | None = None


JOINT_LOG_DEVIATION = 0.5
"""Standard deviation of the log of a joint's compliance over the folder's, for the kind "joints" [1]."""
JOINT_FACTOR_RANGE = 0.3, 3.0
"""Range of a joint's compliance over the folder's, for the kind "far_joints" [1]."""
STIFFNESS_FACTORS = 3, 10, 30, 100, 300
"""Factors by which all links are stiffer, so that the joints dominate [1]."""
BEARING_RADIUS, BEARING_TILTS = 0.15, (0.1, 1.0)
"""Radius of a bearing [m], and range of its tilt compliance over the compliance of the folder's joint [1]."""
SOFT_LINK_FACTOR = 5.0
"""Factor by which one link is softer than in the drawn arm [1]."""
TUBE_ENTRIES = ((0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (1, 5), (2, 4))
"""Rows and columns of the entries of a tube's compliance that are not zero, in the upper triangle."""
N_CORRELATION_VECTORS = 7
"""Number of random vectors whose correlations make a random correlation matrix of order six."""
POSE_DEPENDENCE_PERCENT = 20, 50
"""Largest change of a link's compliance with the angle of the next joint, softer or stiffer [%]."""
AXIS_COMPLIANCE_LOG_DEVIATION = 0.5
"""Standard deviation of the log change of a link's compliance with the pose, drawn for every axis [1]."""
JOINT_COUPLING_RANGE = 0.2, 0.5
"""Range of the compliance between neighbouring joints over the geometric mean of theirs [1]."""
SLIP_HALF_WIDTH_RANGE = 5e-5, 4e-4
"""Range of the largest half width H of friction that slips gradually [rad]."""
FAMILY_NAME = "family"
"""Name that selects all kinds of `FAMILY_TRUE_ARMS`: successive seeds use successive kinds."""
DEFORMATION_BISECTIONS = 24
"""Bisection steps that find the size of a link's deformation."""


def distance_from_tubes(C: Array) -> float:
    """Compute the relative distance of a compliance from tubes, min_T |T^-1/2 C T^-1/2 - I|_F / sqrt(6).

    T runs over the beam templates, which contain the tubes, so the distance is a lower bound for tubes. It is
    the RMS relative error of the six compliances along the common axes of C and T. Above 0.4 the nearest
    template may not be positive definite.

    Args:
        C: Compliance in the beam frame, (6, 6) [m/N, rad/N, rad/(N m)].

    Returns:
        The distance [1].
    """
    # T^-1 has the pattern of T, and |T^-1/2 C T^-1/2 - I| = |L^T T^-1 L - I| with C = L L^T: linear in T^-1
    L = np.linalg.cholesky(C)
    columns = []
    for a, b in TUBE_ENTRIES:
        E = np.zeros((6, 6))
        E[a, b] = E[b, a] = 1 / np.sqrt(C[a, a] * C[b, b])
        columns.append((L.T @ E @ L).ravel())
    A, identity = np.column_stack(columns), np.eye(6).ravel()
    return float(np.linalg.norm(A @ np.linalg.lstsq(A, identity)[0] - identity) / np.sqrt(6))


def deform_tube(C: Array, S: Array, distance: float) -> Array:
    """Deform the compliance of a tube to C^1/2 exp(t S) C^1/2, with t for a given distance from tubes.

    Args:
        C: Compliance of the tube, (6, 6) [m/N, rad/N, rad/(N m)].
        S: Direction of the deformation, symmetric, (6, 6) [1].
        distance: Wanted `distance_from_tubes` of the result [1].

    Returns:
        The deformed compliance, (6, 6) [m/N, rad/N, rad/(N m)].
    """
    d = np.sqrt(np.diag(C))
    values, Q = np.linalg.eigh(C / np.outer(d, d))
    half = d[:, None] * Q * np.sqrt(values)
    rates, axes = np.linalg.eigh(S)

    def deformed_by(t: float) -> Array:
        deformed = half @ (axes * np.exp(t * rates)) @ axes.T @ half.T
        return np.asarray((deformed + deformed.T) / 2)

    low, high = 0.0, float(distance / np.linalg.norm(S, 2))
    while distance_from_tubes(deformed_by(high)) < distance:
        low, high = high, 2 * high
    for _ in range(DEFORMATION_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if distance_from_tubes(deformed_by(middle)) < distance else (low, middle)
    return deformed_by(high)


def _deformed_tubes(share: float, arm: Arm, rng: np.random.Generator) -> Arm:
    """Deform every link by a distance from tubes, and rotate its axes by as many radians."""

    def deform_link(link: Link) -> Link:
        S = rng.standard_normal((6, 6))
        C = rotated_compliance(deform_tube(link.compliance, S + S.T, share), rng.standard_normal(3), share)
        return replace(link, compliance=check_compliance(C, f"{link.name} off tubes"))

    return replace(arm, links=tuple(deform_link(link) for link in arm.links))


def _cast(arm: Arm, rng: np.random.Generator) -> Arm:
    return replace(arm, links=tuple(cast_link(link, rng) for link in arm.links))


def _scaled_joints(arm: Arm, factors: Array) -> Arm:
    """Scale the compliances of all joints, factors (n,) [1]."""
    pairs = zip(arm.joints, factors, strict=True)
    return replace(arm, joints=tuple(replace(j, compliance=float(f * j.compliance)) for j, f in pairs))


def _scaled_links(arm: Arm, factors: Array) -> Arm:
    """Scale the compliances of all links, factors (n + 1,) [1]."""
    pairs = zip(arm.links, factors, strict=True)
    return replace(arm, links=tuple(replace(link, compliance=f * link.compliance) for link, f in pairs))


def _unequal_joints(arm: Arm, rng: np.random.Generator) -> Arm:
    return _scaled_joints(arm, np.exp(JOINT_LOG_DEVIATION * rng.standard_normal(arm.n_joints)))


FAMILY_TRUE_ARMS: Mapping[str, TrueArm] = {
    "tubes": TrueArm(lambda arm, _: arm),
    "off_10": TrueArm(partial(_deformed_tubes, 0.1)),
    "off_20": TrueArm(partial(_deformed_tubes, 0.2)),
    "off_40": TrueArm(partial(_deformed_tubes, 0.4)),
    "cast": TrueArm(_cast),
    "joints": TrueArm(_unequal_joints),
}
"""Kinds of the family of true arms by name: tubes as in the folder; links that differ from any tube by 10,
20 or 40 %; cast links; joints unlike the folder's."""


def draw_from_family(arm: Arm, rng: np.random.Generator) -> Arm:
    """Draw a true arm of a random kind: all kinds in `FAMILY_TRUE_ARMS` are equally probable.

    Args:
        arm: The arm as its folder describes it.
        rng: Random number generator.

    Returns:
        The drawn arm.
    """
    return FAMILY_TRUE_ARMS[str(rng.choice(list(FAMILY_TRUE_ARMS)))].draw_arm(arm, rng)


def _stiffer_links(times: float, arm: Arm, rng: np.random.Generator) -> Arm:
    drawn = draw_from_family(arm, rng)
    return _scaled_links(drawn, np.full(len(drawn.links), 1 / times))


def _soft_link(arm: Arm, rng: np.random.Generator) -> Arm:
    drawn, factors = draw_from_family(arm, rng), np.ones(len(arm.links))
    factors[rng.integers(len(factors))] = SOFT_LINK_FACTOR
    return _scaled_links(drawn, factors)


def with_random_couplings(C: Array, rng: np.random.Generator) -> Array:
    """Replace the off-diagonal entries of a compliance by random ones, from a random correlation matrix.

    The matrix is uniformly distributed over all correlation matrices of order six: it holds the correlations
    of six variables in a sample of 7 independent normal draws.

    Args:
        C: Compliance, (6, 6) [m/N, rad/N, rad/(N m)]; its diagonal is kept.
        rng: Random number generator.

    Returns:
        The compliance with new off-diagonal entries, (6, 6) [m/N, rad/N, rad/(N m)].
    """
    A = rng.standard_normal((6, N_CORRELATION_VECTORS))
    W = A @ A.T
    scale = np.sqrt(np.diag(C) / np.diag(W))
    return np.asarray(W * np.outer(scale, scale))


def _coupled_links(arm: Arm, rng: np.random.Generator) -> Arm:
    def couple_link_axes(link: Link) -> Link:
        C = with_random_couplings(link.compliance, rng)
        return replace(link, compliance=check_compliance(C, f"{link.name} coupled"))

    return replace(arm, links=tuple(couple_link_axes(link) for link in arm.links))


def _soft_bearings(arm: Arm, rng: np.random.Generator) -> Arm:
    """Add a bearing, equal in all directions, to the end of every link before a hinge."""
    drawn, unit = draw_from_family(arm, rng), np.diag([BEARING_RADIUS**2] * 3 + [1.0] * 3)
    shares = np.exp(rng.uniform(np.log(BEARING_TILTS[0]), np.log(BEARING_TILTS[1]), arm.n_joints))
    tilts = [0.0 if j.prismatic else s * j.compliance for j, s in zip(arm.joints, shares, strict=True)]
    links = zip(drawn.links, [*tilts, 0.0], strict=True)
    return replace(
        drawn, links=tuple(replace(link, compliance=link.compliance + t * unit) for link, t in links)
    )


def _far_joints(arm: Arm, rng: np.random.Generator) -> Arm:
    return _scaled_joints(
        arm, np.exp(rng.uniform(np.log(JOINT_FACTOR_RANGE[0]), np.log(JOINT_FACTOR_RANGE[1]), arm.n_joints))
    )


def _pose_dependent(percent: float, arm: Arm, rng: np.random.Generator) -> "SpringEffects":
    """Vary every link as a whole with the sine of the next joint's angle; the last with the last joint's."""
    from testbench.plant.disturbance import PoseDependence, SpringEffects

    links, n = len(arm.links), arm.n_joints
    turns = np.zeros((links, n))
    turns[range(links), np.minimum(range(links), n - 1)] = 1.0
    share = np.full((links, 6), np.log1p(percent / 100))
    return SpringEffects(PoseDependence(share, turns, rng.uniform(-np.pi, np.pi, links)))


def _pose_dependent_axes(arm: Arm, rng: np.random.Generator) -> "SpringEffects":
    """Vary every axis of a link separately, with a sum of the angles of all joints."""
    from testbench.plant.disturbance import PoseDependence, SpringEffects

    links, n = len(arm.links), arm.n_joints
    share = AXIS_COMPLIANCE_LOG_DEVIATION * rng.standard_normal((links, 6))
    return SpringEffects(
        PoseDependence(share, rng.standard_normal((links, n)), rng.uniform(-np.pi, np.pi, links))
    )


def _coupled_joints(arm: Arm, correlation: Array) -> "SpringEffects":
    """Couple joints by a correlation matrix, (n, n) [1]."""
    from testbench.plant.disturbance import SpringEffects

    root = np.sqrt([joint.compliance for joint in arm.joints])
    return SpringEffects(joint_coupling=(correlation - np.diag(np.diag(correlation))) * np.outer(root, root))


def _coupled_neighbours(arm: Arm, rng: np.random.Generator) -> "SpringEffects":
    """Couple every joint with the next one: below 1/2 the matrix is positive definite."""
    n = arm.n_joints - 1
    neighbours = np.diag(rng.uniform(*JOINT_COUPLING_RANGE, n) * rng.choice([-1.0, 1.0], n), 1)
    return _coupled_joints(arm, neighbours + neighbours.T)


def _all_joints_coupled(arm: Arm, rng: np.random.Generator) -> "SpringEffects":
    """Couple every joint with every other one, by correlations of normal vectors with 4 n numbers."""
    n = arm.n_joints
    A = rng.standard_normal((n, 4 * n))
    d = np.linalg.norm(A, axis=1)
    return _coupled_joints(arm, A @ A.T / np.outer(d, d))


def _slipping(arm: Arm, rng: np.random.Generator) -> "SpringEffects":
    from testbench.plant.disturbance import SpringEffects

    least, most = np.log(SLIP_HALF_WIDTH_RANGE)
    return SpringEffects(max_slip_half_width=np.exp(rng.uniform(float(least), float(most), arm.n_joints)))


_SPRINGS: Mapping[str, DrawSprings] = {
    **{f"following_{percent}": partial(_pose_dependent, percent) for percent in POSE_DEPENDENCE_PERCENT},
    "following_all": _pose_dependent_axes,
    "tied_joints": _coupled_neighbours,
    "tied_all": _all_joints_coupled,
    "slipping": _slipping,
}
HELD_OUT_TRUE_ARMS: Mapping[str, TrueArm] = {
    **{f"stiffer_{n}": TrueArm(partial(_stiffer_links, n)) for n in STIFFNESS_FACTORS},
    "soft_link": TrueArm(_soft_link),
    "coupled": TrueArm(_coupled_links),
    "far_joints": TrueArm(_far_joints),
    "bearings": TrueArm(_soft_bearings),
    **{name: TrueArm(draw_from_family, springs) for name, springs in _SPRINGS.items()},
}
"""Kinds of true arms outside the family, by name: nothing in testbench was tuned on them."""
FAMILY_DESCRIPTIONS = {
    "tubes": "the arm's folder: every link is a straight tube, which the template contains",
    **{
        f"off_{percent}": f"along its axes, every link differs from a tube by {percent} %; the axes are "
        f"turned by {np.rad2deg(percent / 100):.0f} degrees"
        for percent in (10, 20, 40)
    },
    "cast": "every link is a cast box, tapered, bowed, and beside the axes of its joints; half of the boxes "
    "have an open side. Length and mean compliance under moments are those of the tube",
    "joints": "joints differ from the folder's: their log compliance has a standard deviation of "
    f"{JOINT_LOG_DEVIATION:g}",
}
"""Description of each kind in `FAMILY_TRUE_ARMS`, for reports."""


def _check(name: str, kind: TrueArm) -> None:
    """Refuse anything but a TrueArm, and the name of the family."""
    if name == FAMILY_NAME or not isinstance(kind, TrueArm):
        problem = f"expected a TrueArm with a name other than {FAMILY_NAME!r}, got {type(kind).__name__}"
        raise BenchError(f"true arm {name!r}: {problem}")


true_arms: Registry[TrueArm] = Registry(
    "true arm", "testbench.true_arms", {**FAMILY_TRUE_ARMS, **HELD_OUT_TRUE_ARMS}, _check
)
"""Kinds of true arms by name: `FAMILY_TRUE_ARMS`, `HELD_OUT_TRUE_ARMS`, and those that users add."""


def true_arm_of_seed(family: str, seed: int) -> str:
    """Return the name of the kind of true arm that belongs to a seed.

    Args:
        family: "family", for which successive seeds use successive kinds of `FAMILY_TRUE_ARMS`, or the name
            of one kind.
        seed: The seed.

    Returns:
        Name of the kind.
    """
    return list(FAMILY_TRUE_ARMS)[seed % len(FAMILY_TRUE_ARMS)] if family == FAMILY_NAME else family


def draw_true_plant(
    arm: Arm, name: str, rng: np.random.Generator, link_stiffness_factor: float = 1.0
) -> "Plant":
    """Draw a true arm of a kind at random, and build its plant.

    Args:
        arm: The arm as its folder describes it.
        name: Kind of true arm, a name in `true_arms`.
        rng: Random number generator.
        link_stiffness_factor: Factor by which all links are stiffer [1].

    Returns:
        The true arm, without disturbances.

    Raises:
        BenchError: If there is no such kind, or it does not draw an arm with the same joints and links.
    """
    from testbench.plant.build import build_plant

    kind = true_arms[name]
    drawn = kind.draw_arm(_scaled_links(arm, np.full(len(arm.links), 1 / link_stiffness_factor)), rng)
    if not isinstance(drawn, Arm) or (drawn.n_joints, drawn.n_theta) != (arm.n_joints, arm.n_theta):
        problem = "expected an Arm of the same joints and links from draw(arm, rng)"
        raise BenchError(f"true arm {name!r}: {problem}")
    plant = build_plant(drawn)
    return (
        plant
        if kind.draw_springs is None
        else replace(plant, spring_effects=kind.draw_springs(plant.arm, rng))
    )


# --- The disturbed true arm: a plant with disturbances built in ---------------------------------------------


def disturb(plant: Plant, disturbances: Disturbances, rng: np.random.Generator) -> Plant:
    """Build disturbances into a copy of a true arm; random errors are drawn.

    Random numbers are drawn for every disturbance, on or off, so that switching one does not change the
    others. Gear errors have a random stream of their own, because their number of orders varies.

    Args:
        plant: The true arm without disturbances. For a soft foundation its model is compiled anew from
            `plant.arm`, with the gravity of `plant.model`.
        disturbances: The disturbances, with their sizes.
        rng: Random number generator.

    Returns:
        The true arm with disturbances.

    Raises:
        BenchError: If there is a compensator and the arm has no hinge between links 1 and 2.
    """
    if disturbances.compensator is not None:
        compensator_bodies(plant)
    n = plant.arm.n_joints
    # All numbers are drawn whatever is switched on, so that one disturbance does not change another.
    offset = rng.standard_normal(n)
    frames = rng.standard_normal((n + 1, 6))
    centre = rng.standard_normal(3)
    true = _on_foundation(plant, disturbances.foundation_factor)
    if not disturbances.own_weight:
        true = weightless(true)
    if (errors := disturbances.geometry) is None:
        frames = np.zeros_like(frames)
    else:
        frames = frames * np.repeat([errors.position_sigma, errors.angle_sigma], 3)
        true = _with_frame_errors(true, frames)
    return replace(
        true,
        disturbances=disturbances,
        joint_offset=disturbances.joint_offset_sigma * offset,
        load_point_error=disturbances.load_point_sigma * centre,
        frame_errors=frames,
        gear_errors=None
        if disturbances.gear_errors is None
        else draw_gear_errors(disturbances.gear_errors, n, rng.spawn(1)[0]),
    )


def with_exact_load(plant: Plant) -> Plant:
    """Copy a true arm, without errors of the payload's recorded mass and load point."""
    exact = replace(plant.disturbances, mass_error=0.0, load_point_sigma=0.0)
    return replace(plant, disturbances=exact, load_point_error=np.zeros(3))


def _on_foundation(plant: Plant, scale: float) -> Plant:
    """Put the plant on a foundation of `scale` times `FOUNDATION_COMPLIANCE`, 0 for a rigid one."""
    arm = plant.arm
    if not scale:
        return plant
    compliance = scale * np.array(FOUNDATION_COMPLIANCE)
    model = compile_mjcf(arm.mjcf_path, elastic_mjcf(arm, compliance))
    model.opt.gravity[:] = plant.model.opt.gravity
    true = replace(plant_from_model(arm, model), spring_effects=plant.spring_effects)
    soft = [model.joint(f"foundation_{axis}").dofadr[0] for axis in VIRTUAL_JOINT_AXES]
    true.C_qpos[soft, soft] = compliance
    return true


def _with_frame_errors(plant: Plant, frames: Array) -> Plant:
    """Move and rotate the frames of all joints and of the tool, (n + 1, 6) [m, rad].

    The body that carries the virtual joint before a frame defines its place; the frame's own body its
    orientation.
    """
    arm, model = plant.arm, copy.copy(plant.model)
    for name, error in zip([*(link.name for link in arm.links[1:]), arm.tool], frames, strict=True):
        body = model.body(name).id
        model.body_pos[model.body_parentid[body]] += error[:3]
        mujoco.mju_quatIntegrate(model.body_quat[body], error[3:], 1.0)
    return replace(plant, model=model)
