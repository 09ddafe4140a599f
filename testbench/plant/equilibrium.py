"""Static equilibrium of the elastic arm, many poses at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from testbench.errors import Array, check_array
from testbench.plant.build import Index, Plant
from testbench.plant.newton import Poses, Statics, newton
from testbench.plant.state import Row, State, evaluate, generalised_force, open_row, place

TOGETHER = 512  #: Poses that take their Newton steps together: enough for numpy, few for memory.


@dataclass(frozen=True)
class Equilibrium:
    """Poses of the arm at rest under a load."""

    theta: Array  #: Virtual joint coordinates, (runs, n_theta) [m, rad].
    markers: Array  #: Marker positions in the world, (runs, m, 3) [m].
    tool: Array  #: Tool positions in the world, (runs, 3) [m].
    rotation: Array  #: Tool orientations, world from tool, (runs, 3, 3) [1].
    residual: Array  #: Largest generalised force out of balance, (runs,) [N, N m].
    step: Array  #: Last Newton step, (runs,) [m, rad].
    iterations: Index  #: Newton steps taken, (runs,).


PoseStatics = Callable[[Poses, Row], Statics]
"""Forces and springs of some poses."""


def settle(plant: Plant, q: Array, wrench: Array | None = None, point: Array | None = None) -> Equilibrium:
    """Static equilibrium of every pose under the arm's own weight and a wrench at the tool.

    The wrench keeps its direction in the world and acts at a point fixed in the tool, as a hung weight
    does; without one the arm's own weight is left, without a point it acts at the tool's origin.

    Raises:
        NoEquilibrium: When the arm is too soft for its load; names the pose.
    """
    return settle_by(linear_statics, plant, q, wrench, point)


def settle_by(
    statics: PoseStatics, plant: Plant, q: Array, wrench: Array | None, point: Array | None
) -> Equilibrium:
    """Static equilibrium of every pose, as `settle`, under the forces and springs of `statics`."""
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    runs = len(q)
    wrench = np.zeros((runs, 6)) if wrench is None else check_array(wrench, (runs, 6), "wrench [N, N m]")
    point = np.zeros((runs, 3)) if point is None else check_array(point, (runs, 3), "point [m]")

    def settled(run: slice, row: Row) -> Equilibrium:
        poses = Poses(plant, run, hold(plant, q[run]), wrench[run], point[run])
        return _settle(statics(poses, row), poses, row)

    return in_parts(plant, runs, settled)


def in_parts(plant: Plant, runs: int, settled: Callable[[slice, Row], Equilibrium]) -> Equilibrium:
    """Equilibria of all runs, from those of parts of them."""
    row = open_row(plant)
    found = [settled(slice(start, start + TOGETHER), row) for start in range(0, max(runs, 1), TOGETHER)]
    return Equilibrium(*(np.concatenate([getattr(e, f.name) for e in found]) for f in fields(Equilibrium)))


def part_of(rest: Equilibrium, some: slice) -> Equilibrium:
    """Some runs of an equilibrium."""
    return Equilibrium(*(getattr(rest, f.name)[some] for f in fields(Equilibrium)))


def hold(plant: Plant, q: Array) -> Array:
    """Configurations with the actuated joints at q and theta = 0, (runs, nv)."""
    held = np.zeros((len(q), plant.model.nv))
    held[:, plant.joints] = q
    return held


def unloaded(plant: Plant, q: Array, names: Sequence[str]) -> list[tuple[Array, Array]]:
    """Where MuJoCo places bodies of the elastic arm at theta = 0.

    Returns:
        Of each body its origin in the world, (runs, 3) [m], and world from body, (runs, 3, 3).
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    bodies = [int(plant.model.body(name).id) for name in names]
    state = evaluate(open_row(plant), hold(plant, q), set(bodies))
    return [(state.position[body], state.rotation[body]) for body in bodies]


def _settle(statics: Statics, poses: Poses, row: Row) -> Equilibrium:
    """Equilibrium of poses that take their Newton steps together."""
    plant, markers = poses.plant, poses.plant.markers.tolist()
    qpos, step, iterations = newton(statics, poses, row)
    every = np.arange(len(qpos))
    state = evaluate(row, qpos, {*statics.bodies, plant.tool, *markers})
    Q = statics.force(state, every)
    unbalanced = Q + statics.springs(qpos, Q, every)
    free = np.setdiff1d(np.arange(plant.model.nv), plant.joints)
    return Equilibrium(
        theta=qpos[:, plant.theta],
        markers=np.stack([state.position[body] for body in markers], axis=1),
        tool=state.position[plant.tool],
        rotation=state.rotation[plant.tool],
        residual=np.abs(unbalanced[:, free]).max(axis=1),
        step=step,
        iterations=iterations,
    )


def linear_statics(poses: Poses, _: Row) -> Statics:
    """The plant's own weight and linear springs, and a wrench at a point of its tool."""
    plant, loaded = poses.plant, bool(poses.wrench.any())

    def force(state: State, some: Index) -> Array:
        if not loaded:
            return state.weight
        at = place(state, plant.tool, poses.point[some])
        return state.weight + generalised_force(plant, state, plant.tool, poses.wrench[some], at)

    return Statics(
        force=force,
        deflect=lambda Q, _: np.matvec(plant.C, Q),
        compliance=lambda Q, _: np.broadcast_to(plant.C, (len(Q), *plant.C.shape)),
        springs=lambda qpos, _, __: -np.matvec(plant.K, qpos),
        bodies=(plant.tool,) if loaded else (),
    )
