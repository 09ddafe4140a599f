"""One trial: a true arm measured in every campaign, explained by every model, corrected and put to work.

The corrected joints go to the true arm in MuJoCo. The error is where its loaded tool then is, minus where the
unloaded tool is at the programmed joints.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.default import choose
from testbench.bench.judged import identify_each
from testbench.bench.models import named_models
from testbench.bench.truths import FAMILY, TRUTHS, member, true_cell
from testbench.bench.wrong_prior import PRIORS, prior_of
from testbench.correct.arm_model import About, ArmModel, bending, of_compliances, of_estimate
from testbench.correct.compensated import compensate
from testbench.correct.newton import Aim
from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array, NoEquilibrium
from testbench.identify import Estimate
from testbench.identify.absolute.state import State
from testbench.identify.intervals import Linearised
from testbench.identify.prior import Prior
from testbench.model.load import Load
from testbench.model.structure import all153
from testbench.model.weights import read_weights
from testbench.studies.compensation.arms import TrueArm, measure, true_arm
from testbench.studies.compensation.jobs import TIP, drawn, jobs, wrenches
from testbench.studies.compensation.rows import JobRow
from testbench.studies.compensation.settings import (
    ARMS,
    DEFAULT,
    IDENTIFIED,
    NOMINAL,
    PERFECT,
    PRIOR,
    Settings,
    Way,
)

MM = 1e3
AIM = Aim(point=TIP)  #: The whole pose of the tool is put right.
DIGITS = 7  #: Of a distance in millimetres.
PROCESS = 50  #: Stream of a seed: forces of the process.
NOT_IDENTIFIED = Way()


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


@dataclass(frozen=True)
class Executed:
    """What became of the points, (points, 3) [m]: tip of the tool minus where it was asked, world."""

    before: Array  #: Not corrected.
    after: tuple[Array, ...]  #: Corrected by each of some fits.
    orders: tuple[Order, ...]


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
        done = execute(arm, own, fits)
        for k, fit in enumerate(fits):
            rows += [replace(row, true_arm=truth, arm=name) for row in rows_of(own, fit, done, k)]
    return rows


def prior_in_turn(cell: Cell, seed: int) -> Prior:
    """Every truth of the family meets every prior once in as many seeds as there are pairs."""
    return prior_of(cell, list(PRIORS)[seed // len(TRUTHS) % len(PRIORS)], seed)


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
    return [Fit(NOT_IDENTIFIED, name, sure(bending(cell.vjm, C, weights), name)) for name, C in every.items()]


def sure(state: State, name: str) -> ArmModel:
    """An arm that nobody doubts: all its compliances, with no spread."""
    structure = all153(state.vjm.arm)
    pi, none = structure.entries(state.C_theta), np.zeros((0, structure.n))
    spread = Linearised(pi, none, none, np.ones(structure.n), math.inf, 0.0, on_boundary=False)
    return of_compliances(state, structure, spread, About(name))


def identified(cell: Cell, campaigns: Mapping[Way, Dataset], prior: Prior) -> list[Fit]:
    """All models from all campaigns."""
    weights, data = read_weights(cell.arm), list(campaigns.values())
    found: list[tuple[Way, str, str | None, Estimate]] = []
    for model in named_models(cell, IDENTIFIED[:-1]):
        each = zip(campaigns, identify_each(cell, model, data), strict=True)
        found += [(way, model.name, None, estimate) for way, estimate in each]
    for way, runs in campaigns.items():
        own = choose(cell, runs, prior)
        found.append((way, DEFAULT, own.name, own.estimate))
    fits = []
    for way, name, taken, estimate in found:
        fits.append(Fit(way, name, of_estimate(cell.vjm, estimate, weights), taken))
    return fits


def execute(arm: TrueArm, own: Work, fits: Sequence[Fit]) -> Executed:
    """Correct the jobs by every model, and let the true arm do them."""
    orders = tuple(order(fit, own) for fit in fits)
    q, n = np.concatenate([own.q, *(one.q for one in orders)]), len(own.q)
    load = Load(*(np.tile(part, (len(fits) + 1, 1)) for part in (own.load.wrench, own.load.point)))
    rest, loaded = arm.working(q, load.wrench, load.point)
    start, end = (one.tool + np.matvec(one.rotation, np.array(TIP)) for one in (rest, loaded))
    off = end.reshape(-1, n, 3) - start[:n]
    return Executed(off[0], tuple(off[1:]), orders)


def order(fit: Fit, own: Work) -> Order:
    """The joints that a model commands: those of the program where it has the arm buckle."""
    try:
        found = compensate(fit.model, own.q, [own.load], AIM)
    except NoEquilibrium:
        return Order(own.q, None, np.zeros(len(own.q), dtype=bool), buckled=True)
    half = None if fit.way == NOT_IDENTIFIED else found.half
    return Order(found.q, half, found.corrected)


def rows_of(own: Work, fit: Fit, done: Executed, k: int) -> list[JobRow]:
    """The fit of this number, job by job, of no named arm."""
    after, order = done.after[k], done.orders[k]
    rows = []
    for job, size, part in zip(jobs(), own.sizes, own.parts, strict=True):
        half = np.zeros((0, 3)) if order.half is None else order.half[part]
        told = np.isfinite(half)
        inside = told & (np.abs(after[part][: len(half)]) <= half)
        rows.append(
            JobRow(
                true_arm="",
                arm="",
                by=fit.way.by,
                loads=fit.way.loads,
                poses=fit.way.poses,
                name=fit.name,
                chosen=fit.chosen,
                job=job.name,
                force=size,
                before_mm=_distances(done.before[part]),
                after_mm=_distances(after[part]),
                inside=int(inside.sum()),
                of=int(told.sum()),
                unseen=int((~told).sum()),
                buckled=order.buckled,
                solved=int(order.solved[part].sum()),
            )
        )
    return rows


def _distances(off: Array) -> tuple[float, ...]:
    return tuple(np.round(MM * np.linalg.norm(off, axis=1), DIGITS).tolist())
