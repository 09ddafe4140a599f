"""Which method an engineer should use by default, whatever the true arm and the prior are."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.models import JOINTS
from testbench.campaign.perturbed_prior import PRIOR_WORDS, PRIORS, PRIORS_CALLED, RIGHT
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import CALLED, TRUTH_WORDS, TRUTHS
from testbench.report.badge import of_models
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import SHARED, TRIAL, Cells, Row, Trials, find, matched, merged, number
from testbench.studies.factorial import compare
from testbench.studies.factorial.compare import ERROR, RMS
from testbench.studies.study import Study
from testbench.studies.which_model import trial
from testbench.studies.which_model.trial import CHOSEN, RUNS, Options, Settings
from testbench.trials.spread import independent, span
from testbench.views.colours import CHOICE, Look, look_of
from testbench.views.figure import Figure, forest
from testbench.views.gains import share
from testbench.views.markdown import Markdown, counted, listed
from testbench.views.schema import Table, pivot

IN_ORDER = {"prior_error": PRIORS, "true_arm": TRUTHS}
"""Words that trials meet in other orders than a reader."""
BESIDE = ("over_joints", "loses")
MARGIN = 0.05  #: Share by which an error must exceed that of joints alone for a method to lose.
EVERY = "all"  #: All cases, in words.
MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
SAID = ("doubted", "told", "unchecked", "otherwise", "either")  #: Columns of what is said of a prior.
PROMISES = f"where cases covered_percent half_mm over_ideal {' '.join(SAID)}"
HOW = Markdown(
    "## How it was done\n\n"
    "The default is averaged with joint stiffness only, weighted by the evidence of the readings. "
    "`--stiffer` asks the same of arms whose links are stiffer. Covered: the share of true components of "
    "deflection inside their intervals of 95 %. Half width: the median over components. Ideal: the "
    "narrowest intervals, all alike in a case, that cover 95 %. The tails of the intervals come from other "
    "seeds (1 to 24) of this family, so the coverage is that of arms of its kind. With the right prior a "
    "doubt is a false alarm where the true links are tubes; elsewhere the folder itself is wrong. Names "
    "tell something only where a link is named more often when it is wrong than when another one is."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads over the family, by number of poses, and of the default by true arm and prior."""
    places = [[list(known).index(word) for word in trials[name]] for name, known in IN_ORDER.items()]
    ordered = trials.pick(np.lexsort(places))
    plain = _over_joints(ordered)
    every = compare.by_case(plain, "true_arm")
    default, family = every.where(name=CHOSEN), compare.cells(every, "poses", also=BESIDE)
    counts = sorted(every.values("poses"))
    f = Row(
        compare.head(seeds, trials),
        arm=find_arm(asked.arm).resolve().name,
        truth="nonlinear",
        sigma_um=UM * asked.sigma,
        cases=len(default) // len(counts),
        poses=counts,
        independent=[
            independent(own["loses"], own[SHARED]) for n in counts for own in [default.where(poses=n)]
        ],
        workspace_poses=asked.workspace,
        runs_a_pose=RUNS,
        margin_percent=100 * MARGIN,
        stiffer=asked.stiffer,
        gains={
            n: compare.gains(own, [m for m in family if m.poses == n], CHOSEN)
            for (n,), own in every.groups("poses")
        },
        family=family,
        cells=compare.cells(default, "true_arm", "prior_error", "poses", also=BESIDE),
        worst=merged(plain.pick(np.where(plain["name"] == CHOSEN, plain["over_joints"], 0).argsort()[-1:]))[
            0
        ],
        promises=list(_promises(every)),
        models=compare.contract([m for m in family if m.poses == counts[0]]),
    )
    question = "{arm}: which method should an engineer use by default with {which} poses?"
    return Report(
        scenario=STUDY.name,
        question=say(question, f, which=listed([str(n) for n in counts], "or")),
        title=_title(f),
        answer=lines([f"{counts[0]} poses:", *compare.beside_rivals(f.gains[counts[0]])]),
        worst=say(
            "Worst case beside joint stiffness only: {arm}, prior {prior}, {poses} poses: {rms_um:.0f} um, "
            "{over_joints:.2f} times theirs.",
            f.worst,
            arm=CALLED[f.worst.true_arm],
            prior=PRIORS_CALLED[f.worst.prior_error],
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW, _families()],
        badge=of_models(
            every.where(poses=counts[0]), [m for m in family if m.poses == counts[0]], CHOSEN, ERROR, "case"
        ),
    )


def _over_joints(trials: Trials) -> Trials:
    """Rows with their errors over those of joints alone in the same case, and whether these lose."""
    joints = matched(trials, trials.where(name=JOINTS), ERROR, (TRIAL, "true_arm", "poses"))
    over = trials[ERROR] / joints
    return trials.add(over_joints=over, loses=over > 1 + MARGIN)


def _promises(every: Trials) -> Iterator[Row]:
    """Whether intervals hold and doubts are right: over all cases, and by poses, prior, true arm and link."""
    judged = every.pick(np.isfinite(every["cover.half_mm"]))
    judged = judged.add(**_said(judged))
    share, percent = judged["link_share"], f"{100 * MOVES:.0f} % of the deflection"
    parts = {EVERY: judged}
    parts |= {f"{n} poses": own for (n,), own in judged.groups("poses")}
    parts |= {f"prior {PRIORS_CALLED[name]}": judged.where(prior_error=name) for name in PRIORS}
    parts[f"prior right, {CALLED['tubes']}"] = judged.where(prior_error=RIGHT, true_arm="tubes")
    parts[f"a link off, less than {percent}"] = judged.pick(share <= MOVES)
    parts[f"a link off, more than {percent}"] = judged.pick(share > MOVES)
    parts |= {CALLED[name]: judged.where(true_arm=name) for name in TRUTHS}
    for where, part in parts.items():
        for (name,), own in part.groups("name"):
            covered, half, ideal = (own[f"cover.{key}"] for key in ("covered_percent", "half_mm", "ideal_mm"))
            yield Row(
                where=where,
                name=name,
                cases=len(own),
                covered_percent=covered.mean(),  # every case has as many components
                half_mm=number(half, own[SHARED]),
                ideal_mm=number(ideal, own[SHARED]),
                over_ideal=number(half / ideal, own[SHARED]),
                **{key: _share(own[key]) for key in SAID},
            )


def _share(cells: Cells) -> float | None:
    """Of the cases that count; None where there is none."""
    known = cells[np.isfinite(cells)]
    return float(known.mean()) if len(known) else None


def _said(rows: Trials) -> Mapping[str, Cells]:
    """Of every case of the default what is said of its prior, 0 or 1; NaN where nothing can be."""
    wrong, heard, left = (rows[key] for key in ("wrong", "doubted.contradicted", "doubted.unchecked"))
    cases = list(zip(wrong, heard, left, strict=True))
    named = [(link, open_) for link, _, open_ in cases if open_ is not None and link]
    others = {  # how often a link is named where another one is wrong
        link: np.mean(own)
        for link in dict(named)
        if (own := [link in open_ for other, open_ in named if other != link])
    }
    found = np.array(
        [
            (
                np.nan if names is None else len(names) > 0,
                link in names if link and names is not None else np.nan,
                np.nan if open_ is None else link in open_,
                np.nan if open_ is None else others.get(link, np.nan),
            )
            for link, names, open_ in cases
        ],
        dtype=float,
    )
    doubted, told, unchecked, otherwise = found.T
    either = np.where(np.isnan(unchecked), np.nan, np.fmax(told, unchecked))
    return dict(zip(SAID, (doubted, told, unchecked, otherwise, either), strict=True))


def _title(f: Row) -> Markdown:
    """What was simulated."""
    stiffer = " True links are {stiffer:g} times stiffer than the folder's." if f.stiffer != 1 else ""
    return say(
        "{arm}, weight of section 6, readings of {sigma_um:g} um, {runs_a_pose} runs a pose, MuJoCo as the "
        "truth: errors of predicted deflection in {workspace_poses} poses never measured. {counted}, in each "
        f"{{arms}} true arms, each with another of {{known}} priors. Medians ({{ends}} of cases).{stiffer}",
        f,
        counted=counted(f.trials, "trial"),
        arms=len(TRUTHS),
        known=len(PRIORS),
        ends=span(f.cases),
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    default = [m for m in f.family if m.name == CHOSEN]
    yield say(
        "The default errs over {margin_percent:g} % more than joint stiffness only in {shares:list} of "
        "{cases:,} cases with {which:list} poses.",
        f,
        shares=[share(m.loses, n) for m, n in zip(default, f.independent, strict=True)],
        which=[str(m.poses) for m in default],
    )
    ours, joints = (find(f.promises, where=EVERY, name=name) for name in (CHOSEN, JOINTS))
    yield say(
        "Its 95 % intervals cover {covered_percent:.1f} % of the true deflections. Those of joint stiffness "
        "only cover {joints.covered_percent:.0f} %: they count noise alone.",
        ours,
        joints=joints,
    )
    far = [
        (PRIORS_CALLED[name], find(f.promises, where=f"prior {PRIORS_CALLED[name]}", name=CHOSEN))
        for name, prior in PRIORS.items()
        if prior.far
    ]
    yield say(
        "Readings raise a doubt of a prior ten times off: {far}.",
        far="; ".join(
            say("{prior}, in {doubted:share {cases}} of {cases} cases", own, prior=name) for name, own in far
        ),
    )


def _tables(f: Row) -> dict[str, Table]:
    """Methods by poses, the default over joints alone by true arm and prior, and what it promises."""
    few, over = f.poses[0], replace(KNOWN["over_joints"], form=".2f")
    cells = [m for m in f.cells if m.poses == few]
    title = f"The default's error over that of joint stiffness only, {few} poses"
    return {
        "short": _over_family(f),
        "cells": pivot(Table((), cells, title), *columns("true_arm prior_error"), over),
        "promises": Table(
            columns(PROMISES), [own for own in f.promises if own.name == CHOSEN], "Promises of the default"
        ),
    }


def _over_family(f: Row) -> Table:
    """Methods by number of poses, in the order of the family."""
    name, poses = columns("name poses")
    rows = Table((), f.family, "RMS error over the workspace, um")
    return replace(pivot(rows, name, replace(poses, unit="poses"), RMS), looks=_looks(f.family))


def _looks(rows: Sequence[Row]) -> dict[str, Look]:
    """How methods are drawn."""
    return {m.name: CHOICE if m.name == CHOSEN else look_of(m) for m in rows}


def _families() -> Markdown:
    """True arms and priors, a line each."""
    arms, priors = (
        [say("- {name}: {what}.", name=called[key], what=what) for key, what in words.items()]
        for called, words in ((CALLED, TRUTH_WORDS), (PRIORS_CALLED, PRIOR_WORDS))
    )
    return Markdown("\n".join(["## True arms\n", *arms, "\n## Priors\n", *priors]))


def figures(found: Report) -> dict[str, Figure]:
    """Error over the workspace of every method over the family, one pane a number of poses."""
    f = Row(found.numbers)
    table, first = _over_family(f), f.poses[0]
    name, *drawn = table.columns
    shown = (name, *(replace(RMS, key=column.key) for column in drawn))
    return {
        "which_model.png": forest(
            replace(table, columns=shown),
            {column.key: column.heading for column in drawn},
            f"{f.arm}, {first} poses, RMS over the workspace: {compare.gains_told(f.gains[first])}",
            "Errors over the family of true arms and priors. Larger dots: what testbench chooses from the "
            "readings. Filled: with a prior; dotted line: joint stiffness only.",
            JOINTS,
        )
    }


STUDY = Study(
    name="which_model",
    about="Identify a family of true arms with every method, from few and many poses and with wrong priors.",
    options=Options,
    settings=trial.settings,
    seeds=(102, 6),
    row=trial.MethodRow,
    trials=trial.trials,
    report=report,
    printed=("short",),
    figures=figures,
    models="name",
)
