"""What the trials say: how much corrections remove, over the cases, which are points of trials."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import build_cell
from testbench.bench.rows import UM
from testbench.bench.truths import CALLED, FAMILY, TRUTH_WORDS, TRUTHS, member, true_cell
from testbench.data.csvfile import write_csv
from testbench.errors import Array
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials
from testbench.studies.compensation.arms import measure, true_arm
from testbench.studies.compensation.drawn import seen
from testbench.studies.compensation.figure import group, removed
from testbench.studies.compensation.jobs import job, way_along
from testbench.studies.compensation.settings import (
    ADVISED,
    ALL,
    ARMS,
    DEFAULT,
    FORCE,
    IDEAL,
    JOBS,
    LEAST_SQUARES,
    LINEAR,
    MILLING,
    MODELS,
    NAME,
    NOMINAL,
    NOWHERE,
    PAYLOAD,
    PERFECT,
    PRIOR,
    PULL,
    REAL,
    RUNS,
    SIGMA,
    WEIGHT,
    Settings,
    Way,
)
from testbench.studies.study import Run
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import spread
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, counted
from testbench.views.scene import Seen
from testbench.views.schema import Table, pivot

MEDIAN = 0.97  #: Share removed that a trial's median is asked about.
PART, OFTEN = 0.9, 0.95  #: Share removed, and the share of cases in which a trial is asked about it.
HUNG = replace(ADVISED, loads=WEIGHT)
WHAT = "removed_percent worst_percent nine_percent worse"
FOUND = (
    f"name campaign poses {WHAT} before.median_mm after.median_mm after.p95_mm after.most_mm covered_percent"
)
BY_TRIAL = (
    "name campaign poses by_trial_percent median_kept nine_kept trials_worse covered_by_trial_percent solved"
)
BY_ARM = f"true_arm name trials {WHAT} after.median_mm covered_percent"
WRONG = "unseen_percent buckled"  #: Shown where anything is.
READING = Markdown(
    "![compensation](compensation.png)\n\n"
    "A case is a point of a trial. Undisturbed: the true arm bends as a model of its kind can, and readings "
    "are noisy. Disturbed: geometry, joint offsets, payload, backlash, hysteresis, stiffening joints, "
    "compensator and foundation act, which no model here knows. The arm with linear joints is the same "
    "without backlash, hysteresis and stiffening: we tried it after the disturbed one, to find out why less "
    "is removed there."
)
OF_TABLES = Markdown(
    "Removed: one less the distance of the loaded tool from where it was asked, corrected over not "
    "corrected; median of all cases (5 % to 95 %; of fewer than 20 the range). Where it was asked is where "
    "the unloaded tool of the same true arm is at the programmed joints. Before, after: medians of a trial's "
    "points. Covered: components of what is left inside their 95 % interval, of those whose interval has a "
    "bound. Nominal: the folder's compliances, whose joints most true arms share. Prior alone: what the "
    "default starts from. Perfect: the true compliances.\n\n"
    "Campaigns: in every pose acts the weight alone, or either the weight or a rope that pulls along y at "
    "the load point. A plan chooses poses and loads for both jobs; random poses take both loads by turns. "
    "The planner knows the points of both jobs and the mean size and direction of their forces; the forces "
    "of a trial it does not know. Every model corrects by one loop, with its limits and refusals. A model "
    "without an equilibrium under the process corrects nothing."
)


TITLE = (
    "{arm} drills {points[drilling]} holes and mills {points[milling]} points of a window in a curved panel, "
    "{least_kN:g} to {most_kN:g} kN; corrected joints go to the true elastic arm in MuJoCo. Identified from "
    "readings of {sigma_um:g} um, {runs} a pose; {count}, true arms in turn: {true_arms:list}; with each six "
    "priors in turn, five of them twice too soft, 30 % off and more."
)
ANSWER = (
    "{featured} planned poses with weight and pull: the default leaves {gains.least_squares.ours_mm:~.3f} "
    "mm, least squares {gains.least_squares.theirs_mm:~.3f} mm, {gains.least_squares:less}. Joints alone "
    "leave {gains.joints.theirs_mm:~.3f} mm of {best.before.median_mm:~.3f} mm, {gains.joints:more trial}."
)
WORST = (
    "Worst by the weight alone, which never loads joint 1: {hung.removed_percent:~.1f} % removed, joints "
    "alone {hung_joints.removed_percent:~.1f} %. With a disturbed arm {real.removed_percent:~.1f} %, joints "
    "alone {real_joints.removed_percent:~.1f} %, perfect compliances {real_exact.removed_percent:~.1f} %."
)
CLAIMS = (
    "Weight and pull remove {best.removed_percent:~.1f} % of the deflection with the default, "
    "{joints.removed_percent:~.1f} % with joints alone (medians of all points).",
    "The default makes {best.worse} of {best.cases} points worse, by the weight alone {hung.worse}, with a "
    "disturbed arm {real.worse}.",
    "With every disturbance except backlash, friction and stiffening, the default removes "
    "{linear.removed_percent:~.1f} %.",
    "The 95 % intervals of the default hold {best.covered_percent:.1f} % of what is left, disturbed "
    "{real.covered_percent:.1f} %; those of joints alone {joints.covered_percent:.1f} %.",
    "Without identification the folder's compliances remove {nominal.removed_percent:~.1f} %, the prior "
    "alone {prior.removed_percent:~.1f} %.",
    "In each of the poses hang {payload:g} kg, or a rope pulls sideways with {pull_kN:g} kN.",
    "The loop itself: with the true compliances at most {loop_um:.1g} um are left.",
    "The default chose {takes} fits.",
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
        shown=_shown(first.where(**vars(ADVISED), job=MILLING, arm=IDEAL)),
        dataset=Row(runs=RUNS * ADVISED.poses, points=ADVISED.poses, sigma_um=UM * SIGMA),
    )
    tables, told = _tables(f), _told(f)
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
        tables=tables,
        body=[READING, *(name for name in tables if name != "short"), OF_TABLES, _true_arms(f)],
    )


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
    left = [1 - new / old for old, new in zip(before, after, strict=True)]
    shares, worse = np.concatenate(left), [int((some < 0).sum()) for some in left]
    inside, of = (np.array([some[key].sum() for some in trials]) for key in ("inside", "of"))
    bounded, unseen = of.sum(), own["unseen"].sum()
    medians, often = ([call(some) for some in left] for call in (np.median, _nine))
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
        nine_percent=100 * _nine(shares),
        by_trial_percent=spread(100 * np.array(medians)),
        median_kept=float(np.mean(np.array(medians) >= MEDIAN)),
        nine_kept=float(np.mean(np.array(often) >= OFTEN)),
        worse=sum(worse),
        trials_worse=sum(map(bool, worse)),
        covered_percent=100 * inside.sum() / bounded if bounded else None,
        covered_by_trial_percent=spread(100 * inside[of > 0] / of[of > 0]) if bounded else None,
        unseen_percent=100 * unseen / (unseen + bounded) if unseen + bounded else None,
        buckled=sum(bool(some["buckled"].any()) for some in trials),
        solved=float(own["solved"].sum() / len(shares)),
    )


def _nine(shares: Array) -> float:
    """Share of cases with nine tenths or more removed."""
    return float(np.mean(shares >= PART))


def _sizes(trials: Sequence[Array]) -> Row:
    """How far the loaded tool is from where it was asked, over the trials, and at most."""
    medians, p95 = (spread([float(np.percentile(own, p)) for own in trials]) for p in (50, 95))
    return Row(median_mm=medians, p95_mm=p95, most_mm=max(float(own.max()) for own in trials))


def _gains(advised: Trials) -> Row:
    """The default beside least squares and joints alone, by what is left in the median point of a trial."""

    def left(name: str) -> list[float]:
        trials = advised.where(name=name).groups("seed")
        return [float(np.median(np.concatenate([*own["after_mm"]]))) for _, own in trials]

    def beside(name: str) -> Gain:
        return gained(DEFAULT, name, left(DEFAULT), left(name))

    return Row(least_squares=beside(LEAST_SQUARES), joints=beside(JOINTS))


def _shown(own: Trials) -> Row:
    """The milling path of one trial, corrected by every model."""
    cells = {name: own[name][0] for name in ("seed", "true_arm", "force", "before_mm")}
    after = dict(zip(own["name"], own["after_mm"], strict=True))
    return Row(cells, way_m=way_along(job(MILLING)).tolist(), after_mm=after)


def _tables(f: Row) -> dict[str, Table]:
    """Share removed by campaign; all numbers; trial by trial, true arm by true arm."""
    found, n = {}, f"{f.featured} poses"
    for arm in ARMS:
        groups = [g for g in f.groups if g.arm == arm]
        own = [g for g in groups if g.poses in (0, f.featured)]
        for name, keys, rows, title in (
            (ALL, FOUND, [g for g in groups if g.job == ALL], "both jobs"),
            ("jobs", f"job {FOUND}", [g for g in own if g.job != ALL], f"job by job, {n}"),
            ("trials", BY_TRIAL, [g for g in own if g.job == ALL], f"trial by trial, {n}, both jobs"),
            (
                "truths",
                BY_ARM,
                [g for g in f.by_truth if g.arm == arm],
                f"by true arm: {f.featured} planned poses, weight and pull",
            ),
        ):
            wrong = [column for column in columns(WRONG) if any(map(column.value, rows))]
            found[f"{arm}, {name}"] = Table((*columns(keys), *wrong), rows, f"{arm}, {title}")
    title = "share of the deflection removed, median over all points, %"
    own = [g for g in f.groups if (g.arm, g.job, g.poses) == (IDEAL, ALL, f.featured)]
    campaign, model, share = columns("campaign name removed_percent")
    return {"short": pivot(Table((), own, title), campaign, model, replace(share, exact=True)), **found}


def _told(f: Row) -> Row:
    """What sentences speak of, by name: shares that are removed, and what was asked for."""
    groups = {
        "best": (DEFAULT, ADVISED, IDEAL),
        "joints": (JOINTS, ADVISED, IDEAL),
        "hung": (DEFAULT, HUNG, IDEAL),
        "hung_joints": (JOINTS, HUNG, IDEAL),
        "real": (DEFAULT, ADVISED, REAL),
        "real_joints": (JOINTS, ADVISED, REAL),
        "real_exact": (PERFECT, NOWHERE, REAL),
        "linear": (DEFAULT, ADVISED, LINEAR),
        "nominal": (NOMINAL, NOWHERE, IDEAL),
        "prior": (PRIOR, NOWHERE, IDEAL),
    }
    return Row(
        f,
        **{name: group(f, *asked) for name, asked in groups.items()},
        count=counted(f.trials, "trial"),
        true_arms=[CALLED[name] for name in f.truths],
        least_kN=f.force[0] / 1000,
        most_kN=f.force[1] / 1000,
        pull_kN=f.pull / 1000,
        loop_um=1000 * group(f, PERFECT).after.most_mm,
        takes=Markdown(", ".join(say("{name} in {fits}", own) for own in f.chosen)),
    )


def _true_arms(f: Row) -> Markdown:
    own = [say("- {arm}: {words}.", arm=CALLED[name], words=words) for name, words in f.truths.items()]
    return Markdown("## True arms\n\n" + "\n".join(own))


def figures(found: Report) -> dict[str, Figure]:
    """Share of the deflection removed by campaign, number of poses and model; the error along one path."""
    return {"compensation.png": removed(Row(found.numbers))}


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first trial; what is drawn: its jobs, done by the true arm, undisturbed."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    true, ways = true_cell(cell, member(FAMILY, seed), seed), asked.ways(IDEAL)
    data = measure(true, true_arm(true, seed, IDEAL), asked, ways, seed)[ways.index(ADVISED)]
    write_csv(data, cell.arm, run.folder / "dataset.csv")
    return seen(true, asked, data, seed)
