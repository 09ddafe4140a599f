"""Report of the study of corrections: the error that they remove on the true elastic arm."""

from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.errors import Array
from testbench.plant.equilibrium import solve_equilibrium
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.plant.true_arms import FAMILY, TRUTH_DESCRIPTIONS, TRUTHS, true_arm_of_seed
from testbench.report.badge import of_rivals
from testbench.report.colours import CHOICE, MEASURED, TASK, Look, look
from testbench.report.figure import Figure, ranges
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.scene import Layer, PageContent, PoseGroup, RunChart, Scene, arrow_scale, loads
from testbench.report.schema import Table, TableColumn, columns, pivot
from testbench.report.table import Row, Trials
from testbench.runs.spread import span, spread
from testbench.studies.compensation.trial import (
    ADVISED,
    ARMS,
    DEFAULT,
    DRAWN,
    FORCE_RANGE,
    IDEAL,
    LEAST_SQUARES,
    MODELS,
    NAME,
    NOWHERE,
    PAYLOAD,
    PULL,
    REAL,
    RUNS,
    SIGMA,
    CompensationOptions,
    CompensationSettings,
    JobsRow,
    Way,
    jobs,
    prepare,
    settings,
    tasks_of,
    trials,
)
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import DEFAULT_WITHOUT_CONE, Run, Study, with_errors
from testbench.workflows.cell import build_cell, true_cell
from testbench.workflows.model_names import WITHOUT_CONE
from testbench.workflows.models import JOINTS
from testbench.workflows.rows import MM, UM

PART = 0.9  #: Share removed that cases are counted at.
LOOKS = {
    JOINTS: look("Joints", "none"),
    LEAST_SQUARES: look("MLS56", "none"),
    "MGCO56": look("MGCO56", "psd"),
    DEFAULT_WITHOUT_CONE: look(WITHOUT_CONE, "none", prior=True),
    DEFAULT: CHOICE,
}
"""How models are drawn."""
DRAWN_AS = {
    "no correction": Look(MEASURED, 1, prior=True),
    "Joints-only": LOOKS[JOINTS],
    "the default": LOOKS[DEFAULT],
}
"""How the tool is drawn, not corrected and corrected by each model; what wins is last."""
LONGEST = 0.3  #: Most errors as they are drawn [m].
FOUND = (
    "name arm campaign poses removed_percent worst_percent nine_percent worse before.median_mm "
    "after.median_mm after.p95_mm after.most_mm covered_percent unseen_percent buckled"
)
BY_ARM = "true_arm name trials removed_percent worst_percent worse after.median_mm covered_percent"


def report(asked: CompensationSettings, seeds: range, trials: Trials) -> Report:
    """Report over all truths, and truth by truth for the campaign that is advised.

    Args:
        asked: Settings of the study.
        seeds: Seeds of the trials.
        trials: Rows of the trials.

    Returns:
        The report.
    """
    advised = trials.where(**vars(ADVISED))
    met = [name for name in TRUTHS if name in advised.values("true_arm")]
    chosen = trials.where(name=DEFAULT)["chosen"].tolist()
    left = advised.where(arm=REAL)
    left = left.add(left_mm=np.median(np.array([*left["after_mm"]]), axis=1))
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload=PAYLOAD,
        pull=PULL,
        runs=RUNS,
        sigma_um=UM * SIGMA,
        force=FORCE_RANGE,
        points={job.name: len(job.position) for job in jobs()},
        featured=ADVISED.poses,
        numbers=asked.numbers,
        truths={name: TRUTH_DESCRIPTIONS[name] for name in met},
        groups=_groups(asked, trials),
        by_truth=[
            Row(g, true_arm=name) for name in met for g in _groups(asked, advised.where(true_arm=name))
        ],
        chosen=[Row(name=name, fits=chosen.count(name)) for name in sorted(set(chosen))],
        dataset=Row(runs=RUNS * ADVISED.poses, points=ADVISED.poses, sigma_um=UM * SIGMA),
    )
    badge = of_rivals(left, DEFAULT, [LEAST_SQUARES, JOINTS, DEFAULT_WITHOUT_CONE], "left_mm")
    way = (REAL, ADVISED.campaign, ADVISED.poses)
    ours = [g for g in f.groups if (g.arm, g.campaign, g.poses) == way]
    return Report(
        scenario=NAME,
        question=Markdown(
            "How much of the deflection under drilling and milling does a correction remove? How does this "
            "depend on the model and on the campaign?"
        ),
        title=say(
            "{arm}, {points[drilling]} drilled and {points[milling]} milled points, {force[0]:g} to "
            "{force[1]:g} N; noise {sigma_um:g} um; {trials:counted trial}",
            f,
        ),
        answer=headline(badge, Table(_error_columns("name"), ours)),
        claims=warnings(trials.where(arm=REAL)),
        numbers=f,
        tables=_tables(f),
        body=["both", "truths", READ],
        badge=badge,
    )


def _error_columns(keys: str) -> tuple[TableColumn, ...]:
    """Columns, and behind them what a correction leaves."""
    *others, left = columns(f"{keys} after.median_mm")
    return (*others, replace(left, heading="error after correction"))


def _groups(asked: CompensationSettings, trials: Trials) -> list[Row]:
    """By disturbance, campaign and model, in the order of the report."""
    groups = dict(trials.groups("arm", "by", "loads", "poses", "name"))
    return [
        _group(way, own)
        for arm in ARMS
        for way in (NOWHERE, *asked.ways(arm))
        for name in (*MODELS, *user_estimator_names(trials))
        if (own := groups.get((arm, *vars(way).values(), name)))
    ]


def user_estimator_names(trials: Trials) -> list[str]:
    """Name the user's estimators."""
    return [name for name in trials.values("name") if name not in MODELS]


def _group(way: Way, own: Trials) -> Row:
    """A model by a campaign; cases are points of trials."""
    before, after = (np.array([*own[key]]) for key in ("before_mm", "after_mm"))
    shares = 1 - after / before
    bounded, unseen = own["of"].sum(), own["unseen"].sum()
    return Row(
        {key: own[key][0] for key in ("arm", "by", "loads", "name")},
        campaign=way.campaign,
        poses=way.poses,
        trials=len(own),
        cases=shares.size,
        before=_sizes(before),
        after=_sizes(after),
        removed_percent=spread(100 * shares.ravel(), np.repeat(np.arange(len(own)), shares.shape[1])),
        worst_percent=100 * shares.min(),
        nine_percent=100 * float(np.mean(shares >= PART)),
        worse=int((shares < 0).sum()),
        covered_percent=100 * own["inside"].sum() / bounded if bounded else None,
        unseen_percent=100 * unseen / (unseen + bounded) if unseen + bounded else None,
        buckled=int(own["buckled"].sum()),
    )


def _sizes(mm: Array) -> Row:
    """How far the loaded tool is from where it was asked, (trials, points): over the trials, and at most."""
    medians, p95 = map(spread, np.percentile(mm, (50, 95), axis=1))
    return Row(median_mm=medians, p95_mm=p95, most_mm=float(mm.max()))


def _tables(f: Row) -> dict[str, Table]:
    """Share removed by campaign; all numbers; the advised campaign by true arm."""
    title = "share of a disturbed arm's deflection removed, median over all points, %"
    own = [g for g in f.groups if g.arm == REAL and g.poses == f.featured]
    campaign, model, share = columns("campaign name removed_percent")
    by_arm = [g for g in f.by_truth if g.arm == REAL and g.name in (JOINTS, DEFAULT)]
    words = f"by true arm, disturbed: {f.featured} planned poses, weight and pull"
    return {
        "short": pivot(Table((), own, title), campaign, model, replace(share, exact=True)),
        "both": Table(columns(FOUND), f.groups, "both jobs"),
        "truths": Table(columns(BY_ARM), by_arm, words),
    }


def figures(found: Report) -> dict[str, Figure]:
    """Draw what is left by campaign of as many poses as are featured, the arm disturbed and undisturbed."""
    f = Row(found.numbers)
    groups = [g for g in f.groups if g.poses == f.featured]
    own = [name for name in dict.fromkeys(g.name for g in groups) if name not in LOOKS]
    looks = LOOKS | {name: look(f"own {k}", "own", prior=True) for k, name in enumerate(own, 1)}
    panes = {
        title: Table(_error_columns("campaign name"), [g for g in groups if g.arm == arm], looks=looks)
        for title, arm in (("disturbed arm", REAL), ("arm that bends as a model can", IDEAL))
    }
    return {
        "compensation.png": ranges(
            panes,
            f"{f.arm}: error of the tool after correction, {f.featured} poses",
            f"Median point of a trial; dots: medians, lines: {span(f.trials)} of {f.trials} trials, "
            f"{f.force[0]:g} to {f.force[1]:g} N.",
        )
    }


def seen(run: Run[CompensationSettings]) -> PageContent:
    """Draw the jobs of the first trial: the tool without correction and with, the arm undisturbed."""
    seed, rows = run.seeds[0], run.first.where(arm=IDEAL, **vars(ADVISED))
    true, work = (
        true_cell(build_cell(find_arm(run.settings.arm)), true_arm_of_seed(FAMILY, seed), seed),
        tasks_of(run.settings, seed),
    )
    every = [np.reshape(rows.where(name=name)["off_mm"][0], (2, -1, 1, 3)) / MM for name in DRAWN]
    off = dict(zip(DRAWN_AS, (every[0][0], *(both[1] for both in every)), strict=True))
    before = off["no correction"]
    M = arrow_scale(before, LONGEST)
    where = np.concatenate([job.position for job in jobs()])[:, None]
    labels = [f"{job.name.capitalize()} {k + 1}" for job in jobs() for k in range(len(job.position))]
    bent, rest = (
        solve_equilibrium(true.plant, work.q, *load) for load in ((work.load.wrench, work.load.point), ())
    )
    tip = (where + M * before)[:, 0]
    poses = PoseGroup(
        name="Jobs",
        names=labels,
        words=[""] * len(labels),
        rigid=rigid_frames(true.room, work.q),
        bent=elastic_frames(true.plant, work.q, M * (bent.theta - rest.theta)),
        layers=[
            Layer("tool asked, all points", TASK, "dots", where[None, :, 0]),
            *loads(tip, work.load.wrench[:, :3], true.vjm.reach),
        ],
    )
    drawn, lines = with_errors(poses, where, off, DRAWN_AS, M)
    chart = RunChart("How far the tool is off at each point, arm undisturbed (mm)", 0, "point", labels, lines)
    return PageContent(
        scene=Scene(true, f"Errors, and how the undisturbed arm bends, x {M:g}.", [drawn]), runs=[chart]
    )


STUDY = Study(
    name=NAME,
    about="Correct a drilling pattern and a milling path by identified models; judge them on the true arm.",
    options=CompensationOptions,
    settings=settings,
    seeds=(100, 6),
    arms=lambda settings: [find_arm(settings.arm)],
    row=JobsRow,
    trials=trials,
    report=report,
    printed=("short",),
    figures=figures,
    write=seen,
    prepare=prepare,
    models="name",
)
