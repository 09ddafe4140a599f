"""A real UR10: what explains its public readings, and what predicts those that were never fitted.

A seed draws random poses of C in growing numbers. The first seed has the whole ladder of models besides, on
every split of the readings: no draw changes it.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import ArmJoint, find_arm
from testbench.data.dataset import Series, select_rows
from testbench.design.absolute import position_rows
from testbench.errors import Array, Ids
from testbench.identify.absolute.align import residuals
from testbench.identify.absolute.choose import joint_space_blocks
from testbench.identify.absolute.fit import (
    COMMON_PATTERN,
    MAX_HARMONIC_ORDER,
    Calibration,
    CalibrationOptions,
    linearise_readings,
    select_and_solve,
)
from testbench.identify.absolute.state import MIN_PATTERN_ORDER, ArmState, series_equilibrium
from testbench.identify.diagnosis.moves import sort_by_time
from testbench.identify.posterior import ArmModel
from testbench.identify.prior import PriorUncertainty, cad_prior
from testbench.model.vjm import translational_jacobian
from testbench.report import colours
from testbench.report.badge import Badge, badge_against_all
from testbench.report.colours import CHOICE, Look, look
from testbench.report.figure import Figure, forest
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.scene import PageContent
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials, merged
from testbench.runs.rows import trial_rng
from testbench.studies.campaigns import seeds_of
from testbench.studies.run import READ, headline
from testbench.studies.study import Run, Study, amid_errors
from testbench.workflows.absolute import (
    FRAME_POSES,
    FURTHER,
    File,
    PositionErrors,
    evenly_spaced_rows,
    position_errors,
    read_all,
)
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.own_estimator import Models
from testbench.workflows.plan import absolute_setup_after_readings, choose_further_poses
from testbench.workflows.plan_settings import PlanSettings
from testbench.workflows.rows import MM, UM

# --- Joints of a real arm: their errors by each series, and effects that no model has (approach, drift) -----

STRANGE = 2.0
"""Distance of an angle from those that trained, beyond which order 60 has turned by a third [deg]."""
ANGLES = np.arange(-180.0, 180.0, 1.0)  #: Where the error of a joint is compared [deg].
UNSEEN = 1000.0  #: Half interval from which on rows do not show an effect [urad, um].
FEW = 15  #: Angles that both series visited, below which their errors are not compared.
HALF = 1.96  #: Half width of a 95 % interval [standard deviations].
TOGETHER, PARTS = 60, 10
"""Rows, an hour's or more, in which z counts as constant; parts of a series that give the interval."""


def _joint_rows(
    joints: Sequence[ArmJoint], series: Sequence[Series], waves: Mapping[str, Sequence[float]]
) -> list[Row]:
    """Make a row a joint: its angles, and its error by A, by C and by both.

    Args:
        joints: Of the arm, n.
        series: A and C.
        waves: Coefficients of periodic errors by what trained, joint by joint, sines then cosines [rad].

    Returns:
        The rows.
    """
    own = {by: UM * np.array(every).reshape(len(joints), 2, -1) for by, every in waves.items()}
    a, c = (np.degrees(one.q) for one in series)
    return [
        _joint(joint.name, a[:, j], c[:, j], {by: every[j] for by, every in own.items()})
        for j, joint in enumerate(joints)
    ]


def _joint(name: str, a: Array, c: Array, waves: dict[str, Array]) -> Row:
    at_a, at_c = (_far(ANGLES, q) <= STRANGE for q in (a, c))
    common, seen = at_a & at_c, {"A": at_a, "C": at_c, "both": at_a | at_c}
    curves = {by: _curve(own) for by, own in waves.items()}
    alike = np.corrcoef(curves["A"][common], curves["C"][common])[0, 1] if common.sum() > FEW else None
    return Row(
        joint=name,
        strange_to_A_percent=float(100 * (_far(c, a) > STRANGE).mean()),
        strange_to_C_percent=float(100 * (_far(a, c) > STRANGE).mean()),
        common_deg=float(common.mean() * 360),
        correlation=None if alike is None else float(alike),
        **{f"rms_{by}_urad": float(np.sqrt((own[seen[by]] ** 2).mean())) for by, own in curves.items()},
    )


def _effect_rows(joints: Sequence[ArmJoint], series: Sequence[str], own: Trials) -> list[Row]:
    """Make rows of effects that no model has, with half intervals; none of joints that no row shows."""
    names = [(f"approach, {joint.name}", "urad") for joint in joints]
    names += [(f"drift of z, {name}", "um") for name in series]
    every = zip(names, np.reshape(own["effects"][0], (-1, 2)).tolist(), strict=True)
    rows = (Row(what=what, value=x, half_95=half, unit=unit) for (what, unit), (x, half) in every)
    return [row for row in rows if 0 < row.half_95 < UNSEEN]


def _curve(waves: Array) -> Array:
    """The error over `ANGLES` by sines and cosines, (2, orders), none below MIN_PATTERN_ORDER [urad]."""
    angle = np.radians(np.outer(ANGLES, np.arange(1, waves.shape[1] + 1)))[:, MIN_PATTERN_ORDER - 1 :]
    sines, cosines = waves[:, MIN_PATTERN_ORDER - 1 :]
    return np.asarray(np.sin(angle) @ sines + np.cos(angle) @ cosines)


def _far(angles: Array, known: Array) -> Array:
    """Distance of some angles from the nearest of others, modulo a turn [deg]."""
    ring = np.sort(known % 360)
    ring = np.r_[ring[-1] - 360, ring, ring[0] + 360]
    at = angles % 360
    place = np.clip(np.searchsorted(ring, at), 1, len(ring) - 1)
    return np.asarray(np.minimum(at - ring[place - 1], ring[place] - at))


def approach(state: ArmState, series: Series) -> Array:
    """Compute how far every joint differs by the side from which it comes.

    Least squares over rows that follow the one before in the file; zero where none does.

    Args:
        state: The calibrated arm.
        series: A series of absolute readings.

    Returns:
        Difference and half its interval, (n, 2) [rad, m].
    """
    one = sort_by_time(series)
    came = np.flatnonzero(np.diff(one.row_id) == 1)
    sign = np.sign(np.diff(one.q, axis=0)[came]).T
    J = translational_jacobian(series_equilibrium(state, one).chain, state.mount(one).points)
    A = J.reshape(-1, len(state.theta_0), one.n_rows)[:3, state.vjm.joint_spring_slice, 1 + came] * sign / 2
    A, y = A.transpose(0, 2, 1).reshape(-1, len(sign)), residuals(state, one)[0][:, 1 + came].ravel()
    inverse = np.linalg.pinv(A)
    x = inverse @ y
    scatter = np.linalg.norm(y - A @ x) / np.sqrt(max(len(y), 1))
    return np.stack([x, HALF * scatter * np.linalg.norm(inverse, axis=1)], axis=1)


def drift(state: ArmState, series: Series) -> Array:
    """Compute the RMS drift of z in base axes: means of rows less their scatter.

    Args:
        state: The calibrated arm.
        series: A series of absolute readings.

    Returns:
        RMS and half its interval, (2,) [m].
    """
    z = residuals(state, sort_by_time(series))[0, 2]
    z = (z - z.mean())[: len(z) // TOGETHER * TOGETHER].reshape(-1, TOGETHER)
    squares = z.mean(axis=1) ** 2 - z.var(axis=1, ddof=1) / TOGETHER
    parts = [part.mean() for part in np.array_split(squares, min(PARTS, len(squares)))]
    rms = np.sqrt(max(squares.mean(), np.finfo(float).tiny))
    return np.array([rms, HALF * np.std(parts, ddof=1) / np.sqrt(len(parts)) / (2 * rms)])


# --- A real UR10: what explains its public readings, and what predicts those that were never fitted ---------

ARM = "ur10"
FILES = {"A": "series_A_every_8th.csv", "C": "series_C.csv"}
"""Of the arm's folder, by the name that their authors gave the series."""
SPRINGS, ERRORS, LINKS = "joint springs", "joint errors", "links"
WEAK = PriorUncertainty(5.0)  #: Compliances five times as uncertain as they are large: hardly a prior.
GEOMETRY, JOINTS, WAVES, CHOSEN = "geometry", "+ joint springs", "+ joint errors", "chosen"
LINKS_LS, LINKS_GCO, LINKS_PRIOR = "+ links, LS", "+ links, GCO", "+ links, GCO + prior"
ALL, SHARED = "+ joint errors + links", "+ common pattern"


def _with(*names: str) -> CalibrationOptions:
    return CalibrationOptions(used_errors=frozenset(names))


LADDER: Mapping[str, CalibrationOptions] = {
    GEOMETRY: _with(),
    JOINTS: _with(SPRINGS),
    LINKS_LS: replace(_with(SPRINGS, LINKS), constraint="none", prior_uncertainty=WEAK),
    LINKS_GCO: replace(_with(SPRINGS, LINKS), prior_uncertainty=WEAK),
    LINKS_PRIOR: _with(SPRINGS, LINKS),
    WAVES: _with(SPRINGS, ERRORS),
    SHARED: _with(SPRINGS, ERRORS, COMMON_PATTERN),
    ALL: _with(SPRINGS, ERRORS, LINKS),
    CHOSEN: CalibrationOptions(),
}
"""Models, from geometry alone to what cross-validation keeps: gear ratio, play and stiffening tried too."""
TWO = (JOINTS, SHARED)  #: Without joint errors and with them.
RUNGS = (JOINTS, WAVES, SHARED)  #: The same, and errors that joints do not share.
EVENLY, PLANNED = "C and 50 of A to A", "C and 50 planned of A to A"
BLOCKS, TO_C, TO_A, BOTH, AGAIN = "blocks", "A to C", "C to A", "both", "blocks, realigned"
SPLITS = (BLOCKS, TO_C, TO_A, AGAIN, EVENLY, PLANNED, BOTH)
"""What trains and what judges: docs/study_tables.md."""
TRAINED = {TO_C: "A", TO_A: "C", BOTH: "both"}
"""What trains on a split."""
MEANS = {
    BLOCKS: "blocks_mm",
    TO_C: "a_to_c_mm",
    TO_A: "c_to_a_mm",
    AGAIN: "realigned_mm",
    EVENLY: "evenly_mm",
    PLANNED: "by_plan_mm",
}
"""Where the mean error of a split is in a row of a model."""
PANES = {
    "blocks_mm": "held-out blocks of A and C",
    "a_to_c_mm": "fitted to A, judged on C",
    "c_to_a_mm": "fitted to C, judged on A",
}
LOOKS = {
    GEOMETRY: Look(colours.GREY, 0, prior=True),
    JOINTS: Look(colours.JOINTS, 2, prior=True),
    LINKS_LS: Look(colours.LEAST_SQUARES, 1, prior=True),
    LINKS_GCO: look("ALL153", "psd"),
    LINKS_PRIOR: look("ALL153", "psd", prior=True),
    WAVES: Look(colours.JOINTS_PRIOR, 0, prior=True),
    SHARED: Look(colours.JOINTS_PRIOR, 3, prior=True),
    ALL: Look(colours.GCO, 3, prior=True),
    CHOSEN: CHOICE,
}
ERROR_COLUMNS = (
    "name split judged poses draws error.n error.mean_mm error.rms_mm error.p95_mm error.max_mm "
    "error.coverage_95"
)
JOINT = "joint strange_to_A_percent strange_to_C_percent common_deg correlation rms_A_urad rms_C_urad"
DRAW = "random poses of C"  #: What trains where the number of poses is in question.
#: Highest order where the number of poses is in question: more change little and cost twice.
MAX_COUNTED_ORDER = 50
JUDGING = 200  #: Random poses of C, never of those that trained, and about as many of A, that judge these.


@dataclass(frozen=True)
class Flags:
    """Hold the flags of the study: none, its readings are what they are."""


@dataclass(frozen=True)
class RealSettings:
    """Describe what is tried."""

    thin: int  #: Every so many rows of the readings are taken.
    orders: int  #: Highest order of periodic errors.
    models: tuple[str, ...]  #: Of the ladder.
    first: int  #: The first seed, which tries the ladder.
    draws: Mapping[int, int]  #: Random poses that train, and in how many seeds, from the first, at most.


def _settings(_: Flags, quick: bool, seeds: range) -> RealSettings:
    """Make the settings of the flags: many random poses are dear, hence tried in few seeds."""
    if quick:
        return RealSettings(6, 30, (GEOMETRY, *RUNGS), seeds[0], {60: 1})
    return RealSettings(
        1, MAX_HARMONIC_ORDER, tuple(LADDER), seeds[0], {50: 20, 100: 20, 200: 6, 500: 3, 1000: 3}
    )


Judged = tuple[str, Series, int | None]
"""One of SPLITS, readings that judge it, how many rows tell their frame and target; None: training did."""


def read(thin: int) -> tuple[Cell, tuple[Series, ...]]:
    """Read the arm, and every `thin`-th row of both series, called A and C."""
    folder = find_arm(ARM)
    cell = build_cell(folder)
    series, _ = read_all([File(folder / "readings" / name) for name in FILES.values()], cell.arm)
    some = [select_rows(one, np.arange(0, one.n_rows, thin)) for one in series]
    return cell, tuple(replace(one, name=name) for name, one in zip(FILES, some, strict=True))


def split(
    name: str, series: Sequence[Series], some: Ids | None = None
) -> tuple[tuple[Series, ...], tuple[Judged, ...]]:
    """Split readings into those that train, and those that judge; those of blocks judge twice.

    Args:
        name: Name of the split.
        series: Series A and C.
        some: Rows of A that train beside C; None for a named split.

    Returns:
        Series that train, and what judges.
    """
    a, c = series
    if some is not None:
        rest = select_rows(a, np.setdiff1d(np.arange(a.n_rows), some))
        return (c, select_rows(a, some)), ((name, rest, None),)
    if name == TO_C:
        return (a,), ((TO_C, c, FRAME_POSES),)
    if name == TO_A:
        return (c,), ((TO_A, a, FRAME_POSES),)
    if name == BOTH:
        return (a, c), ()
    pairs = list(zip(series, joint_space_blocks(series), strict=True))
    even, odd = (tuple(select_rows(one, own % 2 == k) for one, own in pairs) for k in (0, 1))
    return even, (*((BLOCKS, one, None) for one in odd), *((AGAIN, one, FRAME_POSES) for one in odd))


@dataclass(frozen=True)
class RealFitRow:
    """Hold a model, as the readings that trained it made it, and how it errs on readings that judge it."""

    split: str  #: One of SPLITS, or DRAW.
    name: str  #: Of the model.
    judged: str  #: Series that judges it, empty for none.
    poses: int  #: That trained it.
    error: PositionErrors | None  #: Positions that were not fitted; None where nothing judges.
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


def _arm_and_readings(asked: RealSettings) -> tuple[Cell, tuple[Series, ...]]:
    """Read the arm and both series, as thin as they are asked for."""
    return read(asked.thin)


def _trial(
    shared: tuple[Cell, tuple[Series, ...]], asked: RealSettings, seed: int, _: Models
) -> Iterator[RealFitRow]:
    """Make the rows of a seed, which draws the poses, and nothing else."""
    if seed == asked.first:
        yield from _ladder(asked, *shared)
    yield from _draws(asked, *shared, seed)


def _models_of(asked: RealSettings, name: str) -> list[str]:
    """List the models that are tried on a split.

    Choosing is dear: from one series to the other it is left out.
    """
    if name == BOTH:
        return [one for one in asked.models if one in (*RUNGS, CHOSEN)]
    if name in (EVENLY, PLANNED):
        return [one for one in asked.models if one in RUNGS]
    return [one for one in asked.models if name == BLOCKS or one != CHOSEN]


def _ladder(asked: RealSettings, cell: Cell, series: Sequence[Series]) -> Iterator[RealFitRow]:
    """Every model on every split: gathered once a split. C with the common pattern plans the poses of A."""
    fifty = {EVENLY: evenly_spaced_rows(series[0], FURTHER)}
    for name in (BOTH, BLOCKS, TO_A, TO_C, EVENLY, PLANNED):
        (train, judged), tried = split(name, series, fifty.get(name)), _models_of(asked, name)
        only = (
            None
            if CHOSEN in tried
            else frozenset({SPRINGS}).union(*(LADDER[one].selectable_errors for one in tried))
        )
        options = CalibrationOptions(used_errors=only, max_order=asked.orders)
        linearised_readings = linearise_readings(cell.vjm, train, cad_prior(cell.arm), options)
        poses = sum(one.n_rows for one in train)
        for model in tried:
            calibration = select_and_solve(linearised_readings, LADDER[model])
            if not judged:
                yield _row(calibration, Row(split=name, name=model, poses=poses))
            for one in judged:
                if one[0] != AGAIN or model in (GEOMETRY, *RUNGS):
                    yield _row(calibration, Row(name=model, poses=poses), one)
            if (name, model) == (TO_A, SHARED):
                fifty[PLANNED] = _planned(calibration.model(), series[0])


def _planned(known: ArmModel, series: Series) -> Ids:
    """Rows of a series that a plan's criterion chooses for all of its poses, by what is known of the arm."""
    sigma = UM * series.sigma
    settings = PlanSettings(absolute=True, criterion="I", poses=FURTHER, orientations=True, sigma_um=sigma)
    union = absolute_setup_after_readings(known, settings)
    wanted = position_rows(union, series.q[evenly_spaced_rows(series, JUDGING)])
    return np.sort(choose_further_poses(union, series.q, wanted)[0])


def _draws(asked: RealSettings, cell: Cell, series: Sequence[Series], seed: int) -> Iterator[RealFitRow]:
    """Models of random poses of C, judged on poses of C that they never saw, and on A."""
    a, c = series
    order = trial_rng(seed).permutation(c.n_rows)
    rest = select_rows(c, order[max(asked.draws) :][:JUDGING])
    few = select_rows(a, np.unique(np.linspace(0, a.n_rows - 1, JUDGING + FRAME_POSES).astype(int)))
    tried = CalibrationOptions(
        max_order=min(asked.orders, MAX_COUNTED_ORDER), used_errors=LADDER[SHARED].used_errors
    )
    for poses in [n for n, draws in asked.draws.items() if seed < asked.first + draws]:
        linearised_readings = linearise_readings(
            cell.vjm, (select_rows(c, order[:poses]),), cad_prior(cell.arm), tried
        )
        for model in TWO:
            calibration = select_and_solve(linearised_readings, LADDER[model])
            for one, frame_poses in ((rest, None), (few, FRAME_POSES)):
                yield _row(calibration, Row(name=model, poses=poses), (DRAW, one, frame_poses))


def _row(found: Calibration, about: Row, judged: Judged | None = None) -> RealFitRow:
    """What a model is, beside readings that judge it, but those that told frame and target."""
    estimate = found.estimate
    active = found.active_unknowns
    steps = found.selection.steps
    K, n = 2 * len(found.state.error_terms.orders), found.state.vjm.arm.n_joints
    certificate, left = None if estimate is None else estimate.certificate, np.zeros(0)
    about |= Row(judged="", error=None)
    if judged:
        about["split"], series, frame_poses = judged
        about |= Row(judged=series.name, error=position_errors(found.model(), [series], frame_poses))
        if about.split == BLOCKS:
            left = np.round(UM * residuals(found.state, series)[0].T, 2)
    waves, effects = "harmonics" in found.selection.error_kinds and about.split != DRAW, np.zeros(0)
    if (about.split, about.name) == (BOTH, SHARED):
        slow = [drift(found.state, one) for one in found.series]
        effects = np.vstack([approach(found.state, found.series[1]), *slow])
    return RealFitRow(
        **about,
        left_um=tuple(left.ravel().tolist()),
        method=None if estimate is None else estimate.method,
        parameters=int((active.columns >= active.unknowns.first_columns["geometry"]).sum()),
        conservative=estimate is None or bool(estimate.conservative),
        min_eigenvalue=0.0 if estimate is None else float(estimate.min_eigenvalue),
        duality_gap=None if certificate is None else float(certificate.duality_gap),
        joints=tuple(np.diag(found.state.C_theta)[-n:].tolist()),
        waves=tuple(found.state.error_coefficients[:, :K].ravel().tolist()) if waves else (),
        kept=tuple(step.name for step in steps if step.kept),
        declined=tuple(step.name for step in steps if not step.kept),
        effects=tuple((UM * effects).ravel().tolist()),
    )


def _report(asked: RealSettings, seeds: range, trials: Trials) -> Report:
    """Report the ladder as it is, and errors by number of random poses over the seeds."""
    f = _numbers(asked, seeds, trials)
    badge = _badge(trials.where(split=BLOCKS, judged=tuple(FILES)))
    means = columns(f"name parameters conservative {' '.join(MEANS.values())}")
    name, blocks = means[0], replace(means[3], heading="mean error in held-out blocks")
    return Report(
        scenario="real_ur10",
        question=Markdown(
            "Which errors explain the readings of a real UR10, and which models predict readings that were "
            "not fitted?"
        ),
        title=say(
            "{arm}, public laser tracker readings of July and November 2020: {series:list}",
            f,
            series=[f"series {one.name} ({one.poses} poses)" for one in f.dataset],
        ),
        answer=headline(badge, Table((name, blocks), f.models)),
        numbers=f,
        tables={
            "models": Table(
                means,
                f.models,
                "mean error of positions that were not fitted",
                headline="blocks_mm",
                looks=LOOKS,
            ),
            "joints": Table(columns(JOINT), f.joints, "the joints and their errors"),
            "effects": Table(columns("what value half_95 unit"), f.effects, "effects that no model has"),
            "errors": Table(
                columns(ERROR_COLUMNS),
                [*f.ladder, *f.by_number],
                "every error",
                headline="error.mean_mm",
                looks=LOOKS,
            ),
        },
        body=["models", "joints", "effects", "errors", READ],
        badge=badge,
    )


def _numbers(asked: RealSettings, seeds: range, trials: Trials) -> Row:
    """All numbers of report.json."""
    cell, series = read(asked.thin)
    ladder, told = trials.where(split=SPLITS), ("name", "split", "judged", "poses")
    errors = trials.where(judged=tuple(FILES)).keep(*told, "error.")
    errors = errors.add(**{"error.n": errors["error.n"].astype(int)})  # some rows have none
    judged = merged(errors.where(split=SPLITS), *told)
    joints, waves = cell.arm.joints, ladder.where(name=WAVES)
    return Row(
        seed=seeds_of(seeds),
        arm=ARM,
        dataset=[_series(one) for one in series],
        models=[_model(name, ladder.where(name=name), judged) for name in asked.models],
        ladder=judged,
        by_number=[
            Row(merged(own)[0], draws=len(own))
            for _, own in errors.where(split=DRAW).groups("judged", "name", "poses")
        ],
        joints=_joint_rows(
            joints, series, {by: waves.where(split=name)["waves"][0] for name, by in TRAINED.items()}
        ),
        compliances=[
            Row(trained=by, name=name, urad_per_Nm=[UM * c for c in own["joints"][0]])
            for name in TWO
            for split, by in TRAINED.items()
            if (own := ladder.where(split=split, name=name))
        ],
        effects=_effect_rows(joints, tuple(FILES), ladder.where(split=BOTH, name=SHARED)),
        chosen=merged(ladder.where(name=CHOSEN).keep("split", "kept", "declined"), "split"),
    )


def _badge(rows: Trials) -> Badge | None:
    """Positions of the first trial's held-out blocks: shared joint errors beside all other models.

    What cross-validation chooses is one of them.
    """
    rows = rows.where(seed=rows["seed"][0])
    errors = {
        name: np.linalg.norm(np.concatenate([*map(np.array, own)]).reshape(-1, 3), axis=1)
        for name in rows.values("name")
        if name != CHOSEN
        for own in [rows.where(name=name)["left_um"].tolist()]
    }
    ours = errors.pop(SHARED)  # every model of the ladder has them
    pairs = {name: (ours, own, None) for name, own in errors.items()}
    badge = badge_against_all(SHARED, pairs, "position of held-out blocks")
    return badge and replace(badge, what="RMS error")  # the tables have means


def _series(series: Series) -> Row:
    """A series of readings: noise of a position along an axis, and the largest distance of two positions."""
    x, own = series.position[:, 0], series.precision
    sigma = series.sigma if own is None else np.sqrt(np.median(3 / np.trace(own, axis1=2, axis2=3)))
    reach = np.linalg.norm(x.max(axis=0) - x.min(axis=0))
    return Row(name=series.name, poses=series.n_rows, sigma_um=float(UM * sigma), reach_mm=float(MM * reach))


def _model(name: str, own: Trials, judged: Sequence[Row]) -> Row:
    """A model over all splits, and its mean error over all readings that judge it, split by split."""
    gaps = own["duality_gap"][~np.isnan(own["duality_gap"].astype(float))]
    found = Row(
        name=name,
        method=own["method"][0],
        parameters=int(own["parameters"].max()),
        conservative=bool(own["conservative"].all()),
        min_eigenvalue=float(own["min_eigenvalue"].min()),
        duality_gap=float(gaps.max()) if len(gaps) else None,
        paper=None,
    )
    for key, place in MEANS.items():
        errors = [row.error for row in judged if (row.name, row.split) == (name, key)]
        n = sum(one.n for one in errors)
        found[place] = sum(one.n * one.mean_mm for one in errors) / n if errors else None
    return found


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the ladder."""
    reading = "Mean error of public readings, series A and C of 2020. Dotted line: joint springs alone."
    title = "Positions of a real UR10 that were never fitted"
    table = found.tables["models"]
    drawn = tuple(replace(c, heading="mean error") if c.key in PANES else c for c in table.columns)
    return {"real_ur10.png": forest(replace(table, columns=drawn), PANES, title, reading, JOINTS)}


def _write(run: Run[RealSettings]) -> PageContent:
    """Write errors.csv, a line a position; draw the arm amid the errors of both models."""
    cell, series = read(run.settings.thin)
    judged = [one for name, one, _ in split(BLOCKS, series)[1] if name == BLOCKS]
    rows = run.first.where(split=BLOCKS, judged=tuple(FILES))
    left = {
        name: np.concatenate([*map(np.array, rows.where(name=name)["left_um"])]).reshape(-1, 3)
        for name in TWO
    }
    q = np.concatenate([one.q for one in judged])
    named = [(one.name, int(row)) for one in judged for row in one.row_id]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        writer = csv.writer(text, lineterminator="\n")
        vectors = [f"{what}_{x}_um" for what in ("springs", "joint_errors") for x in "xyz"]
        writer.writerow(["series", "run", *(f"{joint.name}_rad" for joint in cell.arm.joints), *vectors])
        numbers = np.hstack([q, *left.values()]).tolist()
        writer.writerows([*name, *own] for name, own in zip(named, numbers, strict=True))
    errors = {name: own / UM for name, own in left.items()}
    return amid_errors(cell, q, [f"{name} {row}" for name, row in named], errors, LOOKS)


STUDY = Study(
    name="real_ur10",
    about="Public readings of a UR10: geometry, springs, links and joint errors, series against series.",
    options=Flags,
    settings=_settings,
    seeds=(20, 1),
    arms=lambda _: [find_arm(ARM)],
    row=RealFitRow,
    trial=_trial,
    shared=_arm_and_readings,
    report=_report,
    printed=("models",),
    figures=_figures,
    write=_write,
    data="errors.csv",
)
