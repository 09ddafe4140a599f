"""The method to use by default, whatever the true arm and the prior are.

A trial has every truth of the family with one prior each, and every method in few and in many poses: the
KR 500 under its payload as in section 6, readings of 50 um, non-linear truth. All truths of a trial stand
in the same poses, and fewer poses are the first of them. Over as many trials as there are priors every truth
meets every prior once: a Latin square.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset, select_runs
from testbench.identify.estimate import Estimate, deflections_of_models
from testbench.identify.hierarchy import (
    COMMON_JOINT_SCALE_NAME,
    contradicted_scales,
    undetermined_compliances,
)
from testbench.identify.method import least_squares
from testbench.identify.prior import Prior, scale_by_prior
from testbench.plant.true_arms import FAMILY_TRUE_ARMS
from testbench.report.colours import CHOICE
from testbench.report.figure import Figure, forest
from testbench.report.report import Report
from testbench.report.schema import KNOWN, TRUE_ARM_LABELS
from testbench.report.table import SHARED, TRIAL, Cells, Row, Trials, matched, number
from testbench.runs.rows import trial_rng
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, by_case, by_levels
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    Cover,
    Fits,
    TrialCase,
    cover,
    fitted,
    reread,
    score_cases,
)
from testbench.studies.study import ArmFlag, plain_models, without_cone
from testbench.workflows.campaign import Campaign, Scenario, draw_poses, simulate_at, true_cell
from testbench.workflows.cell import Cell
from testbench.workflows.models import (
    JOINTS_ONLY,
    MODELS,
    PRIORS,
    UNPERTURBED,
    Model,
    choose_model,
    prior_of,
    with_priors,
    wrong_link,
)
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import UM

POSES = (8, 12, 20)  #: From how many is identified; the last one is how many there are.
CHECK_POSES = 3
RUNS = 2  #: In every pose.
QUICK_WORKSPACE = 40
CHOSEN = "default"  #: What `workflows.models` chooses from the readings.
MODELS_WITHOUT_PRIOR = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68")
SAID = ("doubted", "told", "unchecked", "otherwise", "either")  #: Columns of what is said of a prior.
SHOWN = "cast"  #: The true arm whose readings are left as a dataset.
COVERED = (CHOSEN, JOINTS_ONLY, "MGCO56 + prior", "ALL153 + prior")
"""Whose intervals are judged; those of joints alone show what noise alone would promise."""


@dataclass(frozen=True)
class FamilyOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "kr500_l480"
    stiffer: Annotated[
        float, typer.Option(min=0.01, max=1e4, metavar="X", help="Stiffness of the true links, factor.")
    ] = 1.0


@dataclass(frozen=True)
class FamilySettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    first: int  #: The first seed.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 200  #: Poses in which the models are judged.
    stiffer: float = 1.0  #: How many times stiffer the true links are than the folder's.


@dataclass(frozen=True)
class Doubted:
    """Hold what the readings are said to tell of the prior."""

    contradicted: tuple[str, ...]  #: Links and joints, or "joints", whose scales they contradict.
    #: Links and joints that may be off as the wrong link is; None where no link of the prior is wrong.
    unchecked: tuple[str, ...] | None


@dataclass(frozen=True, kw_only=True)
class FamilyMethodRow(CampaignFitRow):
    """Hold one method in one case."""

    wrong: str | None  #: What is ten times off in the prior: a link's name, or "joints"; None for nothing.
    #: Of a wrong link: RMS of the true deflection over the workspace that is its own, over the whole [1].
    link_share: float | None
    chosen: str | None = None  #: Of the default: the method that it chose.
    cover: Cover | None = None  #: Of the methods whose intervals are judged.
    doubted: Doubted | None = None  #: Of the default.


def _settings(options: FamilyOptions, quick: bool, seeds: range) -> FamilySettings:
    """Make the settings of the flags."""
    workspace = QUICK_WORKSPACE if quick else FamilySettings.workspace
    return FamilySettings(options.arm, seeds[0], workspace=workspace, stiffer=options.stiffer)


def _trial(cell: Cell, asked: FamilySettings, seed: int, own: Models) -> Iterator[FamilyMethodRow]:
    """Make the rows of a seed, one per truth, method and number of poses."""
    plain, bare = plain_models(cell, MODELS_WITHOUT_PRIOR), _to_fill(cell)
    poses = draw_poses(cell, scenario(asked), seed)
    for truth, name in pairs(seed):
        true, prior = true_cell(cell, truth, seed, asked.stiffer), prior_of(cell, name, seed)
        campaign = simulate_at(true, scenario(asked), seed, poses)
        factors = {"true_arm": truth, "prior_error": name, "sigma_um": UM * asked.sigma}
        cases = [
            TrialCase(
                runs,
                campaign.truth,
                {**factors, "poses": n},
                runs if (truth, n, seed) == (SHOWN, POSES[-1], asked.first) else None,
            )
            for runs, n in zip(read(campaign), POSES, strict=True)
        ]
        yield from _rows(
            true, [*plain, *with_priors(cell.arm, bare, prior), *own(true, prior)], cases, prior, seed
        )


def _to_fill(cell: Cell) -> list[Model]:
    """List methods that are fitted with a prior, learnt from the readings."""
    joints, mgco56, mgco68, all153 = (
        MODELS[name](cell) for name in (JOINTS_ONLY, "MGCO56", "MGCO68", "ALL153")
    )
    beams = replace(mgco56, name="MLS56", estimator=least_squares)
    return [joints, beams, without_cone(cell), mgco56, mgco68, all153]


def pairs(seed: int) -> list[tuple[str, str]]:
    """Pair the truths of a trial, each with its prior: a row of a Latin square."""
    priors = list(PRIORS)
    return [(truth, priors[(k + seed) % len(priors)]) for k, truth in enumerate(FAMILY_TRUE_ARMS)]


def scenario(asked: FamilySettings) -> Scenario:
    """Describe what is measured, without noise."""
    return Scenario(
        arm=find_arm(asked.arm).name,
        noise=False,
        sigma=asked.sigma,
        identification_poses=POSES[-1],
        identification_runs=RUNS * POSES[-1],
        check_poses=CHECK_POSES,
        check_runs=CHECK_POSES,
        workspace_poses=asked.workspace,
    )


def read(campaign: Campaign) -> list[Dataset]:
    """Read the runs in few and in many poses, with noise."""
    every = reread(campaign.identification, campaign.scenario.sigma, trial_rng(campaign.seed, 1))
    return [select_runs(every, every.pose_id <= poses) for poses in POSES]


def _rows(
    cell: Cell, models: Sequence[Model], cases: Sequence[TrialCase], prior: Prior, seed: int
) -> Iterator[FamilyMethodRow]:
    """What is chosen by default and every method, from few and from many poses, in one truth."""
    chosen = [choose_model(cell, case.runs, prior) for case in cases]
    found = fitted(cell, models, cases)
    fits = Fits({CHOSEN: [estimate for _, estimate in chosen], **found}, found.seconds, found.filled)
    truth, far = cases[0].test, PRIORS[str(cases[0].factors["prior_error"])].far
    link = wrong_link(cell, seed) if far == "link" else None
    share = None if link is None else _share(cell, link, truth, chosen[0][1])

    def more(name: str, k: int) -> dict[str, object]:
        estimate = fits[name][k]
        return {
            "wrong": COMMON_JOINT_SCALE_NAME
            if far == "joints"
            else None
            if link is None
            else cell.arm.links[link].name,
            "link_share": share,
            "chosen": chosen[k][0] if name == CHOSEN else None,
            "cover": cover(cell, estimate, truth) if name in COVERED else None,
            "doubted": _doubted(cell, link, estimate, prior) if name == CHOSEN else None,
        }

    yield from score_cases(cell, cases, fits, FamilyMethodRow, more)


def _share(cell: Cell, link: int, truth: Dataset, estimate: Estimate) -> float:
    """RMS of the true deflection that is one link's over the whole, linear [1]; any estimate will do."""
    C, at = cell.plant.arm.C_theta, slice(6 * link, 6 * link + 6)
    own = np.zeros_like(C)
    own[at, at] = C[at, at]
    part, whole = deflections_of_models(cell.vjm, [replace(estimate, C_theta=M) for M in (own, C)], truth)
    return float(np.linalg.norm(part) / np.linalg.norm(whole))


def _doubted(cell: Cell, link: int | None, estimate: Estimate, prior: Prior) -> Doubted:
    """What the readings contradict of a prior and, if one link of it is wrong, which scales they leave open.

    Open in the direction in which that link is wrong: stiffer than a prior that is ten times too soft. An
    estimate without a prior leaves all of it open.
    """
    if estimate.weighted_prior is None:
        names = [*(part.name for part in cell.arm.links), *(part.name for part in cell.arm.joints)]
        return Doubted((), tuple(names))
    heard = tuple(scale.name for scale in contradicted_scales(estimate.weighted_prior))
    if link is None:
        return Doubted(heard, None)
    regression = estimate.compliance_regression
    left = undetermined_compliances(regression, scale_by_prior(prior, cell.vjm, regression.structure))
    traces = [
        np.trace(prior.C_theta[k : k + 6, k : k + 6]) / np.trace(cell.arm.C_theta[k : k + 6, k : k + 6])
        for k in range(0, 6 * len(cell.arm.links), 6)
    ]
    return Doubted(heard, left.stiffer if traces[link] > np.median(traces) else left.softer)


def _said_of_prior(rows: Trials) -> Mapping[str, Cells]:
    """Judge in every case what is said of its prior, 0 or 1; NaN where nothing can be.

    The columns are `SAID`: something is doubted, the wrong link is named, it is listed as unchecked, it is
    listed where another one is wrong, and either of the second and third.
    """
    wrong, heard, left = (rows[key] for key in ("wrong", "doubted.contradicted", "doubted.unchecked"))
    named = [(link, open_) for link, open_ in zip(wrong, left, strict=True) if open_ is not None and link]
    others = {  # how often a link is named where another one is wrong
        link: float(np.mean(own))
        for link in dict(named)
        if (own := [link in open_ for other, open_ in named if other != link])
    }
    asked, listed, known = (np.array([own is not None for own in each]) for each in (heard, left, wrong))
    doubted, told, unchecked, otherwise = (
        np.where(counts, np.array(each, dtype=float), np.nan)
        for counts, each in (
            (asked, [len(own or ()) > 0 for own in heard]),
            (asked & known, [link in (own or ()) for link, own in zip(wrong, heard, strict=True)]),
            (listed, [link in (own or ()) for link, own in zip(wrong, left, strict=True)]),
            (listed & known, [others.get(link, np.nan) for link in wrong]),
        )
    )
    either = np.where(np.isnan(unchecked), np.nan, np.fmax(told, unchecked))
    return dict(zip(SAID, (doubted, told, unchecked, otherwise, either), strict=True))


# --- The report ---------------------------------------------------------------------------------------------

MARGIN = 0.05  #: Share by which an error must exceed that of joints alone for a method to lose.
MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
PROMISES = f"where cases covered_percent half_mm over_ideal {' '.join(SAID)}"


def _tables(_: FamilySettings) -> Mapping[str, TrialTable]:
    """Tabulate methods by poses, the default over joints alone by true arm and prior, and its promises."""
    few = {"name": CHOSEN, "poses": POSES[0]}
    return {
        "short": TrialTable("RMS error over the workspace, um", across="poses"),
        "cells": TrialTable(
            f"Error of the default divided by that of Joints-only, {POSES[0]} poses",
            down="true_arm",
            across="prior_error",
            value="over_joints",
            where=few,
        ),
        "losses": TrialTable(
            f"Cases in which a method errs over {100 * MARGIN:g} % more than Joints-only",
            columns="name poses over_joints loses",
            by="poses",
        ),
        "promises": TrialTable(
            "Intervals and warnings of the default", columns=PROMISES, where={"name": CHOSEN}, rows=promises
        ),
    }


def _derived(_: FamilySettings, trials: Trials) -> Trials:
    """Sort cases as readers expect them; add errors over those of joints alone in the same case."""
    places = [
        [list(known).index(word) for word in trials[name]]
        for name, known in {"prior_error": PRIORS, "true_arm": FAMILY_TRUE_ARMS}.items()
    ]
    own = trials.pick(np.lexsort(places))
    over = own[ERROR] / matched(own, own.where(name=JOINTS_ONLY), ERROR, (TRIAL, "true_arm", "poses"))
    return by_case(own.add(over_joints=over, loses=over > 1 + MARGIN), "true_arm")


def promises(default: Trials) -> Iterator[Row]:
    """Count whether intervals hold and doubts are right: of all cases, by poses, prior, true arm and link."""
    judged = default.add(**_said_of_prior(default))
    share, percent = judged["link_share"], f"{100 * MOVES:.0f} % of the deflection"
    parts, called = {"all": judged}, KNOWN["prior_error"].called
    parts |= {f"{n} poses": own for (n,), own in judged.groups("poses")}
    parts |= {f"prior {called[name]}": judged.where(prior_error=name) for name in PRIORS}
    parts[f"prior right, {TRUE_ARM_LABELS['tubes']}"] = judged.where(
        prior_error=UNPERTURBED, true_arm="tubes"
    )
    parts[f"a link off, less than {percent}"] = judged.pick(share <= MOVES)
    parts[f"a link off, more than {percent}"] = judged.pick(share > MOVES)
    parts |= {TRUE_ARM_LABELS[name]: judged.where(true_arm=name) for name in FAMILY_TRUE_ARMS}
    for where, trials in parts.items():
        if not len(trials):
            continue
        covered, half, ideal = (trials[f"cover.{key}"] for key in ("covered_percent", "half_mm", "ideal_mm"))
        yield Row(
            where=where,
            cases=len(trials),
            covered_percent=covered.mean(),  # every case has as many components
            half_mm=number(half, trials[SHARED]),
            ideal_mm=number(ideal, trials[SHARED]),
            over_ideal=number(half / ideal, trials[SHARED]),
            **{key: _share_of(trials[key]) for key in SAID},
        )


def _share_of(cells: Cells) -> float | None:
    """Of the cases that count; None where there is none."""
    known = cells[np.isfinite(cells)]
    return float(known.mean()) if len(known) else None


def _cells(_: FamilySettings, trials: Trials) -> Mapping[str, Where]:
    """Choose the cases with fewest poses."""
    return {"": {"poses": min(trials.values("poses"))}}


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw the error of every method over the family, a pane a number of poses."""
    table, panes = by_levels(found.tables["short"])
    table = replace(table, looks={**table.looks, CHOSEN: CHOICE})
    reading = "Larger dots: what testbench chooses from the readings. Filled: with a prior."
    return {"which_model.png": forest(table, panes, found.question, reading, JOINTS_ONLY)}


PRESET = Preset(
    name="which_model",
    page="docs/studies/which_model.md",
    question="Which method should be the default with 8, 12 or 20 poses?",
    how="Each arm is read under its payload, in two runs per pose. MuJoCo gives the true deflections. Models "
    "are judged over the workspace. In every trial, each of six true arms gets a different one of six "
    "priors.",
    options=FamilyOptions,
    settings=_settings,
    seeds=(102, 6),
    row=FamilyMethodRow,
    trial=_trial,
    tables=_tables,
    printed="short",
    cells=_cells,
    ours=CHOSEN,
    pairs=((CHOSEN, JOINTS_ONLY), ("MGCO56", "MLS56")),
    derived=_derived,
    figures=_figures,
)
STUDY = PRESET.study()
