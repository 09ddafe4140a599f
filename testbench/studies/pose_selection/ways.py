"""Ways to measure: one weight and three markers, or more; in planned poses, or in random ones."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.campaign import Cell, stream
from testbench.bench.plan import hung
from testbench.bench.wrong_prior import UNCERTAINTY
from testbench.data.dataset import Ids
from testbench.design.rows import Experiment
from testbench.design.specification import Specification, Tasks
from testbench.errors import Array
from testbench.identify.identifiability_help import OFFSET, with_marker
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.studies.pose_selection.rows import PlanRow
from testbench.studies.pose_selection.settings import PLANNED, RANDOM, Fit, Settings

MORE = 4  #: Further poses: the yardstick of what else could be done.
CHANCE = 300  #: Stream of a seed for random poses, plus their number.


def specify(cell: Cell, asked: Settings, prior: Prior, fit: Fit = PLANNED) -> Specification:
    """The featured number of poses under one weight, with the arm's own markers, planned for a fit.

    Without a prior of its own a fit's unknowns are still in units of the planner's.
    """
    scope, scene = asked.scope, asked.scene
    load = hung(cell, scope.payload)
    own = metric(prior, cell.vjm, fit.structure(cell.arm))
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, scope.sigma),
        loads=(load,),
        tasks=Tasks(np.array(scene.tasks), load),
        workspace=np.array(scene.workspace),
        uncertainty=UNCERTAINTY if fit.prior else None,
        poses=scope.featured,
    )


def variants(cell: Cell, asked: Settings, own: Specification) -> dict[str, Specification]:
    """The featured way to measure, and what could be done beyond it, in words.

    A second hanging point is `OFFSET` beside the first along the tool's y, a fourth marker as far off the
    plane of the three.
    """
    n, mass, every = own.poses, asked.scope.payload, own.experiment
    half, one, fourth = hung(cell, mass / 2), own.loads[0], with_marker(every.vjm, every.vjm.markers, "P4")
    beside = replace(one, point=one.point + np.array([0.0, OFFSET, 0.0]))
    found = {
        f"{n} poses, one weight, three markers": own,
        f"{MORE} more poses": replace(own, poses=n + MORE),
        "every reading taken twice": replace(own, experiment=replace(every, sigma=every.sigma / np.sqrt(2))),
        "half the weight as second load": replace(own, loads=(*own.loads, half)),
        f"a second hanging point {OFFSET:g} m beside": replace(own, loads=(*own.loads, beside)),
        "a fourth marker": replace(own, experiment=replace(every, vjm=fourth, targets=fourth.markers)),
    }
    return dict(list(found.items())[: asked.scope.variants])


@dataclass(frozen=True)
class Chosen:
    """Poses to measure, (poses, n) [rad], and which load hangs in each, (poses,)."""

    q: Array
    load: Ids


def poses_of(asked: Settings, name: str, poses: int, seed: int) -> Chosen:
    """The poses of a plan, or random ones of a trial."""
    if name == RANDOM:
        return at_random(np.array(asked.scene.candidates), poses, stream(seed, CHANCE + poses))
    return planned(asked.scene.plan(name, poses, PLANNED.name))


def planned(row: PlanRow) -> Chosen:
    """The poses of a plan."""
    return Chosen(np.array(row.q_rad).reshape(row.poses, -1), np.array(row.load))


def at_random(q: Array, poses: int, rng: np.random.Generator) -> Chosen:
    """Feasible poses without a plan."""
    return Chosen(q[rng.choice(len(q), poses, replace=False)], np.zeros(poses, dtype=int))
