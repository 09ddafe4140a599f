"""One trial: a true arm measured in every campaign, explained by every model, corrected and put to work.

The corrected joints go to the true arm in MuJoCo. The error is where its loaded tool then is, minus where the
unloaded tool is at the programmed joints.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Cell, build_cell, settle_both, stream
from testbench.campaign.evaluation import identify_each
from testbench.campaign.model_selection import choose
from testbench.campaign.models import named_models
from testbench.campaign.perturbed_prior import PRIORS, prior_of
from testbench.campaign.true_arms import FAMILY, TRUTHS, member, true_cell
from testbench.correct.arm_model import About, ArmModel, bending, of_compliances, of_estimate
from testbench.correct.compensated import compensate
from testbench.correct.newton import Aim
from testbench.data.dataset import Dataset, Ids, Mask
from testbench.data.tracker import Tracker, read_positions
from testbench.errors import Array, NoEquilibrium
from testbench.identify.absolute.state import State
from testbench.identify.intervals import Linearised
from testbench.identify.prior import Prior
from testbench.model.load import Load
from testbench.model.structure import all153
from testbench.model.weights import read_weights
from testbench.plant import TYPICAL, DisturbedPlant, Equilibrium, disturb, settle_pair
from testbench.studies.compensation.jobs import TIP, drawn, jobs, wrenches
from testbench.studies.compensation.plans import loads
from testbench.studies.compensation.settings import (
    ADVISED,
    ARMS,
    DEFAULT,
    DRAWN,
    IDEAL,
    IDENTIFIED,
    LINEAR,
    NOMINAL,
    NOWHERE,
    PERFECT,
    PLANNED,
    PRIOR,
    RUNS,
    SIGMA,
    WEIGHT,
    JobRow,
    Settings,
    Way,
)

MM = 1e3
AIM = Aim(point=TIP)  #: The whole pose of the tool is put right.
DIGITS = 7  #: Of a distance in millimetres.
HIDDEN, CHOSEN, PROCESS, NOISE = 20, 30, 50, 1000
"""Streams of a seed: disturbances, random poses, forces of the process, noise (plus the campaign)."""
LINEAR_JOINTS = replace(TYPICAL, stiffening=0.0, backlash=0.0, hysteresis=0.0)
Settle = Callable[[Array, Array, Array], tuple[Equilibrium, Equilibrium]]
"""The arm unloaded and loaded, in poses (runs, n), under wrenches (runs, 6) at points (runs, 3)."""


@dataclass(frozen=True)
class TrueArm:
    """As it is measured, and as it works: a weight unlike the recorded one is no force of the process."""

    measured: Settle
    working: Settle


@dataclass(frozen=True)
class Fit:
    """A model to correct by."""

    way: Way
    name: str
    model: ArmModel
    chosen: str | None = None  #: Of the default: what it chose.


@dataclass(frozen=True)
class Work:
    """The points of all jobs, one job after the other."""

    q: Array  #: Programmed joints, (points, n) [rad].
    load: Load  #: Of the process, with a row a point.
    parts: tuple[slice, ...]  #: Points of every job.
    sizes: tuple[float, ...]  #: Forces of every job [N].


@dataclass(frozen=True)
class Order:
    """What is commanded."""

    q: Array  #: Corrected joints, (points, n) [rad].
    half: Array | None  #: Half the 95 % interval of what is left, world, (points, 3) [m]; None without any.
    solved: Mask  #: Points that are put right, (points,).
    buckled: bool = False  #: Whether the model has no equilibrium there.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[JobRow]]:
    """Rows of some seeds; `asked` holds the scene."""
    cell = build_cell(find_arm(asked.arm))
    return [_trial(cell, asked, seed) for seed in seeds]


def _trial(cell: Cell, asked: Settings, seed: int) -> list[JobRow]:
    truth = member(FAMILY, seed)
    true, prior, own = true_cell(cell, truth, seed), prior_in_turn(cell, seed), work(asked, seed)
    rows = []
    for name in ARMS:
        arm, ways = true_arm(true, seed, name), asked.ways(name)
        data = measure(true, arm, asked, ways, seed)
        fits = known(true, prior) + identified(true, dict(zip(ways, data, strict=True)), prior)
        orders = [order(fit, own) for fit in fits]
        before, *after = execute(arm, own, orders)
        for fit, command, off in zip(fits, orders, after, strict=True):
            drawn_too = seed == asked.seed and name == IDEAL and fit.way == ADVISED and fit.name in DRAWN
            rows += [
                replace(row, true_arm=truth, arm=name, off_mm=row.off_mm if drawn_too else None)
                for row in rows_of(own, fit, command, before, off)
            ]
    return rows


def prior_in_turn(cell: Cell, seed: int) -> Prior:
    """Every truth of the family meets every prior once in as many seeds as there are pairs."""
    return prior_of(cell, list(PRIORS)[seed // len(TRUTHS) % len(PRIORS)], seed)


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


def work(asked: Settings, seed: int) -> Work:
    """The jobs of a trial, each under a force of its own."""
    rng, every = stream(seed, PROCESS), jobs()
    parts = [drawn(one, rng) for one in every]
    ends = np.cumsum([0, *(len(one.position) for one in every)]).tolist()
    wrench = np.concatenate([wrenches(one, own) for one, own in zip(every, parts, strict=True)])
    return Work(
        np.concatenate([asked.scene.drilling, asked.scene.milling]),
        Load(wrench, np.array(TIP)).over(len(wrench)),
        tuple(slice(first, last) for first, last in pairwise(ends)),
        tuple(float(np.linalg.norm(own)) for own in parts),
    )


def known(cell: Cell, prior: Prior) -> list[Fit]:
    """Models that nobody identified: the folder's, the prior, and the true one."""
    weights = read_weights(cell.arm)
    every = {NOMINAL: cell.arm.C_theta, PRIOR: prior.C_theta, PERFECT: cell.plant.arm.C_theta}
    return [Fit(NOWHERE, name, sure(bending(cell.vjm, C, weights), name)) for name, C in every.items()]


def sure(state: State, name: str) -> ArmModel:
    """An arm that nobody doubts: all its compliances, with no spread."""
    structure = all153(state.vjm.arm)
    pi, none = structure.entries(state.C_theta), np.zeros((0, structure.n))
    spread = Linearised(pi, none, none, np.ones(structure.n), math.inf, 0.0, on_boundary=False)
    return of_compliances(state, structure, spread, About(name))


def identified(cell: Cell, campaigns: Mapping[Way, Dataset], prior: Prior) -> list[Fit]:
    """All models from all campaigns."""
    weights, data = read_weights(cell.arm), list(campaigns.values())
    found = []
    for model in named_models(cell, IDENTIFIED[:-1]):
        each = zip(campaigns, identify_each(cell, model, data), strict=True)
        found += [Fit(way, model.name, of_estimate(cell.vjm, one, weights)) for way, one in each]
    for way, runs in campaigns.items():
        own = choose(cell, runs, prior)
        found.append(Fit(way, DEFAULT, of_estimate(cell.vjm, own.estimate, weights), own.name))
    return found


def execute(arm: TrueArm, own: Work, orders: Sequence[Order]) -> Array:
    """Tip of the tool minus where it was asked, not corrected, then by each order, (n, points, 3) [m]."""
    q, n = np.concatenate([own.q, *(one.q for one in orders)]), len(own.q)
    load = Load(*(np.tile(part, (len(orders) + 1, 1)) for part in (own.load.wrench, own.load.point)))
    rest, loaded = arm.working(q, load.wrench, load.point)
    start, end = (one.tool + np.matvec(one.rotation, np.array(TIP)) for one in (rest, loaded))
    return np.asarray(end.reshape(-1, n, 3) - start[:n])


def order(fit: Fit, own: Work) -> Order:
    """The joints that a model commands: those of the program where it has the arm buckle."""
    try:
        found = compensate(fit.model, own.q, [own.load], AIM)
    except NoEquilibrium:
        return Order(own.q, None, np.zeros(len(own.q), dtype=bool), buckled=True)
    half = None if fit.way == NOWHERE else found.half
    return Order(found.q, half, found.corrected)


def rows_of(own: Work, fit: Fit, order: Order, before: Array, after: Array) -> list[JobRow]:
    """One fit job by job, of no named arm; what is off before and after, (points, 3) [m]."""
    rows = []
    for job, size, part in zip(jobs(), own.sizes, own.parts, strict=True):
        half = np.zeros((0, 3)) if order.half is None else order.half[part]
        told = np.isfinite(half)
        inside = told & (np.abs(after[part][: len(half)]) <= half)
        rows.append(
            JobRow(
                true_arm="",
                arm="",
                **vars(fit.way),
                name=fit.name,
                chosen=fit.chosen,
                job=job.name,
                force=size,
                before_mm=_distances(before[part]),
                after_mm=_distances(after[part]),
                inside=int(inside.sum()),
                of=int(told.sum()),
                unseen=int((~told).sum()),
                buckled=order.buckled,
                solved=int(order.solved[part].sum()),
                off_mm=tuple(np.round(MM * np.stack([before[part], after[part]]), DIGITS).ravel().tolist()),
            )
        )
    return rows


def _distances(off: Array) -> tuple[float, ...]:
    return tuple(np.round(MM * np.linalg.norm(off, axis=1), DIGITS).tolist())
