"""Static equilibrium of the elastic arm in many poses, by Newton's method on MuJoCo's generalised forces.

With the actuated joints held, theta is in equilibrium if

    K_theta theta = Q(theta),

with Q the generalised force of own weight and loads. Newton's matrix is K_theta - K_w, Eq. (7). K_w is small
for an arm that can carry its load, so the constant K_theta suffices at first: theta <- C_theta Q(theta) gains
two digits per step. If a step of a pose gains less than a factor of four, its tangent is computed by finite
differences.

The result of a pose does not depend on the other poses of a batch. Each pose takes its own steps and stops by
itself, and matrices multiply its vectors one by one, because BLAS rounds a product of two matrices by their
sizes.

A gravity compensator is a spring from link 1 to link 2 that supports joint 2. With length s, the strut pulls
its ends together by F = rate (s_held - rest_length) + stiffness (s - s_held), where s_held is its length in
the held, undeflected pose. It has two slopes. As joint 2 turns, it moves the piston, and only gas or coils
push back. Under a payload the piston moves by tenths of a millimetre, and seal friction or a closed column
of oil may make it far stiffer. Equal slopes, the default, are the plain spring. The equivalent stiffness at
joint 2 is K_eq = stiffness s'^2 + F s'', with derivatives with respect to q_2. It nearly vanishes where the
strut points at the axis, and is largest where the strut is perpendicular to its lever.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np

from testbench.arm.folder import Compensator
from testbench.errors import Array, BenchError, Ids, NoEquilibrium, check_array
from testbench.plant.build import Plant
from testbench.plant.disturbance import (
    SpringEffects,
    TrueJointLaws,
    gear_error,
    joint_deflection,
    joint_tangent_compliance,
)
from testbench.progress import stepwise

# --- Poses evaluated by MuJoCo, many at once, and generalised forces of loads on bodies ---------------------


@dataclass(frozen=True)
class BodyState:
    """Hold gravity forces and Jacobians of some poses, and the poses of requested bodies, by their ids."""

    weight: Array  #: Generalised force of the arm's own weight, (poses, nv) [N, N m].
    #: Rotation, and motion at `centre`, per unit of every coordinate: MuJoCo's cdof, (poses, nv, 6) [1, m].
    motion: Array
    centre: Array  #: Reference point of `motion` in the world, (poses, 3) [m].
    position: dict[int, Array]  #: Position of every body in the world, (poses, 3) each [m].
    rotation: dict[int, Array]  #: World from body, (poses, 3, 3) each [1].


@dataclass(frozen=True)
class ArmCopies:
    """Hold the copies of the arm in one MuJoCo state; every call of `solve_equilibrium` has its own."""

    model: mujoco.MjModel
    data: mujoco.MjData
    qpos: Array  #: Configuration of every arm, (arms, nv) [m, rad].
    motion: Array  #: Motion, as in `BodyState`, (arms, nv, 6).
    centre: Array  #: Reference point, as in `BodyState`, (arms, 3).
    position: Array  #: Position of every body but the world: body b is at b - 1, (arms, bodies, 3) [m].
    rotation: Array  #: World from body, (arms, bodies, 3, 3) [1].


def create_arm_copies(plant: Plant) -> ArmCopies:
    """Create the state of a MuJoCo model with several copies of the plant's arm, and views of it per copy."""
    model = plant.model_of_copies
    data = mujoco.MjData(model)
    nv = plant.model.nv
    bodies = plant.model.nbody - 1
    root = plant.model.body_rootid[plant.tool]
    return ArmCopies(
        model=model,
        data=data,
        qpos=data.qpos.reshape(-1, nv),
        motion=data.cdof.reshape(-1, nv, 6),
        centre=data.subtree_com[1:].reshape(-1, bodies, 3)[:, root - 1],
        position=data.xpos[1:].reshape(-1, bodies, 3),
        rotation=data.xmat[1:].reshape(-1, bodies, 3, 3),
    )


def evaluate(row: ArmCopies, qpos: Array, bodies: Collection[int] = ()) -> BodyState:
    """Compute gravity force, Jacobian and body poses of configurations in MuJoCo, several at a time.

    Velocities are zero, so of MuJoCo's forward pass only kinematics and the bias force are needed.

    Args:
        row: Copies of the arm in one MuJoCo model.
        qpos: Configurations, (poses, nv) [m, rad].
        bodies: Ids of the requested bodies; without any, `motion` and `centre` are left out.

    Returns:
        Poses of the bodies, and the generalised force of the arm's own weight.
    """
    model = row.model
    data = row.data
    arms, nv = row.qpos.shape
    poses, room = len(qpos), -(-len(qpos) // arms) * arms
    bias = np.empty((room, nv))
    placed = room if bodies else 0
    motion, centre = np.empty((placed, nv, 6)), np.empty((placed, 3))
    position = {body: np.empty((room, 3)) for body in bodies}
    rotation = {body: np.empty((room, 3, 3)) for body in bodies}
    # One call of MuJoCo for each row of arms; the last row is filled up.
    for start in range(0, room, arms):
        part = slice(start, start + arms)
        row.qpos[: poses - start] = qpos[part]
        mujoco.mj_fwdKinematics(model, data)
        mujoco.mj_rne(model, data, 0, bias[part].reshape(-1))
        if bodies:
            motion[part], centre[part] = row.motion, row.centre
        for body in bodies:
            position[body][part], rotation[body][part] = row.position[:, body - 1], row.rotation[:, body - 1]
    return BodyState(
        weight=-bias[:poses],
        motion=motion[:poses],
        centre=centre[:poses],
        position={body: p[:poses] for body, p in position.items()},
        rotation={body: R[:poses] for body, R in rotation.items()},
    )


def point_position(state: BodyState, body: int, point: Array) -> Array:
    """Compute the world position of a point of a body in every pose.

    Args:
        state: The poses.
        body: Number of the body.
        point: Point in the body's frame, (3,) or (poses, 3) [m].

    Returns:
        Position, (poses, 3) [m].
    """
    return np.asarray(state.position[body] + np.matvec(state.rotation[body], point))


def generalised_force(plant: Plant, state: BodyState, body: int, wrench: Array, point: Array) -> Array:
    """Compute the generalised force J^T w of a wrench on a body at a world point.

    Args:
        plant: The arm.
        state: Its poses.
        body: The body's id.
        wrench: Force and moment, world axes, (poses, 6) [N, N m].
        point: Point where the force acts, world axes, (poses, 3) [m].

    Returns:
        (poses, nv) [N, N m].
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    about_centre = moment + _cross(point - state.centre, force)
    Q = np.matvec(state.motion, np.concatenate([about_centre, force], axis=1))
    return np.asarray(Q * plant.joint_moves[body])


def body_motion(plant: Plant, state: BodyState, body: int, theta: Array) -> tuple[Array, Array]:
    """Compute how a body's origin moves and how the body rotates under small deflections, J theta.

    Args:
        plant: The arm.
        state: Its poses.
        body: The body's id.
        theta: Deflection in MuJoCo's coordinates, (poses, nv) [m, rad].

    Returns:
        Translation [m] and rotation vector [rad], world axes, (poses, 3) each.
    """
    twist = np.vecmat(theta * plant.joint_moves[body], state.motion)
    turn, shift = twist[:, :3], twist[:, 3:]
    return shift + _cross(turn, state.position[body] - state.centre), turn


def _cross(a: Array, b: Array) -> Array:
    """Compute vector products a x b, (poses, 3): np.cross takes five times as long."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


# --- A gravity compensator: a spring from link 1 to link 2 that supports joint 2 ----------------------------


@dataclass(frozen=True)
class CompensatorState:
    """Hold the constants of a gravity compensator in some held poses, theta = 0."""

    spring: Compensator
    stiffness: float  #: Change of force over change of length as the arm deflects [N/m].
    bodies: tuple[int, int]  #: Ids of the bodies on which it is hinged.
    length_fixed: Array  #: Length in the held poses, theta = 0, (poses,) [m].
    C_g: Array  #: C g with g = ds / dqpos in the held poses, (poses, nv).
    share: Array  #: k g / (1 + k g . C g) with k the stiffness, for Sherman and Morrison, (poses, nv).


def compensator_bodies(plant: Plant) -> tuple[int, int]:
    """Find the bodies that the compensator connects, links 1 and 2, by their ids in MuJoCo.

    Raises:
        BenchError: If the arm has fewer than two joints, or joint 2 is prismatic.
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


def strut(compensator: Compensator, plant: Plant, state: BodyState) -> CompensatorState:
    """Compute the gravity compensator in held poses, theta = 0.

    Args:
        compensator: The compensator.
        plant: The plant that it is attached to.
        state: The held poses.

    Returns:
        The compensator, with the constants of these poses.
    """
    ends = compensator_bodies(plant)
    hinges = _hinges(compensator, ends, state)
    held = _length(hinges)
    g = _strut_load(plant, ends, state, hinges, np.full(len(held), -1.0))
    C_g = np.matvec(plant.C, g)
    k = compensator.rate if compensator.stiffness is None else compensator.stiffness
    share = (k / (1 + k * np.vecdot(g, C_g)))[:, None] * g
    return CompensatorState(compensator, k, ends, held, C_g, share)


def compensator_force(strut: CompensatorState, plant: Plant, state: BodyState, poses: Ids) -> Array:
    """Compute the generalised force of the compensator in the present poses.

    Mathematics: `law-10`.

    Args:
        strut: The compensator.
        plant: The plant.
        state: The present poses.
        poses: Places of the requested poses, (poses,).

    Returns:
        Force on every degree of freedom, (some, nv) [N, N m].
    """
    spring, held = strut.spring, strut.length_fixed[poses]
    hinges = _hinges(spring, strut.bodies, state)
    force = spring.rate * (held - spring.rest_length) + strut.stiffness * (_length(hinges) - held)
    return _strut_load(plant, strut.bodies, state, hinges, force)


def correct_steps_for_compensator(strut: CompensatorState, step: Array, poses: Ids) -> Array:
    """Correct steps of the arm's own springs for the stiffness of the compensator.

    It applies the inverse of C (C^-1 + k g g^T) of the held pose, by Sherman and Morrison.

    Args:
        strut: The compensator.
        step: Steps without it, (some, nv) [m, rad].
        poses: Places of the poses, (poses,).

    Returns:
        Steps with it, (some, nv) [m, rad].
    """
    along = np.vecdot(strut.share[poses], step)
    return np.asarray(step - along[:, None] * strut.C_g[poses])


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
    Q = np.zeros(state.weight.shape)
    for body, point, pulled in zip(ends, hinges, (along, -along), strict=True):
        wrench = np.concatenate([pulled, np.zeros_like(pulled)], axis=1)
        Q += generalised_force(plant, state, body, wrench, point)
    return Q


# --- Static equilibrium of the elastic arm in many poses ----------------------------------------------------

POSES_AT_ONCE = 512
"""Poses per batch: enough for numpy, few for memory."""
STEP_TOLERANCE = 1e-9  #: A pose is in equilibrium when the last Newton step is below this [m, rad].
MAX_ITERATIONS = 50
MAX_DEFLECTION = 0.5
"""Virtual joint coordinate beyond which a deflection is no longer elastic [m, rad]."""


@dataclass(frozen=True)
class ArmEquilibrium:
    """Hold poses of the arm at rest under a load."""

    theta: Array  #: Virtual joint coordinates, (runs, n_theta) [m, rad].
    markers: Array  #: Marker positions in the world, (runs, m, 3) [m].
    tool: Array  #: Tool positions in the world, (runs, 3) [m].
    rotation: Array  #: Tool orientations, world from tool, (runs, 3, 3) [1].


@dataclass(frozen=True)
class PoseBatch:
    """Hold the poses of one batch with their loads and elasticity; methods take indices of poses."""

    plant: Plant
    q_fixed: Array  #: Configuration with the actuated joints at their angles and theta = 0, (poses, nv).
    wrench: Array  #: Force and moment, world axes, (poses, 6) [N, N m].
    point: Array  #: Point where the force acts, in the tool's frame, (poses, 3) [m].
    C: Array  #: Compliance, one per pose or the same in all, (poses, nv, nv) or (nv, nv).
    law: TrueJointLaws | None = None  #: Nonlinear joint laws; None for MuJoCo's linear springs.
    strut: CompensatorState | None = None  #: A gravity compensator.

    @property
    def bodies(self) -> tuple[int, ...]:
        """Return ids of the bodies on which loads act, own weight excluded."""
        tool = (self.plant.tool,) if self.wrench.any() else ()
        return tool if self.strut is None else (*tool, *self.strut.bodies)

    def compliance_in(self, poses: Ids) -> Array:
        """Return the compliance in some of the poses.

        Args:
            poses: Indices of the poses, (k,).

        Returns:
            Compliance, (k, nv, nv) [m/N, rad/N, rad/(N m)]; (nv, nv) if all poses share one.
        """
        return self.C if self.C.ndim == 2 else self.C[poses]


def solve_equilibrium(
    plant: Plant,
    q: Array,
    wrench: Array | None = None,
    point: Array | None = None,
    *,
    before: ArmEquilibrium | None = None,
) -> ArmEquilibrium:
    """Find the static equilibrium of every pose under the arm's own weight and a wrench at the tool.

    The wrench keeps its direction in the world and acts at a point fixed in the tool, as a hung weight
    does; without one the arm's own weight is left, without a point it acts at the tool's origin.

    Mathematics: `loaded-9`.

    Args:
        plant: The arm, with its disturbances.
        q: Commanded joint angles, (runs, n) [rad, m].
        wrench: Recorded force and moment, world axes, (runs, 6) [N, N m].
        point: Where it is recorded to act, in the tool's frame, (runs, 3) [m].
        before: Poses at rest before this load, for the friction in its joints; None for joints that
            have just moved to the pose and hold back nothing.

    Returns:
        The poses at rest; theta is measured from the true joint angles.

    Raises:
        NoEquilibrium: When the arm is too soft for its load; names the pose.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    runs, changes = len(q), plant.disturbances
    wrench = np.zeros((runs, 6)) if wrench is None else check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = np.zeros((runs, 3)) if point is None else check_array(point, (runs, 3), "point [m]")
    # The true load and joint angles, as far as the disturbances change them.
    wrench = wrench * (1 + changes.mass_error)
    point = point + plant.load_point_error
    law = _law(plant, runs, before)
    true_q = q + plant.joint_offset + (0.0 if plant.gears is None else gear_error(plant.gears, q))

    def equilibrium_of_runs(part: slice, row: ArmCopies) -> ArmEquilibrium:
        """Find the equilibrium of the runs of one batch.

        Args:
            part: Runs of the batch.
            row: Copies of the arm, one per run.
        """
        held, C = undeflected_configurations(plant, true_q[part]), plant.compliance(q[part])
        poses = PoseBatch(plant, held, wrench[part], point[part], C, law and law.select(part))
        if changes.compensator is not None:
            state = evaluate(row, poses.q_fixed, compensator_bodies(plant))
            poses = replace(poses, strut=strut(changes.compensator, plant, state))
        return _solve_batch(poses, row)

    return solve_in_batches(plant, runs, equilibrium_of_runs)


def _law(plant: Plant, runs: int, before: ArmEquilibrium | None) -> TrueJointLaws | None:
    """Make the joint laws of all runs; None for MuJoCo's linear springs."""
    if before is not None:
        check_array(before.theta, (runs, plant.arm.n_theta), "theta before [m, rad]")
    changes, effects = plant.disturbances, plant.spring_effects or SpringEffects()
    sizes = changes.stiffening, changes.backlash, changes.hysteresis
    if not any(sizes) and effects.slip is None and effects.law is None:
        return None
    return TrueJointLaws(
        compliance=np.array([joint.compliance for joint in plant.arm.joints]),
        stiffening=changes.stiffening,
        backlash=changes.backlash,
        hysteresis=changes.hysteresis,
        start_deflection=None if before is None else before.theta[:, 6 * len(plant.arm.links) :],
        slip=effects.slip,
        user_law=effects.law,
    )


def solve_unloaded_and_loaded(
    plant: Plant, q: Array, wrench: Array, point: Array
) -> tuple[ArmEquilibrium, ArmEquilibrium]:
    """Find the equilibria of the arm without a load, then with the load put on in the same pose.

    Args:
        plant: The true arm.
        q: Commanded joint angles, (runs, n) [rad, m].
        wrench: Force and moment in world axes, (runs, 6) [N, N m].
        point: Point where the force acts in the tool's frame, (runs, 3) [m].

    Returns:
        The unloaded and the loaded equilibria.
    """
    rest = solve_equilibrium(plant, q)
    return rest, solve_equilibrium(plant, q, wrench, point, before=rest)


def solve_in_batches(
    plant: Plant, runs: int, solve: Callable[[slice, ArmCopies], ArmEquilibrium]
) -> ArmEquilibrium:
    """Find the equilibria of all runs in batches of POSES_AT_ONCE, which limits the memory.

    Args:
        plant: The true arm.
        runs: Number of runs.
        solve: Function that finds the equilibria of the runs of a slice with the given copies of the arm.

    Returns:
        Equilibria of all runs, in their order.
    """
    row = create_arm_copies(plant)
    starts = stepwise(range(0, max(runs, 1), POSES_AT_ONCE), "settling the arm")
    equilibria = [solve(slice(start, start + POSES_AT_ONCE), row) for start in starts]
    return ArmEquilibrium(
        *(np.concatenate([getattr(e, f.name) for e in equilibria]) for f in fields(ArmEquilibrium))
    )


def undeflected_configurations(plant: Plant, q: Array) -> Array:
    """Make configurations with the actuated joints at q and theta = 0.

    Args:
        plant: The plant.
        q: Joint angles, (runs, n) [rad, m].

    Returns:
        MuJoCo configurations, (runs, nv) [m, rad].
    """
    held = np.zeros((len(q), plant.model.nv))
    held[:, plant.joints] = q
    return held


def _solve_batch(poses: PoseBatch, row: ArmCopies) -> ArmEquilibrium:
    """Solve for the equilibrium of one batch of poses."""
    plant, markers = poses.plant, poses.plant.markers.tolist()
    qpos = _newton(poses, row)
    state = evaluate(row, qpos, {plant.tool, *markers})
    return ArmEquilibrium(
        theta=qpos[:, plant.theta],
        markers=np.stack([state.position[body] for body in markers], axis=1),
        tool=state.position[plant.tool],
        rotation=state.rotation[plant.tool],
    )


def _force(poses: PoseBatch, state: BodyState, places: Ids) -> Array:
    """Compute the generalised force Q without springs, (some, nv) [N, N m]."""
    plant, Q = poses.plant, state.weight
    if poses.wrench.any():
        at = point_position(state, plant.tool, poses.point[places])
        Q = Q + generalised_force(plant, state, plant.tool, poses.wrench[places], at)
    return Q if poses.strut is None else Q + compensator_force(poses.strut, plant, state, places)


def _deflect(poses: PoseBatch, Q: Array, places: Ids) -> Array:
    """Compute the deflection under a generalised force, zero at the actuated joints, (some, nv) [m, rad]."""
    deflection, hinges = np.matvec(poses.compliance_in(places), Q), poses.plant.hinges
    if poses.law:
        law = poses.law.select(places)
        deflection[:, hinges] = joint_deflection(law, _torques(poses, law, Q[:, hinges]))
    return np.asarray(deflection)


def _torques(poses: PoseBatch, law: TrueJointLaws, torque: Array) -> Array:
    """Compute torques by which uncoupled joints would turn as these coupled joints do, (..., n) [N m]."""
    effects = poses.plant.spring_effects
    if effects is None or effects.joint_coupling is None:
        return torque
    return np.asarray(torque + np.matvec(effects.joint_coupling, torque) / law.compliance)


def _newton(poses: PoseBatch, row: ArmCopies) -> Array:
    """Iterate the virtual joints from `held` to equilibrium; return the configurations, (poses, nv) [m, rad].

    A pose in equilibrium, or without one, takes no further steps.

    Raises:
        NoEquilibrium: If a pose has none; names the first.
    """
    held, active = poses.q_fixed, np.arange(len(poses.q_fixed))
    qpos = held.copy()
    size: Array = np.full(len(held), np.inf)
    inverses: dict[int, Array] = {}
    lost: dict[int, str] = {}
    for k in range(1, MAX_ITERATIONS + 1):
        at, last = qpos[active], size[active]
        # Step of all active poses: theta <- C_theta Q(theta), or by a pose's own tangent.
        Q = _force(poses, evaluate(row, at, poses.bodies), active)
        step = _newton_steps(poses, inverses, held[active] + _deflect(poses, Q, active) - at, active)
        now = np.sqrt(np.vecdot(step, step))
        qpos[active], size[active] = at + step, now
        # A pose ends if its step is small, or fails if it leaves the elastic range.
        done, going = now < STEP_TOLERANCE, (now >= STEP_TOLERANCE) & (now < MAX_DEFLECTION)
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
        q, wrench = poses.plant.arm.pose_text(held[i, poses.plant.joints]), poses.wrench[i].round(1).tolist()
        where = f"q = {q} under wrench {wrench} N, N m"
        raise NoEquilibrium(f"{lost[i]} at {where}: too soft for its load, or buckled")
    return qpos


def _newton_steps(poses: PoseBatch, inverses: dict[int, Array], step: Array, places: Ids) -> Array:
    """Convert steps of the constant springs to Newton steps: by a pose's own tangent, or by the strut."""
    corrected = step if poses.strut is None else correct_steps_for_compensator(poses.strut, step, places)
    for i in inverses.keys() & set(places.tolist()):
        (j,) = np.flatnonzero(places == i)
        corrected[j] = inverses[i] @ step[j]
    return corrected


def newton_matrix(poses: PoseBatch, row: ArmCopies, qpos: Array, pose: int) -> Array:
    """Compute I - C dQ/dqpos = C (K_theta - K_w) of Eq. (7) in one pose, by central differences.

    Args:
        poses: The poses.
        row: Arms in one MuJoCo model that are evaluated at once.
        qpos: Configuration of the pose, (nv,) [m, rad].
        pose: Its number.

    Returns:
        The tangent, (nv, nv).
    """
    h = 1e-6
    unit = np.eye(len(qpos))
    hinges = poses.plant.hinges
    # Central differences of Q over every coordinate.
    around = np.concatenate([qpos[None], qpos + h * unit, qpos - h * unit])
    Q = _force(poses, evaluate(row, around, poses.bodies), np.full(len(around), pose))
    ahead, behind = Q[1 : len(unit) + 1], Q[len(unit) + 1 :]
    C = poses.compliance_in(np.array([pose])).reshape(unit.shape).copy()
    if poses.law:
        # With joint laws the slope of each joint replaces its compliance.
        law = poses.law.select(slice(pose, pose + 1))
        steep = joint_tangent_compliance(law, _torques(poses, law, Q[:1, hinges]))[0]
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
    """Compute the first-order equilibrium of a weightless arm: theta = C_theta J_F^T w at theta = 0.

    Args:
        plant: The plant.
        q: Joint angles, (runs, n) [rad, m].
        wrench: Force and moment in world axes, (runs, 6) [N, N m].
        point: Point where the force acts in the tool's frame, (runs, 3) [m].

    Returns:
        The displaced poses.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    wrench = check_array(wrench, (len(q), 6), "wrench [N, N m]")
    point = check_array(point, (len(q), 3), "point [m]")

    return solve_in_batches(
        plant,
        len(q),
        lambda part, row: _linear_equilibrium(plant, row, q[part], wrench[part], point[part]),
    )


def _linear_equilibrium(
    plant: Plant, row: ArmCopies, q: Array, wrench: Array, point: Array
) -> ArmEquilibrium:
    """Compute the equilibrium of the linear model: one step from the undeflected arm."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few truths are linear

    tool, markers = plant.tool, plant.markers.tolist()
    state = evaluate(row, undeflected_configurations(plant, q), {tool, *markers})
    at = point_position(state, tool, point)
    theta = np.matvec(plant.compliance(q), generalised_force(plant, state, tool, wrench, at))
    places = [state.position[body] + body_motion(plant, state, body, theta)[0] for body in (*markers, tool)]
    turned = Rotation.from_rotvec(body_motion(plant, state, tool, theta)[1]).as_matrix()
    return ArmEquilibrium(
        theta=theta[:, plant.theta],
        markers=np.stack(places[:-1], axis=1),
        tool=places[-1],
        rotation=turned @ state.rotation[tool],
    )
