"""The true arm of a trial: measured in campaigns, and put to work."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from testbench.bench.campaign import Cell, settle_both, stream
from testbench.data.dataset import Dataset, Ids
from testbench.data.tracker import Tracker, read_positions
from testbench.errors import Array
from testbench.plant import TYPICAL, DisturbedPlant, Equilibrium, disturb, settle_pair
from testbench.studies.compensation.plans import loads
from testbench.studies.compensation.settings import IDEAL, LINEAR, PLANNED, RUNS, SIGMA, WEIGHT, Settings, Way

Settle = Callable[[Array, Array, Array], tuple[Equilibrium, Equilibrium]]
"""The arm unloaded and loaded, in poses (runs, n), under wrenches (runs, 6) at points (runs, 3)."""
CHOSEN, NOISE = 30, 1000  #: Streams of a seed: random poses, and noise, plus the number of the campaign.
HIDDEN = 20  #: Stream of what disturbs the arm.
LINEAR_JOINTS = replace(TYPICAL, stiffening=0.0, backlash=0.0, hysteresis=0.0)


@dataclass(frozen=True)
class TrueArm:
    """As it is measured, and as it works: a weight unlike the recorded one is no force of the process."""

    measured: Settle
    working: Settle


def true_arm(cell: Cell, seed: int, arm: str) -> TrueArm:
    """The arm of the cell's truth, one of ARMS."""
    if arm == IDEAL:
        own = partial(settle_both, cell.plant, "nonlinear")
        return TrueArm(own, own)
    found = disturb(cell.plant, LINEAR_JOINTS if arm == LINEAR else TYPICAL, stream(seed, HIDDEN))
    return TrueArm(partial(settle_pair, found), partial(settle_pair, exactly_loaded(found)))


def exactly_loaded(found: DisturbedPlant) -> DisturbedPlant:
    """The same under loads exactly as recorded."""
    exact = replace(found.disturbances, mass_error=0.0, centre_error=0.0)
    return replace(found, disturbances=exact, centre=np.zeros(3))


def chosen(asked: Settings, way: Way, seed: int) -> tuple[Array, Ids]:
    """Poses to measure, (poses, n) [rad], and which load acts in each, (poses,).

    Fewer random poses are the first of more, with the loads by turns.
    """
    scene = asked.scene
    if way.by == PLANNED:
        plan = next(p for p in scene.plans if (p.loads, p.poses) == (way.loads, way.poses))
        return np.array(plan.q_rad).reshape(way.poses, -1), np.array(plan.load)
    every = stream(seed, CHOSEN).choice(len(scene.candidates), max(asked.numbers), replace=False)
    load = np.zeros(way.poses, dtype=int) if way.loads == WEIGHT else np.arange(way.poses) % 2
    return np.array(scene.candidates)[every[: way.poses]], load


def measure(cell: Cell, arm: TrueArm, asked: Settings, ways: Sequence[Way], seed: int) -> list[Dataset]:
    """Readings of campaigns, every pose RUNS times."""
    wrench, point = (np.stack([getattr(one, key) for one in loads(cell)]) for key in ("wrench", "point"))
    every = [chosen(asked, way, seed) for way in ways]
    q, load = (np.concatenate([np.repeat(own[k], RUNS, axis=0) for own in every]) for k in (0, 1))
    before, after = arm.measured(q, wrench[load], point[load])
    found, first = [], 0
    for k, way in enumerate(ways):
        runs = slice(first, first := first + RUNS * way.poses)
        rng, tracker = stream(seed, NOISE + k), Tracker(SIGMA)
        data = Dataset(
            markers=cell.arm.markers,
            run=np.arange(RUNS * way.poses) + 1,
            pose=np.repeat(np.arange(way.poses) + 1, RUNS),
            q=q[runs],
            wrench=wrench[load[runs]],
            point=point[load[runs]],
            before=read_positions(tracker, before.markers[runs], rng),
            after=read_positions(tracker, after.markers[runs], rng),
            sigma=SIGMA,
        )
        found.append(data)
    return found
