"""What the trials say: how much corrections remove, over the cases, which are points of trials."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.baselines import JOINTS
from testbench.campaign.campaign import build_cell
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import CALLED, FAMILY, TRUTH_WORDS, TRUTHS, member, true_cell
from testbench.data.write import write_csv
from testbench.errors import Array
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials, find
from testbench.studies.compensation.drawn import LOOKS, seen
from testbench.studies.compensation.settings import (
    ADVISED,
    ALL,
    ARMS,
    DEFAULT,
    FORCE,
    IDEAL,
    IDENTIFIED,
    JOBS,
    LEAST_SQUARES,
    LINEAR,
    MODELS,
    NAME,
    NOWHERE,
    PAYLOAD,
    PERFECT,
    PULL,
    REAL,
    RUNS,
    SIGMA,
    WEIGHT,
    Settings,
    Way,
)
from testbench.studies.compensation.trial import measure, true_arm
from testbench.studies.study import Run
from testbench.trials.gain import gained
from testbench.trials.spread import span, spread
from testbench.views.figure import Figure, ranges
from testbench.views.gains import beside
from testbench.views.markdown import Markdown
from testbench.views.scene import Seen
from testbench.views.schema import Table, pivot

PART = 0.9  #: Share removed that cases are counted at.
HUNG = replace(ADVISED, loads=WEIGHT)
FOUND = (
    "name arm campaign poses removed_percent worst_percent nine_percent worse before.median_mm "
    "after.median_mm after.p95_mm after.most_mm covered_percent unseen_percent buckled"
)
BY_ARM = "true_arm name trials removed_percent worst_percent worse after.median_mm covered_percent"
READING = Markdown(
    "A case is a point of a trial. Undisturbed: the true arm bends as a model of its kind can. Disturbed: "
    "geometry, joint offsets, payload, backlash, hysteresis, stiffening joints, compensator and foundation "
    "act, which no model here knows. Linear joints: the same without backlash, hysteresis and stiffening, "
    "tried afterwards to find out why less is removed there."
)
OF_TABLES = Markdown(
    "Removed: one less the distance of the loaded tool from where the unloaded tool of the same true arm "
    "is, corrected over not corrected. Before, after: medians of a trial's points. Covered: components of "
    "what is left inside their 95 % interval, of those whose interval has a bound. Nominal: the folder's "
    "compliances. Prior alone: what the default starts from. Perfect: the true compliances. A plan "
    "chooses poses and loads for both jobs and the mean of their forces; random poses take both loads by "
    "turns. A model without an equilibrium under the process corrects nothing."
)
TITLE = (
    "{arm} drills {points[drilling]} holes and mills {points[milling]} points of a window in a curved panel, "
    "{force[0]:g} to {force[1]:g} N; corrected joints go to the true elastic arm in MuJoCo. Identified from "
    "readings of {sigma_um:g} um, {runs} a pose, under {payload:g} kg or a rope's pull of {pull:g} N; "
    "{trials:counted trial}, true arms in turn: {called:list}; with each six priors in turn, five of them "
    "twice too soft, 30 % off and more."
)
ANSWER = (
    "{featured} planned poses with weight and pull: the default leaves {gains.least_squares.ours_mm:~.3f} "
    "mm, least squares {gains.least_squares.theirs_mm:~.3f} mm, {gains.least_squares:less}. Joint "
    "stiffness only leaves {gains.joints.theirs_mm:~.3f} mm of {best.before.median_mm:~.3f} mm, "
    "{gains.joints:more trial}."
)
WORST = (
    "Worst by the weight alone, which never loads joint 1: {hung.removed_percent:~.1f} % removed, joint "
    "stiffness only {hung_joints.removed_percent:~.1f} %. With a disturbed arm "
    "{real.removed_percent:~.1f} %, joint stiffness only {real_joints.removed_percent:~.1f} %, perfect "
    "compliances {real_exact.removed_percent:~.1f} %."
)
CLAIMS = (
    "The default makes {best.worse} of {best.cases} points worse, by the weight alone {hung.worse}, with a "
    "disturbed arm {real.worse}.",
    "With every disturbance except backlash, friction and stiffening, the default removes "
    "{linear.removed_percent:~.1f} %.",
    "The 95 % intervals of the default hold {best.covered_percent:.1f} % of what is left, disturbed "
    "{real.covered_percent:.1f} %; those with joint stiffness only {joints.covered_percent:.1f} %.",
)
"""What else there is to say, what matters most first."""


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Over all truths, and truth by truth for the campaign that is advised."""
    advised = trials.where(**vars(ADVISED))
    met = [name for name in TRUTHS if name in advised.values("true_arm")]
    chosen = trials.where(job=JOBS[0], name=DEFAULT)
    first = trials.where(seed=trials["seed"][0])
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload=PAYLOAD,
        pull=PULL,
        runs=RUNS,
        sigma_um=UM * SIGMA,
        force=FORCE,
        points={name: len(first.where(job=name)["before_mm"][0]) for name in JOBS},
        featured=ADVISED.poses,
        numbers=asked.numbers,
        truths={name: TRUTH_WORDS[name] for name in met},
        gains=_gains(advised.where(arm=IDEAL)),
        groups=_groups(asked, trials, (ALL, *JOBS)),
        by_truth=[
            Row(g, true_arm=name)
            for name in met
            for g in _groups(asked, advised.where(true_arm=name), (ALL,))
        ],
        chosen=[
            Row(name=name, fits=len(chosen.where(chosen=name))) for name in sorted(chosen.values("chosen"))
        ],
        dataset=Row(runs=RUNS * ADVISED.poses, points=ADVISED.poses, sigma_um=UM * SIGMA),
    )
    told = Row(
        f,
        called=[CALLED[name] for name in met],
        best=group(f, DEFAULT, ADVISED),
        joints=group(f, JOINTS, ADVISED),
        hung=group(f, DEFAULT, HUNG),
        hung_joints=group(f, JOINTS, HUNG),
        real=group(f, DEFAULT, ADVISED, REAL),
        real_joints=group(f, JOINTS, ADVISED, REAL),
        real_exact=group(f, PERFECT, NOWHERE, REAL),
        linear=group(f, DEFAULT, ADVISED, LINEAR),
    )
    return Report(
        scenario=NAME,
        question=Markdown(
            "How much of the deflection under drilling and milling does a correction remove, by which model, "
            "from which campaign?"
        ),
        title=say(TITLE, told),
        answer=say(ANSWER, told),
        worst=say(WORST, told),
        claims=[say(claim, told) for claim in CLAIMS],
        numbers=f,
        tables=_tables(f),
        body=[READING, "both", "truths", OF_TABLES],
    )


def group(f: Row, name: str, way: Way = NOWHERE, arm: str = IDEAL) -> Row:
    """A model by a campaign, both jobs."""
    return find(f.groups, name=name, campaign=way.campaign, poses=way.poses, arm=arm, job=ALL)


def _groups(asked: Settings, trials: Trials, jobs: Sequence[str]) -> list[Row]:
    """By disturbance, campaign, model and job, in the order of the report."""
    groups = dict(trials.groups("arm", "by", "loads", "poses", "name"))
    return [
        _group(way, own if one == ALL else own.where(job=one), one)
        for arm in ARMS
        for way in (NOWHERE, *asked.ways(arm))
        for name in MODELS
        if (own := groups.get((arm, *vars(way).values(), name)))
        for one in jobs
    ]


def _group(way: Way, own: Trials, one: str) -> Row:
    """A model by a campaign in a job, or both; cases are points of trials."""
    trials = [some for _, some in own.groups("seed")]
    before, after = ([np.concatenate([*some[key]]) for some in trials] for key in ("before_mm", "after_mm"))
    shares = 1 - np.concatenate(after) / np.concatenate(before)
    bounded, unseen = own["of"].sum(), own["unseen"].sum()
    return Row(
        {key: own[key][0] for key in ("arm", "by", "loads", "name")},
        campaign=way.campaign,
        poses=way.poses,
        job=one,
        trials=len(trials),
        cases=len(shares),
        before=_sizes(before),
        after=_sizes(after),
        removed_percent=spread(100 * shares),
        worst_percent=100 * shares.min(),
        nine_percent=100 * float(np.mean(shares >= PART)),
        worse=int((shares < 0).sum()),
        covered_percent=100 * own["inside"].sum() / bounded if bounded else None,
        unseen_percent=100 * unseen / (unseen + bounded) if unseen + bounded else None,
        buckled=sum(bool(some["buckled"].any()) for some in trials),
        solved=float(own["solved"].sum() / len(shares)),
    )


def _sizes(trials: Sequence[Array]) -> Row:
    """How far the loaded tool is from where it was asked, over the trials, and at most."""
    medians, p95 = (spread([float(np.percentile(own, p)) for own in trials]) for p in (50, 95))
    return Row(median_mm=medians, p95_mm=p95, most_mm=max(float(own.max()) for own in trials))


def _gains(advised: Trials) -> Row:
    """The default beside least squares and joints alone, by what is left in the median point of a trial."""
    left = {
        name: [
            float(np.median(np.concatenate([*own["after_mm"]])))
            for _, own in advised.where(name=name).groups("seed")
        ]
        for name in (DEFAULT, LEAST_SQUARES, JOINTS)
    }
    rivals = {"least_squares": LEAST_SQUARES, "joints": JOINTS}
    return Row({key: gained(DEFAULT, name, left[DEFAULT], left[name]) for key, name in rivals.items()})


def _tables(f: Row) -> dict[str, Table]:
    """Share removed by campaign; all numbers of both jobs; the advised campaign by true arm."""
    both = [g for g in f.groups if g.job == ALL]
    title = "share of the deflection removed, median over all points, %"
    own = [g for g in both if g.arm == IDEAL and g.poses == f.featured]
    campaign, model, share = columns("campaign name removed_percent")
    by_arm = [g for g in f.by_truth if g.arm == IDEAL and g.name in (JOINTS, DEFAULT)]
    words = f"by true arm, undisturbed: {f.featured} planned poses, weight and pull"
    return {
        "short": pivot(Table((), own, title), campaign, model, replace(share, exact=True)),
        "both": Table(columns(FOUND), both, "both jobs"),
        "truths": Table(columns(BY_ARM), by_arm, words),
    }


def figures(found: Report) -> dict[str, Figure]:
    """What is left by campaign and number of poses, with an undisturbed arm and a disturbed one."""
    f = Row(found.numbers)
    both = [
        Row(g, campaign=f"{g.campaign},\n{g.poses} poses")
        for g in f.groups
        if g.job == ALL and g.name in IDENTIFIED
    ]
    *named, left = columns("campaign name after.median_mm")
    error = replace(left, heading="error after correction")
    panes = {
        title: Table((*named, error), [g for g in both if g.arm == arm], looks=LOOKS)
        for title, arm in (("arm that bends as a model can", IDEAL), ("with all that no model knows", REAL))
    }
    gains = {"least squares": f.gains.least_squares, "joint stiffness only": f.gains.joints}
    return {
        "compensation.png": ranges(
            panes,
            f"{f.arm}, {f.featured} planned poses, weight and pull, error left: {beside(gains)}",
            "Title: arms that bend as a model can. What is left of the deflection in the median point of a "
            f"trial; dots: medians, lines: {span(f.trials)} of {f.trials} trials, {f.force[0]:g} to "
            f"{f.force[1]:g} N. To the left is better.",
        )
    }


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first trial; what is drawn: its jobs, done by the true arm, undisturbed."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    true, ways = true_cell(cell, member(FAMILY, seed), seed), asked.ways(IDEAL)
    data = measure(true, true_arm(true, seed, IDEAL), asked, ways, seed)[ways.index(ADVISED)]
    write_csv(data, cell.arm, run.folder / "dataset.csv")
    return seen(true, asked, run.first, seed)
