"""Static equilibrium of the elastic arm in many poses, by Newton's method on MuJoCo's generalised forces.

With the actuated joints fixed, theta is in equilibrium if

    K_theta theta = Q(theta),

with Q the generalised force of own weight and loads. Newton's matrix is K_theta - K_w, Eq. (7). K_w is small
for an arm that can carry its load, so the constant K_theta suffices at first: theta <- C_theta Q(theta) gains
two digits per step. If a step of a pose gains less than a factor of four, its tangent is computed by finite
differences.

The result of a pose does not depend on the other poses of its batch. Each pose takes its own steps and stops
by itself. Matrices multiply the vectors of poses one by one, because the rounding of a product of two
matrices by BLAS depends on their sizes.

A gravity compensator is a spring from link 1 to link 2 that supports joint 2. With length s, the strut pulls
its ends together by F = rate (s_0 - rest_length) + stiffness (s - s_0), where s_0 is its length in the
undeflected pose. The two slopes may differ. As joint 2 turns, it moves the piston, and only gas or coils push
back. Under a payload the piston moves by tenths of a millimetre, and seal friction or a closed column of oil
may make it far stiffer. Equal slopes, the default, are the plain spring. The equivalent stiffness at joint 2
is K_eq = stiffness s'^2 + F s'', with derivatives with respect to q_2. It nearly vanishes where the strut
points at the axis, and is largest where the strut is perpendicular to its lever.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np

from testbench.arm.folder import Compensator
from testbench.errors import Array, BenchError, Ids, NoEquilibrium, check_array
from testbench.plant.build import Plant
from testbench.plant.disturbance import (
    NonlinearJoints,
    SpringEffects,
    gear_error,
    joint_deflection,
    joint_tangent_compliance,
)
from testbench.progress import stepwise

# --- Poses evaluated by MuJoCo, many at once, and generalised forces of loads on bodies ---------------------


@dataclass(frozen=True)
class BodyState:
    """Hold what MuJoCo computes for some poses: own weight, Jacobian, and poses of requested bodies."""

    own_weight_force: Array  #: Generalised force of the arm's own weight, (poses, nv) [N, N m].
    #: Rotation, then translation at `reference_point`, per unit of every coordinate, in world axes: MuJoCo's
    #: cdof, (poses, nv, 6) [1, m].
    spatial_jacobian: Array
    #: Point of the world for which `spatial_jacobian` has the translation, (poses, 3) [m].
    reference_point: Array
    body_positions: dict[int, Array]  #: Position of every body in the world, by body id, (poses, 3) each [m].
    body_rotations: dict[int, Array]  #: World from body, by body id, (poses, 3, 3) each [1].


@dataclass(frozen=True)
class ArmCopies:
    """Hold a MuJoCo state of several copies of the arm, with views of it per copy.

    Every call of `solve_equilibrium` creates one: MuJoCo overwrites the views.
    """

    model: mujoco.MjModel  #: MuJoCo model of all copies.
    data: mujoco.MjData  #: MuJoCo state of all copies.
    qpos: Array  #: Configuration of every copy, (copies, nv) [m, rad].
    #: Rotation, then translation at `reference_point`, per unit of every coordinate, (copies, nv, 6) [1, m].
    spatial_jacobian: Array
    #: Point of the world for which `spatial_jacobian` has the translation, (copies, 3) [m].
    reference_point: Array
    body_positions: Array  #: Position of the body with id b at index b - 1, (copies, bodies, 3) [m].
    body_rotations: Array  #: World from body, indexed in the same way, (copies, bodies, 3, 3) [1].


def create_arm_copies(plant: Plant) -> ArmCopies:
    """Create a MuJoCo state of several copies of the arm, and views of it per copy."""
    model = plant.model_with_copies
    data = mujoco.MjData(model)
    nv = plant.model.nv
    bodies = plant.model.nbody - 1
    root = plant.model.body_rootid[plant.tool_body]
    return ArmCopies(
        model=model,
        data=data,
        qpos=data.qpos.reshape(-1, nv),
        spatial_jacobian=data.cdof.reshape(-1, nv, 6),
        reference_point=data.subtree_com[1:].reshape(-1, bodies, 3)[:, root - 1],
        body_positions=data.xpos[1:].reshape(-1, bodies, 3),
        body_rotations=data.xmat[1:].reshape(-1, bodies, 3, 3),
    )


def evaluate_bodies(copies: ArmCopies, qpos: Array, bodies: Collection[int] = ()) -> BodyState:
    """Compute own weight, Jacobian and poses of bodies by MuJoCo, for several configurations per call.

    Velocities are zero, so of MuJoCo's forward pass only kinematics and the bias force are needed.

    Args:
        copies: Copies of the arm in one MuJoCo model.
        qpos: Configurations, (poses, nv) [m, rad].
        bodies: Ids of the bodies whose poses are requested; without any, the Jacobian is left out too.

    Returns:
        Generalised force of the arm's own weight, the Jacobian, and poses of the requested bodies.
    """
    model = copies.model
    data = copies.data
    arms, nv = copies.qpos.shape
    poses, room = len(qpos), -(-len(qpos) // arms) * arms
    bias = np.empty((room, nv))
    placed = room if bodies else 0
    motion, centre = np.empty((placed, nv, 6)), np.empty((placed, 3))
    position = {body: np.empty((room, 3)) for body in bodies}
    rotation = {body: np.empty((room, 3, 3)) for body in bodies}
    # One call of MuJoCo for each row of arms; the last row is filled up.
    for start in range(0, room, arms):
        part = slice(start, start + arms)
        copies.qpos[: poses - start] = qpos[part]
        mujoco.mj_fwdKinematics(model, data)
        mujoco.mj_rne(model, data, 0, bias[part].reshape(-1))
        if bodies:
            motion[part], centre[part] = copies.spatial_jacobian, copies.reference_point
        for body in bodies:
            position[body][part], rotation[body][part] = (
                copies.body_positions[:, body - 1],
                copies.body_rotations[:, body - 1],
            )
    return BodyState(
        own_weight_force=-bias[:poses],
        spatial_jacobian=motion[:poses],
        reference_point=centre[:poses],
        body_positions={body: p[:poses] for body, p in position.items()},
        body_rotations={body: R[:poses] for body, R in rotation.items()},
    )


def point_position(state: BodyState, body: int, point: Array) -> Array:
    """Compute the world position of a point that is fixed in a body, in every pose.

    Args:
        state: Poses of the body.
        body: Body id.
        point: Point in the body's frame, (3,) or (poses, 3) [m].

    Returns:
        Position, (poses, 3) [m].
    """
    return np.asarray(state.body_positions[body] + np.matvec(state.body_rotations[body], point))


def generalised_force(plant: Plant, state: BodyState, body: int, wrench: Array, point: Array) -> Array:
    """Compute the generalised force J^T w of a wrench on a body, in every pose.

    Args:
        plant: The true arm.
        state: The poses.
        body: Body id.
        wrench: Force and moment, world axes, (poses, 6) [N, N m].
        point: Point of the world where the force acts, (poses, 3) [m].

    Returns:
        Generalised force, (poses, nv) [N, N m].
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    about_centre = moment + np.cross(point - state.reference_point, force)
    Q = np.matvec(state.spatial_jacobian, np.concatenate([about_centre, force], axis=1))
    return np.asarray(Q * plant.joint_moves_body[body])


def _body_motion(plant: Plant, state: BodyState, body: int, theta: Array) -> tuple[Array, Array]:
    """Compute translation and rotation of a body under small deflections, J theta, in every pose.

    Args:
        plant: The true arm.
        state: The poses.
        body: Body id.
        theta: Deflection in MuJoCo's coordinates, (poses, nv) [m, rad].

    Returns:
        Translation of the body's origin [m] and rotation vector [rad], world axes, (poses, 3) each.
    """
    twist = np.vecmat(theta * plant.joint_moves_body[body], state.spatial_jacobian)
    turn, shift = twist[:, :3], twist[:, 3:]
    return shift + np.cross(turn, state.body_positions[body] - state.reference_point), turn


# --- A gravity compensator: a spring from link 1 to link 2 that supports joint 2 ----------------------------


@dataclass(frozen=True)
class CompensatorState:
    """Hold a gravity compensator, and its geometry and stiffness in some undeflected poses, theta = 0.

    g = ds / dqpos is the derivative of the strut's length, C the compliance of the arm, k the stiffness.
    """

    spring: Compensator  #: Description of the compensator.
    stiffness: float  #: Change of force over change of length as the arm deflects, k [N/m].
    body_ids: tuple[int, int]  #: Ids of the bodies on which the strut is hinged.
    undeflected_length: Array  #: Length of the strut, (poses,) [m].
    C_g: Array  #: C g, (poses, nv).
    #: k g / (1 + k g^T C g), the row of Sherman and Morrison's formula, (poses, nv).
    sherman_morrison_row: Array


def compensator_bodies(plant: Plant) -> tuple[int, int]:
    """Find the MuJoCo ids of links 1 and 2, which a gravity compensator connects.

    Args:
        plant: The true arm.

    Returns:
        Body ids of link 1 and link 2.

    Raises:
        BenchError: If the arm has fewer than two joints, or joint 2 is a slide.
    """
    links = plant.arm.links
    if len(links) < 3:
        raise BenchError(
            f"compensator: expected an arm with links 1 and 2, {plant.arm.name} has {len(links)} links"
        )
    if plant.arm.joints[1].prismatic:
        raise BenchError(
            f"compensator: expected a hinge between links 1 and 2 of {plant.arm.name}, got a slide"
        )
    return plant.model.body(links[1].name).id, plant.model.body(links[2].name).id


def compensator_state(compensator: Compensator, plant: Plant, state: BodyState) -> CompensatorState:
    """Compute geometry and stiffness of a gravity compensator in undeflected poses, theta = 0.

    Args:
        compensator: Description of the compensator.
        plant: The true arm.
        state: The undeflected poses.

    Returns:
        The compensator, with the length of its strut and the effect of its stiffness in every pose.
    """
    ends = compensator_bodies(plant)
    hinges = _hinges(compensator, ends, state)
    held = _length(hinges)
    g = _strut_load(plant, ends, state, hinges, np.full(len(held), -1.0))
    C_g = np.matvec(plant.C_qpos, g)
    k = compensator.rate if compensator.stiffness is None else compensator.stiffness
    share = (k / (1 + k * np.vecdot(g, C_g)))[:, None] * g
    return CompensatorState(compensator, k, ends, held, C_g, share)


def compensator_force(
    compensator: CompensatorState, plant: Plant, state: BodyState, pose_indices: Ids
) -> Array:
    """Compute the generalised force of a gravity compensator in deflected poses.

    Mathematics: `law-10`.

    Args:
        compensator: The compensator, with its geometry and stiffness in all poses.
        plant: The true arm.
        state: The deflected poses, k of them.
        pose_indices: Index of each of them among all poses, (k,).

    Returns:
        Generalised force, (k, nv) [N, N m].
    """
    spring, held = compensator.spring, compensator.undeflected_length[pose_indices]
    hinges = _hinges(spring, compensator.body_ids, state)
    force = spring.rate * (held - spring.rest_length) + compensator.stiffness * (_length(hinges) - held)
    return _strut_load(plant, compensator.body_ids, state, hinges, force)


def correct_steps_for_compensator(compensator: CompensatorState, steps: Array, pose_indices: Ids) -> Array:
    """Correct Newton steps of the arm's springs for the stiffness k of a gravity compensator.

    The inverse of C (C^-1 + k g g^T) is applied by the formula of Sherman and Morrison.

    Args:
        compensator: The compensator, with its geometry and stiffness in all poses.
        steps: Newton steps of some poses without the compensator, (m, nv) [m, rad].
        pose_indices: Index of each of them among all poses, (m,).

    Returns:
        Newton steps with the compensator, (m, nv) [m, rad].
    """
    along = np.vecdot(compensator.sherman_morrison_row[pose_indices], steps)
    return np.asarray(steps - along[:, None] * compensator.C_g[pose_indices])


def _hinges(spring: Compensator, ends: tuple[int, int], state: BodyState) -> tuple[Array, Array]:
    """Compute foot and head in the world, (poses, 3) [m]."""
    return point_position(state, ends[0], np.array(spring.foot)), point_position(
        state, ends[1], np.array(spring.head)
    )


def _length(hinges: tuple[Array, Array]) -> Array:
    return np.asarray(np.linalg.norm(hinges[1] - hinges[0], axis=1))


def _strut_load(
    plant: Plant, ends: tuple[int, int], state: BodyState, hinges: tuple[Array, Array], force: Array
) -> Array:
    """Compute the generalised force of a pull between both ends, (poses, nv) [N, N m]."""
    along = (force / _length(hinges))[:, None] * (hinges[1] - hinges[0])
    Q = np.zeros(state.own_weight_force.shape)
    for body, point, pulled in zip(ends, hinges, (along, -along), strict=True):
        wrench = np.concatenate([pulled, np.zeros_like(pulled)], axis=1)
        Q += generalised_force(plant, state, body, wrench, point)
    return Q


# --- Static equilibrium of the elastic arm in many poses ----------------------------------------------------

POSES_PER_BATCH = 512  #: Poses that are solved together: enough for numpy to be fast, few for the memory.
STEP_TOLERANCE = 1e-9  #: A pose is in equilibrium when the last Newton step is below this [m, rad].
MAX_ITERATIONS = 50  #: Most Newton steps of a pose.
MAX_NEWTON_STEP = 0.5  #: Newton step at which a pose counts as having no equilibrium [m, rad].


@dataclass(frozen=True)
class ArmEquilibrium:
    """Hold static equilibria of the true arm: virtual joint coordinates, marker positions and tool poses."""

    theta: Array  #: Virtual joint coordinates, (runs, n_theta) [m, rad].
    marker_positions: Array  #: Marker positions in the world, (runs, m, 3) [m].
    tool_positions: Array  #: Tool positions in the world, (runs, 3) [m].
    tool_rotations: Array  #: Tool orientations, world from tool, (runs, 3, 3) [1].


@dataclass(frozen=True)
class PoseBatch:
    """Hold some poses whose equilibria are solved together, with their loads and elasticity."""

    plant: Plant  #: The true arm.
    #: MuJoCo configurations with theta = 0, (poses, nv) [m, rad].
    undeflected_qpos: Array
    wrench: Array  #: Force and moment on the tool, world axes, (poses, 6) [N, N m].
    point: Array  #: Point where the force acts, in the tool's frame, (poses, 3) [m].
    #: Compliance in MuJoCo's coordinates, (poses, nv, nv), or (nv, nv) if it is the same in all poses.
    compliances: Array
    joints: NonlinearJoints | None = None  #: Nonlinear joints; None for linear springs.
    compensator: CompensatorState | None = None  #: Gravity compensator; None for none.

    @property
    def loaded_bodies(self) -> tuple[int, ...]:
        """Return the ids of the bodies on which a wrench or a compensator acts."""
        tool = (self.plant.tool_body,) if self.wrench.any() else ()
        return tool if self.compensator is None else (*tool, *self.compensator.body_ids)

    def compliance_of_poses(self, pose_indices: Ids) -> Array:
        """Return the compliance of links and joints in some of the poses, in MuJoCo's coordinates.

        Args:
            pose_indices: Indices of the poses, (k,).

        Returns:
            Compliance, (k, nv, nv) [m/N, rad/N, rad/(N m)]; (nv, nv) if it is the same in all poses.
        """
        return self.compliances if self.compliances.ndim == 2 else self.compliances[pose_indices]


def solve_equilibrium(
    plant: Plant,
    q: Array,
    wrench: Array | None = None,
    point: Array | None = None,
    *,
    equilibrium_before: ArmEquilibrium | None = None,
) -> ArmEquilibrium:
    """Solve the static equilibrium K_theta theta = Q(theta) of every pose, under own weight and a wrench.

    The wrench keeps its direction in the world and acts at a point fixed in the tool, as a hung weight does.

    Mathematics: `loaded-9`.

    Args:
        plant: The true arm, with its disturbances.
        q: Commanded joint coordinates, (runs, n) [rad, m].
        wrench: Recorded force and moment, world axes, (runs, 6) [N, N m]; None for own weight alone.
        point: Recorded point where the force acts, in the tool's frame, (runs, 3) [m]; None for its origin.
        equilibrium_before: Equilibria before this load was put on, from which friction holds the joints back;
            None if the joints have just moved to the pose and friction does not act.

    Returns:
        The equilibria; theta is measured from the true joint coordinates.

    Raises:
        NoEquilibrium: When the arm is too soft for its load, or buckles; the message names the pose.
        BenchError: When an array has another shape or is not finite.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    runs, changes = len(q), plant.disturbances
    wrench = np.zeros((runs, 6)) if wrench is None else check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = np.zeros((runs, 3)) if point is None else check_array(point, (runs, 3), "point [m]")
    # The true load and joint angles, as far as the disturbances change them.
    wrench = wrench * (1 + changes.mass_error)
    point = point + plant.load_point_error
    law = _law(plant, runs, equilibrium_before)
    true_q = q + plant.joint_offset + (0.0 if plant.gear_errors is None else gear_error(plant.gear_errors, q))

    def solve_runs(runs_of_batch: slice, copies: ArmCopies) -> ArmEquilibrium:
        """Solve the equilibria of the runs in one batch.

        Args:
            runs_of_batch: Runs of the batch.
            copies: Copies of the arm in one MuJoCo model.

        Returns:
            Equilibria of these runs.
        """
        held, C = undeflected_configurations(plant, true_q[runs_of_batch]), plant.compliance(q[runs_of_batch])
        poses = PoseBatch(
            plant, held, wrench[runs_of_batch], point[runs_of_batch], C, law and law.select(runs_of_batch)
        )
        if changes.compensator is not None:
            state = evaluate_bodies(copies, poses.undeflected_qpos, compensator_bodies(plant))
            poses = replace(poses, compensator=compensator_state(changes.compensator, plant, state))
        return _solve_batch(poses, copies)

    return _solve_in_batches(plant, runs, solve_runs)


def _law(plant: Plant, runs: int, before: ArmEquilibrium | None) -> NonlinearJoints | None:
    """Make the joint laws of all runs; None for MuJoCo's linear springs."""
    if before is not None:
        check_array(before.theta, (runs, plant.arm.n_theta), "theta before [m, rad]")
    changes, effects = plant.disturbances, plant.spring_effects or SpringEffects()
    sizes = changes.stiffening, changes.backlash, changes.hysteresis
    if not any(sizes) and effects.max_slip_half_width is None and effects.joint_law is None:
        return None
    return NonlinearJoints(
        compliance=np.array([joint.compliance for joint in plant.arm.joints]),
        stiffening=changes.stiffening,
        backlash=changes.backlash,
        hysteresis=changes.hysteresis,
        start_deflection=None if before is None else before.theta[:, 6 * len(plant.arm.links) :],
        max_slip_half_width=effects.max_slip_half_width,
        user_law=effects.joint_law,
    )


def solve_unloaded_and_loaded(
    plant: Plant, q: Array, wrench: Array, point: Array
) -> tuple[ArmEquilibrium, ArmEquilibrium]:
    """Solve the equilibria of every pose without a wrench, then with the wrench put on in the same pose.

    Args:
        plant: The true arm, with its disturbances.
        q: Commanded joint coordinates, (runs, n) [rad, m].
        wrench: Recorded force and moment, world axes, (runs, 6) [N, N m].
        point: Recorded point where the force acts, in the tool's frame, (runs, 3) [m].

    Returns:
        The unloaded and the loaded equilibria.
    """
    rest = solve_equilibrium(plant, q)
    return rest, solve_equilibrium(plant, q, wrench, point, equilibrium_before=rest)


def _solve_in_batches(
    plant: Plant, runs: int, solve_batch: Callable[[slice, ArmCopies], ArmEquilibrium]
) -> ArmEquilibrium:
    """Solve the equilibria of all runs in batches of `POSES_PER_BATCH`, which limits the memory.

    Args:
        plant: The true arm.
        runs: Number of runs.
        solve_batch: Function that solves the equilibria of a slice of the runs with some copies of the arm.

    Returns:
        Equilibria of all runs, in their order.
    """
    row = create_arm_copies(plant)
    starts = stepwise(range(0, max(runs, 1), POSES_PER_BATCH), "settling the arm")
    equilibria = [solve_batch(slice(start, start + POSES_PER_BATCH), row) for start in starts]
    return ArmEquilibrium(
        *(np.concatenate([getattr(e, f.name) for e in equilibria]) for f in fields(ArmEquilibrium))
    )


def undeflected_configurations(plant: Plant, q: Array) -> Array:
    """Make MuJoCo configurations with the actuated joints at q and theta = 0.

    Args:
        plant: The true arm.
        q: True joint coordinates, (runs, n) [rad, m].

    Returns:
        MuJoCo configurations, (runs, nv) [m, rad].
    """
    held = np.zeros((len(q), plant.model.nv))
    held[:, plant.joint_indices] = q
    return held


def _solve_batch(poses: PoseBatch, row: ArmCopies) -> ArmEquilibrium:
    """Solve for the equilibrium of one batch of poses."""
    plant, markers = poses.plant, poses.plant.marker_bodies.tolist()
    qpos = _newton(poses, row)
    state = evaluate_bodies(row, qpos, {plant.tool_body, *markers})
    return ArmEquilibrium(
        theta=qpos[:, plant.theta_indices],
        marker_positions=np.stack([state.body_positions[body] for body in markers], axis=1),
        tool_positions=state.body_positions[plant.tool_body],
        tool_rotations=state.body_rotations[plant.tool_body],
    )


def _force(poses: PoseBatch, state: BodyState, places: Ids) -> Array:
    """Compute the generalised force Q without springs, (some, nv) [N, N m]."""
    plant, Q = poses.plant, state.own_weight_force
    if poses.wrench.any():
        at = point_position(state, plant.tool_body, poses.point[places])
        Q = Q + generalised_force(plant, state, plant.tool_body, poses.wrench[places], at)
    return Q if poses.compensator is None else Q + compensator_force(poses.compensator, plant, state, places)


def _deflect(poses: PoseBatch, Q: Array, places: Ids) -> Array:
    """Compute the deflection under a generalised force, zero at the actuated joints, (some, nv) [m, rad]."""
    deflection, hinges = np.matvec(poses.compliance_of_poses(places), Q), poses.plant.joint_spring_indices
    if poses.joints:
        law = poses.joints.select(places)
        deflection[:, hinges] = joint_deflection(law, _torques(poses, law, Q[:, hinges]))
    return np.asarray(deflection)


def _torques(poses: PoseBatch, law: NonlinearJoints, torque: Array) -> Array:
    """Compute torques by which uncoupled joints would turn as these coupled joints do, (..., n) [N m]."""
    effects = poses.plant.spring_effects
    if effects is None or effects.joint_coupling is None:
        return torque
    return np.asarray(torque + np.matvec(effects.joint_coupling, torque) / law.compliance)


def _newton(poses: PoseBatch, row: ArmCopies) -> Array:
    """Iterate from theta = 0 to equilibrium; return the configurations, (poses, nv) [m, rad].

    A pose that has reached its equilibrium, or that has none, takes no further steps.

    Raises:
        NoEquilibrium: If a pose has none; names the first.
    """
    held, active = poses.undeflected_qpos, np.arange(len(poses.undeflected_qpos))
    qpos = held.copy()
    size: Array = np.full(len(held), np.inf)
    inverses: dict[int, Array] = {}
    lost: dict[int, str] = {}
    for k in range(1, MAX_ITERATIONS + 1):
        at, last = qpos[active], size[active]
        # Step of all active poses: theta <- C_theta Q(theta), or by a pose's own tangent.
        Q = _force(poses, evaluate_bodies(row, at, poses.loaded_bodies), active)
        step = _newton_steps(poses, inverses, held[active] + _deflect(poses, Q, active) - at, active)
        now = np.sqrt(np.vecdot(step, step))
        qpos[active], size[active] = at + step, now
        # A pose ends if its step is small, or fails if it leaves the elastic range.
        done, going = now < STEP_TOLERANCE, (now >= STEP_TOLERANCE) & (now < MAX_NEWTON_STEP)
        for i in active[~done & ~going].tolist():
            lost[i] = _no_equilibrium_text(k, size[i])
        # A slow pose gets its own tangent.
        for i in active[going & (now > last / 4)].tolist():
            inverses[i] = np.asarray(np.linalg.inv(newton_matrix(poses, row, qpos[i], i)), dtype=float)
        # An equilibrium that needed its tangent may be unstable.
        for i in inverses.keys() & set(active[done].tolist()):
            if _unstable(newton_matrix(poses, row, qpos[i], i)):
                lost[i] = f"the arm buckles: the equilibrium after {k} Newton steps is unstable"
        active = active[going]
        if not active.size:
            break
    lost |= {i: _no_equilibrium_text(MAX_ITERATIONS, size[i]) for i in active.tolist()}
    for i in sorted(lost):
        q, wrench = (
            poses.plant.arm.pose_text(held[i, poses.plant.joint_indices]),
            poses.wrench[i].round(1).tolist(),
        )
        where = f"q = {q} under wrench {wrench} N, N m"
        raise NoEquilibrium(f"{lost[i]} at {where}: too soft for its load, or buckled")
    return qpos


def _newton_steps(poses: PoseBatch, inverses: dict[int, Array], step: Array, places: Ids) -> Array:
    """Convert steps of the constant springs to Newton steps: by a pose's own tangent, or by the strut."""
    corrected = (
        step if poses.compensator is None else correct_steps_for_compensator(poses.compensator, step, places)
    )
    for i in inverses.keys() & set(places.tolist()):
        (j,) = np.flatnonzero(places == i)
        corrected[j] = inverses[i] @ step[j]
    return corrected


def newton_matrix(batch: PoseBatch, copies: ArmCopies, qpos: Array, pose_index: int) -> Array:
    """Compute Newton's matrix I - C dQ/dqpos = C (K_theta - K_w) of Eq. (7) in one pose.

    The derivatives are central differences; joints with nonlinear springs have their tangent compliance in C.

    Args:
        batch: Batch of poses that contains the pose.
        copies: Copies of the arm in one MuJoCo model.
        qpos: Configuration of the pose, (nv,) [m, rad].
        pose_index: Index of the pose in the batch.

    Returns:
        Newton's matrix, (nv, nv).
    """
    h = 1e-6
    unit = np.eye(len(qpos))
    hinges = batch.plant.joint_spring_indices
    # Central differences of Q over every coordinate.
    around = np.concatenate([qpos[None], qpos + h * unit, qpos - h * unit])
    Q = _force(batch, evaluate_bodies(copies, around, batch.loaded_bodies), np.full(len(around), pose_index))
    ahead, behind = Q[1 : len(unit) + 1], Q[len(unit) + 1 :]
    C = batch.compliance_of_poses(np.array([pose_index])).reshape(unit.shape).copy()
    if batch.joints:
        # With joint laws the slope of each joint replaces its compliance.
        law = batch.joints.select(slice(pose_index, pose_index + 1))
        steep = joint_tangent_compliance(law, _torques(batch, law, Q[:1, hinges]))[0]
        C[np.ix_(hinges, hinges)] *= (steep / law.compliance)[:, None]
        C[hinges, hinges] = steep
    return np.asarray(unit - C @ (ahead - behind).T / (2 * h))


def _unstable(C_K: Array) -> bool:
    """Tell whether K_theta - K_w has an eigenvalue not above zero: C (K_theta - K_w) has the same signs.

    It is checked only if Newton needed the tangent: theta <- C Q(theta) moves away from an unstable point,
    unless the arm is so symmetric that nothing pushes it.
    """
    return bool(np.linalg.eigvals(C_K).real.min() <= 0)


def _no_equilibrium_text(steps: int, size: float) -> str:
    return f"no static equilibrium in {steps} Newton steps, the last one {size:.3g} m or rad"


def solve_linear_equilibrium(plant: Plant, q: Array, wrench: Array, point: Array) -> ArmEquilibrium:
    """Compute the first-order equilibrium of a weightless arm, theta = C_theta J_F^T w with J_F at theta = 0.

    Args:
        plant: The true arm; nonlinear joints, offsets and load errors do not count.
        q: Joint coordinates, (runs, n) [rad, m].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Point where the force acts, in the tool's frame, (runs, 3) [m].

    Returns:
        The equilibria, with marker positions and tool poses to first order in theta.

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    wrench = check_array(wrench, (len(q), 6), "wrench [N, N m]")
    point = check_array(point, (len(q), 3), "point [m]")
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few truths are linear

    tool, markers = plant.tool_body, plant.marker_bodies.tolist()

    def solve_runs(runs: slice, copies: ArmCopies) -> ArmEquilibrium:
        """Compute the first-order equilibria of some runs: one step from the undeflected arm.

        Args:
            runs: Slice of the runs.
            copies: Copies of the arm in one MuJoCo model.

        Returns:
            Equilibria of these runs.
        """
        state = evaluate_bodies(copies, undeflected_configurations(plant, q[runs]), {tool, *markers})
        at = point_position(state, tool, point[runs])
        Q = generalised_force(plant, state, tool, wrench[runs], at)
        theta = np.matvec(plant.compliance(q[runs]), Q)
        moved = {body: _body_motion(plant, state, body, theta) for body in (*markers, tool)}
        positions = {body: state.body_positions[body] + shift for body, (shift, _) in moved.items()}
        return ArmEquilibrium(
            theta=theta[:, plant.theta_indices],
            marker_positions=np.stack([positions[body] for body in markers], axis=1),
            tool_positions=positions[tool],
            tool_rotations=Rotation.from_rotvec(moved[tool][1]).as_matrix() @ state.body_rotations[tool],
        )

    return _solve_in_batches(plant, len(q), solve_runs)
