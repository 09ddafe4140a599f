"""Readings of a UR10, the models that may explain them, and what these foretell, seed by seed.

A seed draws random poses of C in growing numbers. The first seed has the whole ladder of models besides, on
every split of the readings: no draw changes it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.absolute import FRAME_POSES, File, Score, evenly, read_all, score
from testbench.campaign.campaign import Cell, build_cell, stream
from testbench.campaign.plan import MORE, best_of, union_after
from testbench.campaign.plan_settings import PlanSettings
from testbench.campaign.rows import UM
from testbench.data.series import Series, select_rows
from testbench.design.absolute import position_rows
from testbench.errors import Ids
from testbench.identify.absolute.choose import blocks_of
from testbench.identify.absolute.fit import ORDERS, PATTERN, Calibration, Options, explain, gather
from testbench.identify.absolute.posterior import model_of
from testbench.identify.absolute.scatter import residuals
from testbench.identify.arm_model import ArmModel
from testbench.identify.prior import Strength, cad_prior
from testbench.report.table import Row
from testbench.studies.real_ur10.effects import approach, drift

ARM = "ur10"
FILES = {"A": "series_A_every_8th.csv", "C": "series_C.csv"}
"""Of the arm's folder, by the name that their authors gave the series."""
SPRINGS, ERRORS, LINKS = "joint springs", "joint errors", "links"
WEAK = Strength(5.0)  #: Compliances five times as uncertain as they are large: hardly a prior.
GEOMETRY, JOINTS, WAVES, CHOSEN = "geometry", "+ joint springs", "+ joint errors", "chosen"
LINKS_LS, LINKS_GCO, LINKS_PRIOR = "+ links, LS", "+ links, GCO", "+ links, GCO + prior"
ALL, SHARED = "+ joint errors + links", "+ common pattern"


def _with(*names: str) -> Options:
    return Options(only=frozenset(names))


LADDER: Mapping[str, Options] = {
    GEOMETRY: _with(),
    JOINTS: _with(SPRINGS),
    LINKS_LS: replace(_with(SPRINGS, LINKS), constraint="none", strength=WEAK),
    LINKS_GCO: replace(_with(SPRINGS, LINKS), strength=WEAK),
    LINKS_PRIOR: _with(SPRINGS, LINKS),
    WAVES: _with(SPRINGS, ERRORS),
    SHARED: _with(SPRINGS, ERRORS, PATTERN),
    ALL: _with(SPRINGS, ERRORS, LINKS),
    CHOSEN: Options(),
}
"""Models, from geometry alone to what cross-validation keeps: gear ratio, play and stiffening tried too."""
TWO = (JOINTS, SHARED)  #: Without joint errors and with them.
RUNGS = (JOINTS, WAVES, SHARED)  #: The same, and errors that joints do not share.
EVENLY, PLANNED = "C and 50 of A to A", "C and 50 planned of A to A"
BLOCKS, TO_C, TO_A, BOTH, AGAIN = "blocks", "A to C", "C to A", "both", "blocks, realigned"
SPLITS = {
    BLOCKS: "trained on half of the blocks of joint space of both series, judged on the others",
    TO_C: "trained on A, judged on C, its frame and target by 50 of its poses",
    TO_A: "trained on C, judged on A, its frame and target by 50 of its poses",
    AGAIN: "as blocks, frames and targets of the others by 50 of their poses",
    EVENLY: "trained on C and 50 evenly spaced poses of A, judged on the others of A",
    PLANNED: "the same with the 50 of A's poses that the criterion of `plan --absolute --given` chooses, "
    "over A's poses and after C",
    BOTH: "trained on both series, judged on nothing",
}
DRAW = "random poses of C"  #: What trains where the number of poses is in question.
ENOUGH = 50  #: Highest order where the number of poses is in question: more change little and cost twice.
JUDGING = 200  #: Random poses of C, never of those that trained, and about as many of A, that judge these.


@dataclass(frozen=True)
class Flags:
    """Flags of the study: none, its readings are what they are."""


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    thin: int  #: Every so many rows of the readings are taken.
    orders: int  #: Highest order of periodic errors.
    models: tuple[str, ...]  #: Of the ladder.
    first: int  #: The first seed, which tries the ladder.
    draws: Mapping[int, int]  #: Random poses that train, and in how many seeds, from the first, at most.


def settings(_: Flags, quick: bool, seeds: range) -> Settings:
    """What the flags ask for: many random poses are dear, hence tried in few seeds."""
    if quick:
        return Settings(6, 30, (GEOMETRY, *RUNGS), seeds[0], {60: 1})
    return Settings(1, ORDERS, tuple(LADDER), seeds[0], {50: 20, 100: 20, 200: 6, 500: 3, 1000: 3})


Judged = tuple[str, Series, int | None]
"""One of SPLITS, readings that judge it, how many rows tell their frame and target; None: training did."""


def read(thin: int) -> tuple[Cell, tuple[Series, ...]]:
    """The arm, and every `thin`-th row of both series, called A and C."""
    folder = find_arm(ARM)
    cell = build_cell(folder)
    series, _ = read_all([File(folder / "readings" / name) for name in FILES.values()], cell.arm)
    some = [select_rows(one, np.arange(0, one.rows, thin)) for one in series]
    return cell, tuple(replace(one, name=name) for name, one in zip(FILES, some, strict=True))


def split(
    name: str, series: Sequence[Series], some: Ids | None = None
) -> tuple[tuple[Series, ...], tuple[Judged, ...]]:
    """Readings that train, C's and some of A's if any, and others that judge; those of blocks judge twice."""
    a, c = series
    if some is not None:
        rest = select_rows(a, np.setdiff1d(np.arange(a.rows), some))
        return (c, select_rows(a, some)), ((name, rest, None),)
    if name == TO_C:
        return (a,), ((TO_C, c, FRAME_POSES),)
    if name == TO_A:
        return (c,), ((TO_A, a, FRAME_POSES),)
    if name == BOTH:
        return (a, c), ()
    pairs = list(zip(series, blocks_of(series), strict=True))
    even, odd = (tuple(select_rows(one, own % 2 == k) for one, own in pairs) for k in (0, 1))
    return even, (*((BLOCKS, one, None) for one in odd), *((AGAIN, one, FRAME_POSES) for one in odd))


@dataclass(frozen=True)
class FitRow:
    """A model, as the readings that trained it made it, beside readings that judge it."""

    split: str  #: One of SPLITS, or DRAW.
    name: str  #: Of the model.
    judged: str  #: Series that judges it, empty for none.
    poses: int  #: That trained it.
    error: Score | None  #: Positions that were not fitted; None where nothing judges.
    #: Readings minus model of all judged rows, base axes, (3 rows,) [um]; of those that are drawn.
    left_um: tuple[float, ...]
    method: str | None  #: How compliances were found; None of a rigid arm.
    parameters: int  #: Unknowns of the arm, frames and targets not counted.
    conservative: bool
    min_eigenvalue: float  #: Smallest of a block of the compliances [m/N, rad/(N m)].
    duality_gap: float | None
    joints: tuple[float, ...]  #: Compliances of the joints, (n,) [rad/(N m)].
    waves: tuple[float, ...]  #: Coefficients of periodic errors, joint by joint, sines then cosines [rad].
    kept: tuple[str, ...]  #: Errors that cross-validation kept, and declined.
    declined: tuple[str, ...]
    #: `approach` in C, whose rows are all there, and `drift` in A and C, by the common pattern [urad, um].
    effects: tuple[float, ...]


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds; the seed draws the poses, and nothing else."""
    cell, series = read(asked.thin)
    found = []
    for seed in seeds:
        ladder = _ladder(asked, cell, series) if seed == asked.first else ()
        found.append([*ladder, *_draws(asked, cell, series, seed)])
    return found


def models_of(asked: Settings, name: str) -> list[str]:
    """Models that are tried on a split: of the one that judges nothing, those that are looked into.

    Choosing is dear: from one series to the other it is left out.
    """
    if name == BOTH:
        return [one for one in asked.models if one in (*RUNGS, CHOSEN)]
    if name in (EVENLY, PLANNED):
        return [one for one in asked.models if one in RUNGS]
    return [one for one in asked.models if name == BLOCKS or one != CHOSEN]


def _ladder(asked: Settings, cell: Cell, series: Sequence[Series]) -> Iterator[FitRow]:
    """Every model on every split: gathered once a split. C with the common pattern plans the poses of A."""
    fifty = {EVENLY: evenly(series[0], MORE)}
    for name in (BOTH, BLOCKS, TO_A, TO_C, EVENLY, PLANNED):
        (train, judged), tried = split(name, series, fifty.get(name)), models_of(asked, name)
        only = None if CHOSEN in tried else frozenset({SPRINGS}).union(*(LADDER[one].may for one in tried))
        options = Options(only=only, orders=asked.orders)
        found = gather(cell.vjm, train, cad_prior(cell.arm), options)
        poses = sum(one.rows for one in train)
        for model in tried:
            own = explain(found, LADDER[model])
            if not judged:
                yield _row(own, Row(split=name, name=model, poses=poses))
            for one in judged:
                if one[0] != AGAIN or model in (GEOMETRY, *RUNGS):
                    yield _row(own, Row(name=model, poses=poses), one)
            if (name, model) == (TO_A, SHARED):
                fifty[PLANNED] = _planned(model_of(own), series[0])


def _planned(known: ArmModel, series: Series) -> Ids:
    """Rows of a series that a plan's criterion chooses for all of its poses, by what is known of the arm."""
    sigma = UM * series.sigma
    settings = PlanSettings(absolute=True, criterion="I", poses=MORE, orientations=True, sigma_um=sigma)
    union = union_after(known, settings)
    wanted = position_rows(union, series.q[evenly(series, JUDGING)])
    return np.sort(best_of(union, series.q, wanted)[0])


def _draws(asked: Settings, cell: Cell, series: Sequence[Series], seed: int) -> Iterator[FitRow]:
    """Models of random poses of C, judged on poses of C that they never saw, and on A."""
    a, c = series
    order = stream(seed).permutation(c.rows)
    rest = select_rows(c, order[max(asked.draws) :][:JUDGING])
    few = select_rows(a, np.unique(np.linspace(0, a.rows - 1, JUDGING + FRAME_POSES).astype(int)))
    tried = Options(orders=min(asked.orders, ENOUGH), only=LADDER[SHARED].only)
    for poses in [n for n, draws in asked.draws.items() if seed < asked.first + draws]:
        found = gather(cell.vjm, (select_rows(c, order[:poses]),), cad_prior(cell.arm), tried)
        for model in TWO:
            own = explain(found, LADDER[model])
            for one, frame_poses in ((rest, None), (few, FRAME_POSES)):
                yield _row(own, Row(name=model, poses=poses), (DRAW, one, frame_poses))


def _row(found: Calibration, about: Row, judged: Judged | None = None) -> FitRow:
    """What a model is, beside readings that judge it, but those that told frame and target."""
    estimate, own, steps = found.estimate, found.own, found.chosen.steps
    K, n = 2 * len(found.state.errors.orders), found.state.vjm.arm.n_joints
    certificate, left = None if estimate is None else estimate.certificate, np.zeros(0)
    about |= Row(judged="", error=None)
    if judged:
        about["split"], series, frame_poses = judged
        about |= Row(judged=series.name, error=score(model_of(found), [series], frame_poses))
        if about.split == BLOCKS:
            left = np.round(UM * residuals(found.state, series)[0].T, 2)
    waves, effects = "harmonics" in found.chosen.kinds and about.split != DRAW, np.zeros(0)
    if (about.split, about.name) == (BOTH, SHARED):
        slow = [drift(found.state, one) for one in found.series]
        effects = np.vstack([approach(found.state, found.series[1]), *slow])
    return FitRow(
        **about,
        left_um=tuple(left.ravel().tolist()),
        method=None if estimate is None else estimate.method,
        parameters=int((own.columns >= own.unknowns.starts["geometry"]).sum()),
        conservative=estimate is None or bool(estimate.conservative),
        min_eigenvalue=0.0 if estimate is None else float(estimate.min_eigenvalue),
        duality_gap=None if certificate is None else float(certificate.duality_gap),
        joints=tuple(np.diag(found.state.C_theta)[-n:].tolist()),
        waves=tuple(found.state.n[:, :K].ravel().tolist()) if waves else (),
        kept=tuple(step.name for step in steps if step.kept),
        declined=tuple(step.name for step in steps if not step.kept),
        effects=tuple((UM * effects).ravel().tolist()),
    )
